//! The Allegro hand, a box on a table and demonstrations of grasping it, for tests of generators of grasps, and the
//! checks that hold of every generator.
//!
//! Everything is in meters, radians and seconds; every failure panics, as in a test.

#![expect(
    clippy::disallowed_methods,
    clippy::expect_used,
    clippy::missing_panics_doc,
    clippy::panic,
    reason = "it is a part of tests"
)]

use std::{collections::BTreeMap, fs, path::Path, sync::Arc};

use dataflow::{
    Artifact, BoxedDiagnostic, ConfigOf, Context, Inputs, Outcome, Output, Partition, Scope,
    SourceFile, Unit,
};
use geometry::{DistanceField, TriMesh};
use motion::{Motion, Step};
use nalgebra::{Point3, UnitQuaternion, Vector3};
use posture::Environment;
use robot::RobotModel;
use schemas::{
    Table,
    candidates::Candidates,
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

    /// Makes a generator's candidates for it from these trajectories, with its distance field if `with_field`; returns
    /// what was measured and written.
    pub fn candidates<O: Output>(
        self,
        config: &ConfigOf<O>,
        trajectories: &[Trajectory],
        with_field: bool,
        seed: u64,
    ) -> (Outcome<O::Metrics>, Option<Candidates>) {
        let folder = tempfile::tempdir().expect("a folder");
        let out = folder.path().join("out");
        fs::create_dir(&out).expect("a folder");
        let artifacts = self.artifacts(folder.path(), trajectories, with_field);
        let cx = Context::detached(&"box".parse().expect("a key"), seed, &out);
        let outcome = O::read_and_make(config, &inputs(&artifacts), &cx).expect("no failure");
        let is_made = matches!(outcome, Outcome::Made(_));
        let read = || lake::table::read(&artifact("box", &out)).expect("candidates");
        let candidates = is_made.then(read);
        (outcome, candidates)
    }
}

/// Checks that candidates follow the seed, on any number of threads.
pub fn check_seed(candidates: impl Fn(u64) -> Option<Candidates> + Sync) {
    let on_one = rayon::ThreadPoolBuilder::new().num_threads(1);
    let on_one = on_one.build().expect("a pool");
    let one = on_one.install(|| candidates(3));
    assert_eq!(one, candidates(3));
    assert_ne!(one, candidates(4));
}

/// Checks that a generator skips an object without a distance field, with the reason.
pub fn check_skipped_without_field<M>((outcome, made): (Outcome<M>, Option<Candidates>)) {
    let Outcome::Skipped { reason } = outcome else {
        panic!("not skipped");
    };
    assert!(
        reason.contains("distance field") && made.is_none(),
        "{reason}"
    );
}

/// Checks that a generator has a unit for each object that its option names, by default for all; `units` lists them.
pub fn check_chosen_objects(
    units: impl Fn(Vec<String>, &Scope) -> Result<Vec<Unit>, BoxedDiagnostic>,
) {
    let partition = |key: &&str| Partition::new(key.parse().expect("a key"), BTreeMap::new());
    let of = |keys: &[&str]| keys.iter().map(partition).collect::<Vec<_>>();
    let scope = Scope::new(BTreeMap::from([
        (Object::NAME.to_owned(), of(&["box", "can"])),
        (FieldInfo::NAME.to_owned(), of(&["can"])),
        (Trajectory::NAME.to_owned(), of(&["a", "b"])),
    ]));
    let named = |objects: &[&str]| {
        let objects = objects.iter().map(|&name| name.to_owned());
        units(objects.collect(), &scope)
    };
    assert_eq!(named(&[]).expect("units").len(), 2);
    let one = named(&["can"]).expect("a unit");
    assert_eq!((one.len(), one[0].partition.as_str()), (1, "can"));
    assert_eq!(one[0].reads[FieldInfo::NAME], ["can"]);
    assert_eq!(one[0].reads[Trajectory::NAME], ["a", "b"]);
    let unknown = named(&["cup"]).expect_err("it is unknown");
    assert!(unknown.to_string().contains("`cup`"));
    let hint = unknown.hint().expect("the known ones");
    assert!(hint.contains("box, can"));
    let nothing = units(Vec::new(), &Scope::default()).expect_err("there is none");
    assert_eq!(nothing.missing_input(), Some("objects"));
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
