//! The Allegro hand, a box on a table and demonstrations of grasping it, for tests of generators of grasps.
//!
//! Everything is in meters, radians and seconds; every failure panics, as in a test.

#![expect(
    clippy::disallowed_methods,
    clippy::expect_used,
    clippy::missing_panics_doc,
    reason = "it is a part of tests"
)]

use std::{collections::BTreeMap, fs, path::Path, sync::Arc};

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

/// The hand.
pub const URDF: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../../data/robots/allegro_right.urdf"
);

/// Its hand table.
pub const HAND_TABLE: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../../data/hands/allegro_right.toml"
);

/// Joints that bend its fingers.
pub const FLEXION: [&str; 11] = [
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
pub const GRASP_Q: [f64; 16] = [
    0.0, 0.7, 0.6, 0.5, 0.0, 0.7, 0.6, 0.5, 0.0, 0.7, 0.6, 0.5, 1.2, 0.2, 0.5, 0.5,
];

const SPACING_M: f64 = 0.0025;
const MARGIN_M: f64 = 0.025;
/// Points on the box.
const POINTS_N: usize = 200;

/// Inputs of a stage, by the names of artifacts.
pub type Artifacts = BTreeMap<String, Vec<Artifact>>;

/// Returns the hand.
pub fn hand() -> RobotModel {
    let urdf = fs::read_to_string(URDF).expect("the hand is there");
    RobotModel::from_urdf(&urdf).expect("the hand can be read")
}

/// A box that stands on a table, about its origin.
#[derive(Debug, Clone, Copy)]
pub struct StandingBox {
    /// Half of its sides.
    pub half_m: [f64; 3],
}

impl StandingBox {
    fn mesh(self) -> TriMesh {
        let high = Point3::from(self.half_m);
        TriMesh::cuboid(-high, high)
    }

    /// Returns its distance field.
    pub fn field(self) -> DistanceField {
        let field = DistanceField::new(&self.mesh(), SPACING_M, MARGIN_M);
        field.expect("it is small").expect("it is closed")
    }

    /// Returns its resting pose.
    pub fn rest(self) -> RestingPose {
        RestingPose {
            up_in_object: Vector3::z_axis(),
            height_m: self.half_m[2],
        }
    }

    /// Returns it on its table.
    pub fn environment(self) -> Environment {
        Environment::new(Arc::new(self.field()), self.rest())
    }

    /// Returns it as an object, with points all over it.
    pub fn object(self) -> Object {
        let mesh = self.mesh();
        let (points, normals) = mesh.sample_surface(POINTS_N, 7);
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
                rest: self.rest(),
                seen_n: 1,
                probability: 1.0,
            }],
        }
    }

    /// Returns a trajectory of the hand to it, from 0.4 m, so many radians about the vertical, that ends in a grasp.
    pub fn reached(self, sequence: &str, grasp_q: &[f64], angle_rad: f64) -> Trajectory {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle_rad);
        let step = |time_s: f64| Step {
            time_s,
            frame_from_palm: Pose::from_parts(
                turn * Vector3::new(-0.4 + 0.32 * time_s, 0.0, 0.04),
                turn,
            ),
            q_rad: grasp_q.to_vec(),
            rates: TrajectoryRates::zero(grasp_q.len()),
        };
        let motion = Motion::new(&hand().joint_names(), vec![step(0.0), step(1.0)]);
        Trajectory {
            sequence: sequence.to_owned(),
            object: "box".to_owned(),
            keypoints: Vec::new(),
            tips: Vec::new(),
            rest: self.rest(),
            motion: motion.expect("a motion"),
            tracking: vec![Tracking::default(); 2],
        }
    }

    /// Writes it and these trajectories as artifacts into a folder, with its distance field if `with_field`.
    pub fn artifacts(
        self,
        root: &Path,
        trajectories: &[Trajectory],
        with_field: bool,
    ) -> Artifacts {
        let made = |name: &str, key: &str, write: &dyn Fn(&Path)| {
            let path = root.join(name).join(key);
            fs::create_dir_all(&path).expect("a folder");
            write(&path);
            artifact(key, &path)
        };
        let object = made(Object::NAME, "box", &|path| {
            lake::table::write(path, &self.object()).expect("written");
        });
        let trajectories = trajectories.iter().map(|trajectory| {
            made(Trajectory::NAME, &trajectory.sequence, &|path| {
                lake::table::write(path, trajectory).expect("written");
            })
        });
        let mut artifacts = BTreeMap::from([
            (Object::NAME.to_owned(), vec![object]),
            (Trajectory::NAME.to_owned(), trajectories.collect()),
        ]);
        if with_field {
            let field = made(FieldInfo::NAME, "box", &|path| {
                let info = FieldInfo {
                    spacing_m: SPACING_M,
                    margin_m: MARGIN_M,
                    center_of_mass_m: [0.0; 3],
                    hull_m: vec![[0.0; 3]],
                };
                lake::table::write(path, &info).expect("written");
                let field = path.join(distance_fields::FIELD);
                fs::write(field, self.field().to_bytes()).expect("written");
            });
            artifacts.insert(FieldInfo::NAME.to_owned(), vec![field]);
        }
        artifacts
    }
}

/// Returns the files of an artifact that a unit wrote into a folder.
pub fn artifact(key: &str, folder: &Path) -> Artifact {
    let files = fs::read_dir(folder).expect("a folder").map(|entry| {
        let entry = entry.expect("a file");
        let name = entry.file_name().into_string().expect("a name");
        (name, entry.path())
    });
    Artifact {
        key: key.parse().expect("a key"),
        labels: BTreeMap::new(),
        files: files.collect(),
    }
}

/// Returns artifacts as a unit's inputs, with the hand and its table.
pub fn inputs(artifacts: &Artifacts) -> Inputs {
    let files = [("hand", URDF), ("hand_table", HAND_TABLE)];
    let files = files.map(|(name, path)| SourceFile::named(name, Path::new(path)));
    Inputs::new(artifacts.clone(), files.to_vec())
}
