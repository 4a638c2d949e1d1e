//! The stage: one trajectory per demonstration.

use std::{collections::BTreeMap, fs, path::Path};

use dataflow::{
    Code, Context, Input, Inputs, Labels, Made, Outcome, Output, Scope, SourceFile, Stage, Summary,
    Unit,
};
use geometry::TriMesh;
use robot::RobotModel;
use schemas::{demonstrations, objects, trajectories};

use crate::{RetargetConfig, RetargetError, hand::Hand, recording, scene::Scene, track::track};

/// Moves human demonstrations onto a robot hand.
pub enum Retarget {}

impl Stage for Retarget {
    type Config = RetargetConfig;
    type Error = RetargetError;

    const KIND: &'static str = "retarget";
    const ABOUT: &'static str = "Moves human demonstrations onto a robot hand";
    const CODE: Code = dataflow::code!();
    const INPUTS: &'static [Input] = &[
        Input {
            name: "demonstrations",
            artifact: "demonstrations",
        },
        Input {
            name: "objects",
            artifact: "objects",
        },
    ];
    const OUTPUTS: &'static [Output] = &[Output {
        artifact: "trajectories",
        schema: trajectories::VERSION,
        partition: "sequence",
        parallel: true,
    }];

    /// Checks the options and that the hand has every link that they name.
    fn prepare(config: &RetargetConfig) -> Result<(), RetargetError> {
        config.check()?;
        load_hand(config, &config.hand).map(|_| ())
    }

    fn units(
        config: &RetargetConfig,
        _output: &str,
        scope: &Scope,
    ) -> Result<Vec<Unit>, RetargetError> {
        let demonstrations = scope.partitions("demonstrations");
        if demonstrations.is_empty() {
            return Err(RetargetError::NoDemonstrations);
        }
        let objects = scope.partitions("objects");
        if objects.is_empty() {
            return Err(RetargetError::NoObjects);
        }
        Ok(demonstrations
            .iter()
            .map(|demonstration| {
                // A demonstration whose object is missing is planned without it, and skipped.
                let object = demonstration
                    .label("object")
                    .filter(|name| objects.iter().any(|object| object.key == *name));
                Unit::new(&demonstration.key)
                    .reading("demonstrations", [&demonstration.key])
                    .reading("objects", object)
                    .only_files("objects", [objects::MESH])
                    .with_file(SourceFile::named_by_file(&config.hand))
            })
            .collect())
    }

    fn foretell(
        _config: &RetargetConfig,
        _output: &str,
        unit: &Unit,
        scope: &Scope,
    ) -> Option<Labels> {
        let demonstrations = scope.partitions("demonstrations");
        let moved = demonstrations
            .iter()
            .find(|demonstration| demonstration.key == unit.partition)?;
        let object = moved.label("object")?;
        Some(Labels::from([("object".to_owned(), object.to_owned())]))
    }

    fn run(
        config: &RetargetConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome, RetargetError> {
        let missing = |what| RetargetError::MissingInput {
            partition: cx.partition().to_owned(),
            what,
        };
        let schema = |source| RetargetError::Schema {
            partition: cx.partition().to_owned(),
            source,
        };
        config.check()?;
        let urdf = inputs
            .files()
            .first()
            .ok_or_else(|| missing("URDF of a hand"))?;
        let hand = load_hand(config, &urdf.path)?;
        let artifact = inputs
            .artifacts("demonstrations")
            .first()
            .ok_or_else(|| missing("demonstration"))?;
        let demonstration =
            demonstrations::from_batch(&artifact.key, &lake::table::read(artifact)?)
                .map_err(schema)?;
        if demonstration.hand != config.side {
            return Ok(Outcome::Skipped {
                reason: format!(
                    "a {} hand's reach, but `side` says that the robot's is a {} hand",
                    demonstration.hand.as_str(),
                    config.side.as_str()
                ),
            });
        }
        let Some(artifact) = inputs.artifacts("objects").first() else {
            return Ok(Outcome::Skipped {
                reason: format!(
                    "its object `{}` is not among the objects",
                    demonstration.object
                ),
            });
        };
        let mesh_path = artifact
            .file(objects::MESH)
            .ok_or_else(|| missing("mesh of an object"))?;
        let text = fs::read_to_string(mesh_path).map_err(|source| RetargetError::ReadMesh {
            object: artifact.key.clone(),
            source,
        })?;
        let mesh = match TriMesh::from_obj(&text) {
            Ok(mesh) => mesh,
            Err(err) => {
                return Ok(Outcome::Skipped {
                    reason: format!("the mesh of its object `{}`: {err}", artifact.key),
                });
            }
        };
        let Some(scene) = Scene::new(mesh, &demonstration.rest) else {
            return Ok(Outcome::Skipped {
                reason: format!("the mesh of its object `{}` has no surface", artifact.key),
            });
        };
        let Some(tracked) = track(&hand, &scene, config, &demonstration) else {
            return Ok(Outcome::Skipped {
                reason: "it has no step".to_owned(),
            });
        };
        if tracked.grasp_keypoint_error_m > config.max_keypoint_error_m {
            return Ok(Outcome::Filtered {
                reason: format!(
                    "the hand stays {:.0} mm from the landmarks at the grasp, more than \
                     `max_keypoint_error_m`",
                    1000.0 * tracked.grasp_keypoint_error_m
                ),
            });
        }
        let metrics = [
            ("steps_n", tracked.steps.len() as f64),
            ("keypoint_error_m", tracked.keypoint_error_m),
            ("fingertip_error_m", tracked.fingertip_error_m),
            ("penetration_m", tracked.penetration_m),
            ("table_penetration_m", tracked.table_penetration_m),
            ("tip_gap_m", tracked.tip_gap_m),
            ("restarts_n", tracked.restarts_n as f64),
        ];
        let trajectory = trajectories::Trajectory {
            sequence: demonstration.sequence,
            object: demonstration.object,
            joints: hand.model.joint_names(),
            rest: scene.rest(),
            steps: tracked.steps,
        };
        let batch = trajectories::to_batch(&trajectory).map_err(schema)?;
        lake::table::write(cx.folder(), &batch)?;
        let urdf = fs::read_to_string(&urdf.path).map_err(|source| RetargetError::ReadHand {
            path: urdf.path.clone(),
            source,
        })?;
        recording::record(&urdf, &hand.model, scene.mesh(), &trajectory, cx.folder())?;
        Ok(Outcome::Made(Made {
            labels: BTreeMap::from([("object".to_owned(), trajectory.object)]),
            metrics: metrics.map(|(name, value)| (name.to_owned(), value)).into(),
        }))
    }

    fn describe(_output: &str, summary: &Summary) -> String {
        let n_read = summary.n_made + summary.n_skipped + summary.n_filtered;
        let mean_mm = |metric| 1000.0 * summary.total(metric) / summary.n_made.max(1) as f64;
        format!(
            "{n_read} demonstrations → {} trajectories, {:.0} mm from the landmarks",
            summary.n_made,
            mean_mm("keypoint_error_m")
        )
    }
}

/// Reads the hand and finds every link that the configuration names.
fn load_hand(config: &RetargetConfig, path: &Path) -> Result<Hand, RetargetError> {
    let xml = fs::read_to_string(path).map_err(|source| RetargetError::ReadHand {
        path: path.to_owned(),
        source,
    })?;
    RobotModel::from_urdf(&xml)
        .and_then(|model| Hand::new(model, config))
        .map_err(|source| RetargetError::Hand {
            path: path.to_owned(),
            source,
        })
}

#[cfg(test)]
mod tests {
    use std::{io::Write, path::PathBuf};

    use dataflow::{Advise, Artifact, Partition};
    use schemas::demonstrations::{Demonstration, KEYPOINTS, Side, Step};

    use super::*;
    use crate::fixture;

    fn scope(object: &str) -> Scope {
        Scope::new(BTreeMap::from([
            (
                "demonstrations".to_owned(),
                vec![Partition::new(
                    "s",
                    BTreeMap::from([("object".to_owned(), object.to_owned())]),
                )],
            ),
            (
                "objects".to_owned(),
                vec![Partition::new("box", BTreeMap::new())],
            ),
        ]))
    }

    /// Makes the folder of an artifact that holds a table.
    fn place(folder: &Path, key: &str) -> (PathBuf, Artifact) {
        let folder = folder.join(key);
        fs::create_dir_all(&folder).unwrap();
        let table = folder.join(lake::table::FILE);
        let artifact = Artifact {
            key: key.to_owned(),
            labels: BTreeMap::new(),
            files: BTreeMap::from([(lake::table::FILE.to_owned(), table)]),
        };
        (folder, artifact)
    }

    fn demonstration() -> Demonstration {
        let mut keypoints_m = [[0.0; 3]; KEYPOINTS];
        for (idx, keypoint) in keypoints_m.iter_mut().enumerate() {
            let finger = idx.saturating_sub(1) / 4;
            let along = if idx == 0 {
                0.0
            } else {
                0.06 + 0.03 * ((idx - 1) % 4) as f64
            };
            *keypoint = [-0.1, 0.04 - 0.02 * finger as f64, along];
        }
        Demonstration {
            sequence: "s".to_owned(),
            object: "box".to_owned(),
            subject: "p".to_owned(),
            hand: Side::Right,
            mirrored: false,
            start_reason: String::new(),
            end_reason: String::new(),
            rest: fixture::rest(),
            steps: (0..3_u32)
                .map(|image| Step {
                    image,
                    time_s: f64::from(image) / 30.0,
                    cameras_n: 1,
                    bridged: false,
                    keypoints_m,
                })
                .collect(),
        }
    }

    fn run(config: &RetargetConfig, unit: &Unit, folder: &Path) -> Outcome {
        let (out, _) = place(folder, "out");
        let (path, shown) = place(folder, "s");
        lake::table::write(&path, &demonstrations::to_batch(&demonstration()).unwrap()).unwrap();
        let mut artifacts = BTreeMap::from([("demonstrations".to_owned(), vec![shown])]);
        if unit
            .reads
            .get("objects")
            .is_some_and(|keys| !keys.is_empty())
        {
            let (path, mut object) = place(folder, "box");
            let mesh = path.join(objects::MESH);
            let mut file = fs::File::create_new(&mesh).unwrap();
            file.write_all(fixture::mesh().to_obj().as_bytes()).unwrap();
            object.files = BTreeMap::from([(objects::MESH.to_owned(), mesh)]);
            artifacts.insert("objects".to_owned(), vec![object]);
        }
        let inputs = Inputs::new(artifacts, unit.files.clone());
        Retarget::run(
            config,
            &inputs,
            &Context::detached("trajectories", "s", 0, &out),
        )
        .unwrap()
    }

    #[test]
    fn a_demonstration_becomes_a_trajectory() {
        let folder = tempfile::tempdir().unwrap();
        let config = fixture::config();
        Retarget::prepare(&config).unwrap();
        let units = Retarget::units(&config, "trajectories", &scope("box")).unwrap();
        let Outcome::Made(made) = run(&config, &units[0], folder.path()) else {
            panic!("nothing was made");
        };
        assert_eq!(made.labels["object"], "box");
        assert_eq!(made.metrics["steps_n"], 3.0);
        let (_, artifact) = place(folder.path(), "out");
        let batch = lake::table::read(&artifact).unwrap();
        let trajectory = trajectories::from_batch("s", &batch).unwrap();
        assert_eq!((trajectory.steps.len(), trajectory.joints.len()), (3, 16));
        assert_eq!(trajectory.object, "box");
        let recording = folder.path().join("out").join(recording::FILE);
        let contents = lake::recording::read(&recording).unwrap();
        assert_eq!(contents.topic("/joint_states").count(), 3);
    }

    #[test]
    fn a_demonstration_without_its_object_is_skipped() {
        let folder = tempfile::tempdir().unwrap();
        let config = fixture::config();
        let units = Retarget::units(&config, "trajectories", &scope("bottle")).unwrap();
        let outcome = run(&config, &units[0], folder.path());
        assert!(matches!(outcome, Outcome::Skipped { reason } if reason.contains("`box`")));
    }

    #[test]
    fn the_reach_of_the_other_hand_is_skipped() {
        let folder = tempfile::tempdir().unwrap();
        let mut config = fixture::config();
        config.side = Side::Left;
        let units = Retarget::units(&config, "trajectories", &scope("box")).unwrap();
        let outcome = run(&config, &units[0], folder.path());
        let expected = "a right hand's reach, but `side` says that the robot's is a left hand";
        assert!(matches!(outcome, Outcome::Skipped { reason } if reason == expected));
    }

    #[test]
    fn a_missing_link_is_named_with_the_file_and_near_names() {
        let mut config = fixture::config();
        config.correspondences[0].link = "link_15.0_top".to_owned();
        let err = Retarget::prepare(&config).unwrap_err();
        let message = err.to_string();
        assert!(
            message.contains("allegro_right.urdf") && message.contains("`link_15.0_top`"),
            "{message}"
        );
        assert!(
            err.hint().unwrap().contains("`link_15.0_tip`"),
            "{:?}",
            err.hint()
        );
        config.hand = PathBuf::from("nowhere.urdf");
        let err = Retarget::prepare(&config).unwrap_err();
        assert!(err.to_string().contains("`nowhere.urdf`"), "{err}");
    }

    #[test]
    fn options_without_sense_are_refused() {
        let refused = |change: fn(&mut RetargetConfig)| {
            let mut config = fixture::config();
            change(&mut config);
            Retarget::prepare(&config).unwrap_err().to_string()
        };
        assert!(refused(|c| c.hand_scale = 0.0).contains("`hand_scale`"));
        assert!(refused(|c| c.object_weight = f64::NAN).contains("`object_weight`"));
        assert!(refused(|c| c.correspondences[2].keypoint = 21).contains("`correspondences[2]`"));
        assert!(refused(|c| c.correspondences.truncate(2)).contains("`correspondences`"));
    }
}
