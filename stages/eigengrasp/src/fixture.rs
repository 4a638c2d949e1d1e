//! What the tests share: the Allegro hand and a box on a table.

use std::{collections::BTreeMap, fs, path::Path, sync::Arc};

use approach::HandBody;
use dataflow::{Artifact, Inputs, SourceFile};
use geometry::{DistanceField, TriMesh};
use motion::{Motion, Step};
use nalgebra::{Point3, UnitQuaternion, Vector3};
use posture::Environment;
use robot::RobotModel;
use schemas::{
    Table,
    distance_fields::{self, FieldInfo},
    objects::{Object, RestingOrientation},
    trajectories::{Tracking, Trajectory, TrajectoryRates},
};
use spatial::{Pose, RestingPose};

use crate::{EigengraspConfig, basis::Basis};

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
pub(crate) const GRASP_Q: [f64; 16] = [
    0.0, 0.7, 0.6, 0.5, 0.0, 0.7, 0.6, 0.5, 0.0, 0.7, 0.6, 0.5, 1.2, 0.2, 0.5, 0.5,
];

/// Returns options with their defaults.
pub(crate) fn config() -> EigengraspConfig {
    let value = serde_json::json!({ "hand": URDF, "flexion_joints": FLEXION });
    serde_json::from_value(value).unwrap()
}

/// Returns the Allegro hand.
pub(crate) fn body() -> HandBody {
    let model = RobotModel::from_urdf(&std::fs::read_to_string(URDF).unwrap()).unwrap();
    HandBody::new(model, &FLEXION, GRASP_Q.to_vec()).unwrap()
}

/// Returns two eigengrasps: all fingers bend, and the thumb turns.
pub(crate) fn basis() -> Basis {
    let along = |joints: &[usize], rad: f64| {
        let mut all = vec![0.0; 16];
        for &joint in joints {
            all[joint] = rad;
        }
        all
    };
    Basis {
        mean: GRASP_Q.to_vec(),
        eigengrasps: vec![
            along(&[1, 2, 3, 5, 6, 7, 9, 10, 11, 14, 15], 0.2),
            along(&[12], 0.1),
        ],
        explained: 0.9,
    }
}

/// Returns the box's distances.
fn field() -> DistanceField {
    let high = Point3::from(BOX_HALF_M);
    let mesh = TriMesh::cuboid(-high, high);
    DistanceField::new(&mesh, 0.0025, 0.025).unwrap().unwrap()
}

/// Returns how the box lies.
fn rest() -> RestingPose {
    RestingPose {
        up_in_object: Vector3::z_axis(),
        height_m: BOX_HALF_M[2],
    }
}

/// Returns the box on its table.
pub(crate) fn environment() -> Environment {
    Environment::new(Arc::new(field()), rest())
}

/// Returns the box as an object, with points on its corners.
fn object() -> Object {
    let high = Point3::from(BOX_HALF_M);
    let mesh = TriMesh::cuboid(-high, high);
    let vertices_m: Vec<[f64; 3]> = mesh
        .vertices_m
        .iter()
        .map(|&corner| corner.into())
        .collect();
    Object {
        name: "box".to_owned(),
        mass_kg: 0.3,
        center_of_mass_m: [0.0; 3],
        inertia_kg_m2: [0.0; 6],
        normals: vertices_m.clone(),
        points_m: vertices_m.clone(),
        watertight: true,
        mirror: None,
        vertices_m,
        triangles: mesh.triangles,
        parts_m: Vec::new(),
        rests: vec![RestingOrientation {
            rest: rest(),
            seen_n: 1,
            probability: 1.0,
        }],
    }
}

/// Returns a trajectory of the Allegro to the box, from 0.4 m, that ends in this grasp.
fn trajectory(sequence: &str, grasp_q: &[f64]) -> Trajectory {
    let model = RobotModel::from_urdf(&fs::read_to_string(URDF).unwrap()).unwrap();
    let step = |time_s: f64| Step {
        time_s,
        frame_from_palm: Pose::from_parts(
            [-0.4 + 0.3 * time_s, 0.0, 0.1],
            UnitQuaternion::identity(),
        ),
        q_rad: grasp_q.to_vec(),
        rates: TrajectoryRates::zero(grasp_q.len()),
    };
    Trajectory {
        sequence: sequence.to_owned(),
        object: "box".to_owned(),
        keypoints: Vec::new(),
        tips: Vec::new(),
        rest: rest(),
        motion: Motion::new(&model.joint_names(), vec![step(0.0), step(1.0)]).unwrap(),
        tracking: vec![Tracking::default(); 2],
    }
}

/// Writes what the stage reads beside these trajectories, without the distances if so asked; returns the inputs.
pub(crate) fn inputs(folder: &Path, trajectories: &[Trajectory], with_field: bool) -> Inputs {
    let artifact = |name: &str, key: &str| {
        let path = folder.join(name).join(key);
        fs::create_dir_all(&path).unwrap();
        path
    };
    let read = |key: &str, path: &Path| Artifact {
        key: key.parse().unwrap(),
        labels: BTreeMap::new(),
        files: [lake::table::FILE, distance_fields::FIELD]
            .map(|file| (file.to_owned(), path.join(file)))
            .into_iter()
            .filter(|(_, path)| path.exists())
            .collect(),
    };
    let mut artifacts: BTreeMap<String, Vec<Artifact>> = BTreeMap::new();
    let path = artifact(Object::NAME, "box");
    lake::table::write(&path, &object()).unwrap();
    artifacts.insert(Object::NAME.to_owned(), vec![read("box", &path)]);
    for trajectory in trajectories {
        let path = artifact(Trajectory::NAME, &trajectory.sequence);
        lake::table::write(&path, trajectory).unwrap();
        let all = artifacts.entry(Trajectory::NAME.to_owned()).or_default();
        all.push(read(&trajectory.sequence, &path));
    }
    if with_field {
        let path = artifact(FieldInfo::NAME, "box");
        let info = FieldInfo {
            spacing_m: 0.0025,
            margin_m: 0.025,
            center_of_mass_m: [0.0; 3],
            hull_m: vec![[0.0; 3]],
        };
        lake::table::write(&path, &info).unwrap();
        fs::write(path.join(distance_fields::FIELD), field().to_bytes()).unwrap();
        artifacts.insert(FieldInfo::NAME.to_owned(), vec![read("box", &path)]);
    }
    Inputs::new(artifacts, vec![SourceFile::named("hand", Path::new(URDF))])
}

/// Returns trajectories whose grasps differ in two directions.
pub(crate) fn trajectories() -> Vec<Trajectory> {
    let basis = basis();
    let grasp = |sequence: &str, amplitudes: [f64; 2]| {
        let q = (0..GRASP_Q.len()).map(|joint| {
            let along = basis.eigengrasps.iter().zip(amplitudes);
            GRASP_Q[joint]
                + along
                    .map(|(eigengrasp, a)| a * eigengrasp[joint])
                    .sum::<f64>()
        });
        trajectory(sequence, &q.collect::<Vec<f64>>())
    };
    vec![
        grasp("a", [-1.0, 0.5]),
        grasp("b", [1.0, 0.5]),
        grasp("c", [0.0, -1.0]),
    ]
}
