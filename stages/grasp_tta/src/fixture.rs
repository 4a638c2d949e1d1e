//! What the tests share: the Allegro hand, a box on a table and three grasps of it.

use std::{collections::BTreeMap, fs, path::Path};

use approach::HandBody;
use dataflow::{Artifact, Inputs, SourceFile};
use geometry::{DistanceField, TriMesh};
use motion::{Motion, Step};
use nalgebra::{Point3, UnitQuaternion, Vector3};
use robot::RobotModel;
use schemas::{
    Table,
    distance_fields::{self, FieldInfo},
    objects::{Object, RestingOrientation},
    trajectories::{Tracking, Trajectory, TrajectoryRates},
};
use spatial::{Pose, RestingPose};

use crate::GraspTtaConfig;

/// Half of the box's sides, in meters.
pub(crate) const BOX_HALF_M: [f64; 3] = [0.03, 0.03, 0.08];

const URDF: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../data/robots/allegro_right.urdf"
);

/// Joints that bend the Allegro's fingers.
const FLEXION: [&str; 11] = [
    "joint_1.0",
    "joint_2.0",
    "joint_3.0",
    "joint_5.0",
    "joint_6.0",
    "joint_7.0",
    "joint_9.0",
    "joint_10.0",
    "joint_11.0",
    "joint_14.0",
    "joint_15.0",
];

/// A grasp with the thumb before the fingers.
const GRASP_Q: [f64; 16] = [
    0.0, 0.7, 0.6, 0.5, 0.0, 0.7, 0.6, 0.5, 0.0, 0.7, 0.6, 0.5, 1.2, 0.2, 0.5, 0.5,
];

/// Returns options of small networks that are hardly trained.
pub(crate) fn config() -> GraspTtaConfig {
    let value = serde_json::json!({
        "hand": URDF, "flexion_joints": FLEXION, "per_object": 4, "hand_points": 200,
        "network": { "points": 64, "point_widths": [16, 32], "encoder_widths": [32], "latent_dim": 4,
            "decoder_widths": [32], "contact_widths": [8, 16, 8] },
        "training": { "epochs": 4, "contact_epochs": 2, "batch": 2 },
        "adaptation": { "steps": 60 },
    });
    serde_json::from_value(value).unwrap()
}

fn model() -> RobotModel {
    RobotModel::from_urdf(&fs::read_to_string(URDF).unwrap()).unwrap()
}

/// Returns the Allegro hand.
pub(crate) fn body() -> HandBody {
    HandBody::new(model(), &FLEXION, GRASP_Q.to_vec()).unwrap()
}

fn mesh() -> TriMesh {
    let high = Point3::from(BOX_HALF_M);
    TriMesh::cuboid(-high, high)
}

/// Returns how the box lies.
fn rest() -> RestingPose {
    RestingPose {
        up_in_object: Vector3::z_axis(),
        height_m: BOX_HALF_M[2],
    }
}

/// Returns the box as an object, with points all over it.
fn object() -> Object {
    let mesh = mesh();
    let (points, normals) = mesh.sample_surface(200, 7);
    Object {
        name: "box".to_owned(),
        mass_kg: 0.3,
        center_of_mass_m: [0.0; 3],
        inertia_kg_m2: [0.0; 6],
        points_m: points.into_iter().map(Into::into).collect(),
        normals: normals.into_iter().map(Into::into).collect(),
        watertight: true,
        mirror: None,
        vertices_m: mesh.vertices_m.iter().map(|&at| at.into()).collect(),
        triangles: mesh.triangles,
        parts_m: Vec::new(),
        rests: vec![RestingOrientation {
            rest: rest(),
            seen_n: 1,
            probability: 1.0,
        }],
    }
}

/// Returns a trajectory of the Allegro to the box that ends with its palm beside it, so many radians about the vertical.
fn trajectory(sequence: &str, angle_rad: f64) -> Trajectory {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle_rad);
    let step = |time_s: f64| Step {
        time_s,
        frame_from_palm: Pose::from_parts(
            turn * Vector3::new(-0.4 + 0.32 * time_s, 0.0, 0.04),
            turn,
        ),
        q_rad: GRASP_Q.to_vec(),
        rates: TrajectoryRates::zero(GRASP_Q.len()),
    };
    Trajectory {
        sequence: sequence.to_owned(),
        object: "box".to_owned(),
        keypoints: Vec::new(),
        tips: Vec::new(),
        rest: rest(),
        motion: Motion::new(&model().joint_names(), vec![step(0.0), step(1.0)]).unwrap(),
        tracking: vec![Tracking::default(); 2],
    }
}

/// Returns the files of an artifact that a unit wrote into a folder.
pub(crate) fn artifact(key: &str, folder: &Path) -> Artifact {
    let files = fs::read_dir(folder).unwrap().map(|entry| {
        let entry = entry.unwrap();
        (entry.file_name().into_string().unwrap(), entry.path())
    });
    Artifact {
        key: key.parse().unwrap(),
        labels: BTreeMap::new(),
        files: files.collect(),
    }
}

/// Writes what the stage reads, without the distances if so asked; returns the artifacts by name.
pub(crate) fn artifacts(root: &Path, with_field: bool) -> BTreeMap<String, Vec<Artifact>> {
    let made = |name: &str, key: &str, write: &dyn Fn(&Path)| {
        let path = root.join(name).join(key);
        fs::create_dir_all(&path).unwrap();
        write(&path);
        artifact(key, &path)
    };
    let mut artifacts = BTreeMap::new();
    let object = made(Object::NAME, "box", &|path| {
        lake::table::write(path, &object()).unwrap();
    });
    artifacts.insert(Object::NAME.to_owned(), vec![object]);
    let trajectories = [("a", 0.0), ("b", 0.1), ("c", -0.1)].map(|(sequence, angle_rad)| {
        made(Trajectory::NAME, sequence, &|path| {
            lake::table::write(path, &trajectory(sequence, angle_rad)).unwrap();
        })
    });
    artifacts.insert(Trajectory::NAME.to_owned(), trajectories.into());
    if with_field {
        let field = made(FieldInfo::NAME, "box", &|path| {
            let info = FieldInfo {
                spacing_m: 0.0025,
                margin_m: 0.025,
                center_of_mass_m: [0.0; 3],
                hull_m: vec![[0.0; 3]],
            };
            lake::table::write(path, &info).unwrap();
            let field = DistanceField::new(&mesh(), 0.0025, 0.025).unwrap().unwrap();
            fs::write(path.join(distance_fields::FIELD), field.to_bytes()).unwrap();
        });
        artifacts.insert(FieldInfo::NAME.to_owned(), vec![field]);
    }
    artifacts
}

/// Returns artifacts as a unit's inputs, with the hand.
pub(crate) fn inputs(artifacts: &BTreeMap<String, Vec<Artifact>>) -> Inputs {
    let hand = SourceFile::named("hand", Path::new(URDF));
    Inputs::new(artifacts.clone(), vec![hand])
}
