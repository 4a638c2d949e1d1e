//! The stage: a distance field per object, a trajectory per demonstration, a report per object.

mod fields;
mod report;
mod retargeted;

use std::{collections::BTreeMap, fs, path::Path};

use dataflow::{
    Code, Context, Input, Inputs, Labels, Outcome, Output, Scope, SourceFile, Stage, Summary, Unit,
};
use robot::RobotModel;
use schemas::{distance_fields, objects, tracking, trajectories};

use crate::{
    HandTable, RetargetConfig, RetargetError, Wrist,
    hand::{self, Hand},
};

/// Moves human demonstrations onto a robot hand.
pub enum Retarget {}

/// The artifact of an object's distances.
const FIELDS: &str = "distance_fields";
/// The artifact of a demonstration's motion.
const TRAJECTORIES: &str = "trajectories";
/// The artifact of an object's report.
const TRACKING: &str = "tracking";

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
    const OUTPUTS: &'static [Output] = &[
        Output {
            artifact: FIELDS,
            schema: distance_fields::VERSION,
            partition: "object",
            parallel: true,
        },
        Output {
            artifact: TRAJECTORIES,
            schema: trajectories::VERSION,
            partition: "sequence",
            parallel: true,
        },
        Output {
            artifact: TRACKING,
            schema: tracking::VERSION,
            partition: "object",
            parallel: true,
        },
    ];

    /// Checks the options and that the hand has every link that its table names.
    fn prepare(config: &RetargetConfig) -> Result<(), RetargetError> {
        config.check()?;
        let LoadedHand { hand, .. } = load_hand(&config.hand, &config.hand_table)?;
        check_wrist(config, &hand)
    }

    fn units(
        config: &RetargetConfig,
        output: &str,
        scope: &Scope,
    ) -> Result<Vec<Unit>, RetargetError> {
        match output {
            FIELDS => fields(scope),
            TRACKING => Ok(reports(scope)),
            _ => retargeted(config, scope),
        }
    }

    fn foretell(
        _config: &RetargetConfig,
        output: &str,
        unit: &Unit,
        scope: &Scope,
    ) -> Option<Labels> {
        let label = |object: &str| Labels::from([("object".to_owned(), object.to_owned())]);
        if output != TRAJECTORIES {
            return Some(label(&unit.partition));
        }
        let demonstrations = scope.partitions("demonstrations");
        let moved = demonstrations
            .iter()
            .find(|demonstration| demonstration.key == unit.partition)?;
        moved.label("object").map(label)
    }

    fn decides(option: &str, output: &str) -> bool {
        match output {
            FIELDS => option == "field_spacing_m",
            TRACKING => false,
            _ => option != "field_spacing_m",
        }
    }

    fn run(
        config: &RetargetConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome, RetargetError> {
        match cx.output() {
            FIELDS => fields::make(config, inputs, cx),
            TRACKING => report::make(inputs, cx),
            _ => retargeted::make(config, inputs, cx),
        }
    }

    fn describe(output: &str, summary: &Summary) -> String {
        let mean_mm = |metric, n: f64| 1000.0 * summary.total(metric) / n.max(1.0);
        match output {
            FIELDS => format!("{} objects → distance fields", summary.n_made),
            TRACKING => format!(
                "{} trajectories towards {} objects, finger tips {:.1} mm from their landmarks",
                summary.total("trajectories_n"),
                summary.n_made,
                mean_mm("tip_error_sum_m", summary.total("tips_n"))
            ),
            _ => {
                let n_read = summary.n_made + summary.n_skipped + summary.n_filtered;
                format!(
                    "{n_read} demonstrations → {} trajectories, {:.0} mm from the landmarks",
                    summary.n_made,
                    mean_mm("keypoint_error_m", summary.n_made as f64)
                )
            }
        }
    }
}

/// Returns the units of distance fields.
fn fields(scope: &Scope) -> Result<Vec<Unit>, RetargetError> {
    let objects = scope.partitions("objects");
    if objects.is_empty() {
        return Err(RetargetError::NoObjects);
    }
    let unit = |object: &str| {
        Unit::new(object)
            .reading("objects", [object])
            .only_files("objects", [objects::MESH])
    };
    Ok(objects.iter().map(|object| unit(&object.key)).collect())
}

/// Returns the units of trajectories.
fn retargeted(config: &RetargetConfig, scope: &Scope) -> Result<Vec<Unit>, RetargetError> {
    let demonstrations = scope.partitions("demonstrations");
    if demonstrations.is_empty() {
        return Err(RetargetError::NoDemonstrations);
    }
    let (objects, fields) = (scope.partitions("objects"), scope.partitions(FIELDS));
    Ok(demonstrations
        .iter()
        .map(|demonstration| {
            // A demonstration whose object or field is missing is planned without, and skipped.
            let object = demonstration.label("object");
            let among = |known: &[dataflow::Partition]| {
                object.filter(|name| known.iter().any(|one| one.key == *name))
            };
            Unit::new(&demonstration.key)
                .reading("demonstrations", [&demonstration.key])
                .reading("objects", among(objects))
                .reading(FIELDS, among(fields))
                .only_files("objects", [objects::MESH])
                .with_file(SourceFile::named_by_file(&config.hand))
                .with_file(SourceFile::named_by_file(&config.hand_table))
        })
        .collect())
}

/// Returns the units of reports.
fn reports(scope: &Scope) -> Vec<Unit> {
    let mut by_object: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for trajectory in scope.partitions(TRAJECTORIES) {
        if let Some(object) = trajectory.label("object") {
            by_object.entry(object).or_default().push(&trajectory.key);
        }
    }
    by_object
        .into_iter()
        .map(|(object, keys)| Unit::new(object).reading(TRAJECTORIES, keys))
        .collect()
}

/// A hand with the text of its URDF.
struct LoadedHand {
    urdf: String,
    hand: Hand,
    table: HandTable,
}

/// Reads a hand and its table, and finds every link that the table names.
fn load_hand(urdf_path: &Path, table_path: &Path) -> Result<LoadedHand, RetargetError> {
    let read = |path: &Path, what| {
        fs::read_to_string(path).map_err(|source| RetargetError::ReadHand {
            what,
            path: path.to_owned(),
            source,
        })
    };
    let urdf = read(urdf_path, "URDF")?;
    let of_urdf = |err: RetargetError| RetargetError::Hand {
        path: urdf_path.to_owned(),
        source: Box::new(err),
    };
    let model = RobotModel::from_urdf(&urdf).map_err(|err| of_urdf(err.into()))?;
    hand::check(&model).map_err(of_urdf)?;
    let in_table = |err: RetargetError| RetargetError::InHandTable {
        path: table_path.to_owned(),
        source: Box::new(err),
    };
    let table: HandTable = read(table_path, "table")?.parse().map_err(in_table)?;
    let hand = Hand::new(model, &table).map_err(|err| in_table(of_urdf(err)))?;
    Ok(LoadedHand { urdf, hand, table })
}

/// Checks that a wrist that is to be fixed can be placed.
fn check_wrist(config: &RetargetConfig, hand: &Hand) -> Result<(), RetargetError> {
    let found = hand.palm_points.len();
    match config.wrist {
        Wrist::Fixed if found < 3 => Err(RetargetError::TooFewPalmPoints { found }),
        Wrist::Fixed if hand.is_palm_a_line() => Err(RetargetError::PalmPointsInLine { found }),
        Wrist::Fixed | Wrist::Free => Ok(()),
    }
}

/// Returns the error of a unit that was not given what it needs: the plan is not this stage's.
fn missing(cx: &Context, what: &'static str) -> RetargetError {
    RetargetError::MissingInput {
        partition: cx.partition().to_owned(),
        what,
    }
}

/// Returns the error of a table that does not follow its schema.
fn schema(cx: &Context) -> impl Fn(schemas::SchemaError) -> RetargetError + Copy {
    |source| RetargetError::Schema {
        partition: cx.partition().to_owned(),
        source,
    }
}

fn skipped(reason: impl Into<String>) -> Outcome {
    Outcome::Skipped {
        reason: reason.into(),
    }
}

#[cfg(test)]
mod tests {
    use std::{io::Write, path::PathBuf};

    use dataflow::{Advise, Artifact, Partition};
    use schemas::demonstrations::{self, Demonstration, KEYPOINTS, Side, Step};

    use super::*;
    use crate::{fixture, recording};

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
            (
                FIELDS.to_owned(),
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

    /// Retargets one demonstration, after its object's field was made.
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
            let made = place(folder, "field").0;
            let cx = Context::detached(FIELDS, "box", 0, &made);
            let read = BTreeMap::from([("objects".to_owned(), vec![object.clone()])]);
            let outcome = Retarget::run(config, &Inputs::new(read, Vec::new()), &cx).unwrap();
            assert!(matches!(outcome, Outcome::Made(_)));
            let names = [lake::table::FILE, distance_fields::FIELD];
            let field = Artifact {
                key: "box".to_owned(),
                labels: BTreeMap::new(),
                files: names.map(|name| (name.to_owned(), made.join(name))).into(),
            };
            artifacts.insert("objects".to_owned(), vec![object]);
            artifacts.insert(FIELDS.to_owned(), vec![field]);
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
        assert_eq!((trajectory.keypoints.len(), trajectory.tips.len()), (9, 4));
        let grasp = &trajectory.steps[2];
        assert_eq!(grasp.tracking.keypoint_errors_m.len(), 9);
        assert_eq!(
            grasp.tracking.tip_errors_m,
            grasp.tracking.keypoint_errors_m[..4]
        );
        assert!(grasp.tracking.limit_margin_rad >= 0.0);
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
        config.hand_table = with_table(folder.path(), "\"right\"", "\"left\"");
        let units = Retarget::units(&config, "trajectories", &scope("box")).unwrap();
        let outcome = run(&config, &units[0], folder.path());
        let expected =
            "a right hand's reach, but the hand's table says that the robot's is a left hand";
        assert!(matches!(outcome, Outcome::Skipped { reason } if reason == expected));
    }

    #[test]
    fn a_landmark_that_is_no_number_is_told() {
        let mut shown = demonstration();
        let table = fixture::table();
        assert_eq!(retargeted::unusable(&shown, &table), None);
        shown.steps[1].keypoints_m[7][2] = f64::NAN;
        let reason = retargeted::unusable(&shown, &table).unwrap();
        assert!(reason.contains("step 1"), "{reason}");
        // Its square is no number.
        shown.steps[1].keypoints_m[7][2] = 1e200;
        assert_eq!(retargeted::unusable(&shown, &table), Some(reason));
    }

    /// Writes the Allegro hand's table with a part of it replaced.
    fn with_table(folder: &Path, from: &str, to: &str) -> PathBuf {
        let text = fs::read_to_string(fixture::TABLE).unwrap();
        assert!(text.contains(from));
        let path = folder.join("hand.toml");
        fs::write(&path, text.replacen(from, to, 1)).unwrap();
        path
    }

    #[test]
    fn a_missing_link_is_named_with_the_files_and_near_names() {
        let folder = tempfile::tempdir().unwrap();
        let mut config = fixture::config();
        config.hand_table = with_table(folder.path(), "link_15.0_tip", "link_15.0_top");
        let err = Retarget::prepare(&config).unwrap_err();
        let message = err.to_string();
        for part in ["allegro_right.urdf", "hand.toml", "`link_15.0_top`"] {
            assert!(message.contains(part), "{message}");
        }
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
    fn a_table_that_is_none_is_told_with_its_line() {
        let folder = tempfile::tempdir().unwrap();
        let mut config = fixture::config();
        config.hand_table = with_table(folder.path(), "scale =", "size =");
        let err = Retarget::prepare(&config).unwrap_err();
        let message = err.to_string();
        assert!(
            message.contains("hand.toml") && message.contains("`size`"),
            "{message}"
        );
        assert!(err.hint().unwrap().contains("doctor --robot"));
        config.hand_table = with_table(folder.path(), "thumb_tip", "thumb_top");
        let message = Retarget::prepare(&config).unwrap_err().to_string();
        assert!(
            message.contains("`thumb_top`") && message.contains("thumb_tip"),
            "{message}"
        );
    }

    #[test]
    fn a_fixed_wrist_needs_points_on_the_palm() {
        let folder = tempfile::tempdir().unwrap();
        let mut config = fixture::config();
        config.wrist = Wrist::Fixed;
        Retarget::prepare(&config).unwrap();
        let cut = "    { keypoint = \"ring_mcp\"";
        config.hand_table = with_table(folder.path(), cut, "    # {");
        Retarget::prepare(&config).unwrap();
        let text = fs::read_to_string(&config.hand_table).unwrap();
        let text = text.replace("    { keypoint = \"middle_mcp\"", "    # {");
        fs::write(&config.hand_table, text).unwrap();
        let err = Retarget::prepare(&config).unwrap_err();
        assert!(err.to_string().contains('2'), "{err}");
        assert!(err.hint().unwrap().contains("`index_mcp`"));
        // The knuckles alone are a line, about which the palm could turn.
        let knuckle = "offset_m = [0.0, 0.0, 0.0007]";
        config.hand_table = with_table(folder.path(), knuckle, "offset_m = [0.0, 0.0, -0.0015]");
        let text = fs::read_to_string(&config.hand_table).unwrap();
        let wrist = "    { keypoint = \"wrist\"";
        assert!(text.contains(wrist));
        fs::write(&config.hand_table, text.replace(wrist, "    # {")).unwrap();
        let err = Retarget::prepare(&config).unwrap_err();
        assert!(err.to_string().contains("line"), "{err}");
        assert!(err.hint().unwrap().contains("`wrist`"));
    }

    #[test]
    fn options_without_sense_are_refused() {
        let refused = |change: fn(&mut RetargetConfig)| {
            let mut config = fixture::config();
            change(&mut config);
            Retarget::prepare(&config).unwrap_err().to_string()
        };
        assert!(refused(|c| c.smooth_l1_beta_m = 0.0).contains("`smooth_l1_beta_m`"));
        assert!(refused(|c| c.field_spacing_m = 0.0).contains("`field_spacing_m`"));
        assert!(refused(|c| c.object_weight = f64::NAN).contains("`object_weight`"));
        assert!(refused(|c| c.field_spacing_m = 5.0).contains("`field_spacing_m`"));
        assert!(refused(|c| c.object_weight = 1e200).contains("`object_weight`"));
        assert!(refused(|c| c.smoothing_s = -1.0).contains("`smoothing_s`"));
        assert!(refused(|c| c.max_iterations = 0).contains("`max_iterations`"));
    }
}
