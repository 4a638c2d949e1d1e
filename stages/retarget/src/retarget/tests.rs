//! The stage from the outside: what it makes, skips and refuses.

use std::{collections::BTreeMap, error::Error, fs, io::Write, path::PathBuf};

use dataflow::{Artifact, Partition};
use geometry::TriMesh;
use nalgebra::{Point3, Vector3};
use retargeting::Wrist;
use schemas::{
    demonstrations::{Demonstration, KEYPOINTS, Side, Step},
    distance_fields,
};
use spatial::RestingPose;

use super::*;
use crate::recording;

/// Path of the Allegro hand's URDF, from this crate.
const URDF: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../data/robots/allegro_right.urdf"
);

/// Path of its table, from this crate.
const TABLE: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../data/hands/allegro_right.toml"
);

/// Half of the box's sides, in meters.
const BOX_HALF_M: [f64; 3] = [0.03, 0.04, 0.05];

/// Returns options with their defaults.
fn config() -> RetargetConfig {
    let options = serde_json::json!({ "hand": URDF, "hand_table": TABLE });
    serde_json::from_value(options).unwrap()
}

/// The labels of what is about an object.
fn labeled(object: &str) -> BTreeMap<String, String> {
    BTreeMap::from([("object".to_owned(), object.to_owned())])
}

fn scope(object: &str) -> Scope {
    Scope::new(BTreeMap::from([
        (
            "demonstrations".to_owned(),
            vec![Partition::new("s".parse().unwrap(), labeled(object))],
        ),
        (
            "objects".to_owned(),
            vec![Partition::new("box".parse().unwrap(), BTreeMap::new())],
        ),
        (
            FieldInfo::NAME.to_owned(),
            vec![Partition::new("box".parse().unwrap(), BTreeMap::new())],
        ),
    ]))
}

/// Makes the folder of an artifact that holds a table.
fn place(folder: &Path, key: &str) -> (PathBuf, Artifact) {
    let folder = folder.join(key);
    fs::create_dir_all(&folder).unwrap();
    let table = folder.join(lake::table::FILE);
    let artifact = Artifact {
        key: key.parse().unwrap(),
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
    let step = |image: u32| Step {
        image,
        time_s: f64::from(image) / 30.0,
        cameras_n: 1,
        bridged: false,
        keypoints_m,
    };
    Demonstration {
        sequence: "s".to_owned(),
        object: "box".to_owned(),
        subject: "p".to_owned(),
        hand: Side::Right,
        mirrored: false,
        start_reason: String::new(),
        end_reason: String::new(),
        rest: RestingPose {
            up_in_object: Vector3::z_axis(),
            height_m: BOX_HALF_M[2],
        },
        steps: (0..3).map(step).collect(),
    }
}

/// Retargets the demonstration, after its object's field was made.
fn run(config: &RetargetConfig, unit: &Unit, folder: &Path) -> Outcome<TrajectoryMetrics> {
    run_on(&demonstration(), config, unit, folder)
}

/// Retargets a demonstration, after its object's field was made.
fn run_on(
    shown: &Demonstration,
    config: &RetargetConfig,
    unit: &Unit,
    folder: &Path,
) -> Outcome<TrajectoryMetrics> {
    let (out, _) = place(folder, "out");
    let (path, artifact) = place(folder, "s");
    lake::table::write(&path, shown).unwrap();
    let mut artifacts = BTreeMap::from([("demonstrations".to_owned(), vec![artifact])]);
    if unit
        .reads
        .get("objects")
        .is_some_and(|keys| !keys.is_empty())
    {
        let (path, mut object) = place(folder, "box");
        let mesh = path.join(objects::MESH);
        let mut file = fs::File::create_new(&mesh).unwrap();
        let high = Point3::from(BOX_HALF_M);
        let cuboid = TriMesh::cuboid(-high, high);
        file.write_all(cuboid.to_obj().as_bytes()).unwrap();
        object.files = BTreeMap::from([(objects::MESH.to_owned(), mesh)]);
        let made = place(folder, "field").0;
        let cx = Context::detached(&"box".parse().unwrap(), 0, &made);
        let read = BTreeMap::from([("objects".to_owned(), vec![object.clone()])]);
        let outcome = DistanceFields::make(config, &Inputs::new(read, Vec::new()), &cx).unwrap();
        assert!(matches!(outcome, Outcome::Made(_)));
        let names = [lake::table::FILE, distance_fields::FIELD];
        let field = Artifact {
            key: "box".parse().unwrap(),
            labels: BTreeMap::new(),
            files: names.map(|name| (name.to_owned(), made.join(name))).into(),
        };
        artifacts.insert("objects".to_owned(), vec![object]);
        artifacts.insert(FieldInfo::NAME.to_owned(), vec![field]);
    }
    let inputs = Inputs::new(artifacts, unit.files.clone());
    Trajectories::make(
        config,
        &inputs,
        &Context::detached(&"s".parse().unwrap(), 0, &out),
    )
    .unwrap()
}

#[test]
fn a_demonstration_becomes_a_trajectory() {
    let folder = tempfile::tempdir().unwrap();
    let config = config();
    Retarget::prepare(&config).unwrap();
    let units = Trajectories::units(&config, &scope("box")).unwrap();
    let Outcome::Made(made) = run(&config, &units[0], folder.path()) else {
        panic!("nothing was made");
    };
    assert_eq!(units[0].labels.as_ref().unwrap()["object"], "box");
    assert_eq!(made.steps_n, 3.0);
    let (_, artifact) = place(folder.path(), "out");
    let trajectory: Trajectory = lake::table::read(&artifact).unwrap();
    let motion = &trajectory.motion;
    assert_eq!((motion.steps().len(), motion.joints().len()), (3, 16));
    assert_eq!(trajectory.object, "box");
    assert_eq!((trajectory.keypoints.len(), trajectory.tips.len()), (9, 4));
    let grasp = &trajectory.tracking[2];
    assert_eq!(grasp.keypoint_errors_m.len(), 9);
    assert_eq!(grasp.tip_errors_m, grasp.keypoint_errors_m[..4]);
    assert!(grasp.limit_margin_rad >= 0.0);
    let recording = folder.path().join("out").join(recording::FILE);
    let contents = lake::recording::read(&recording).unwrap();
    assert_eq!(contents.topic("/joint_states").count(), 3);
}

#[test]
fn a_demonstration_without_its_object_is_skipped() {
    let folder = tempfile::tempdir().unwrap();
    let config = config();
    let units = Trajectories::units(&config, &scope("bottle")).unwrap();
    let outcome = run(&config, &units[0], folder.path());
    assert!(matches!(outcome, Outcome::Skipped { reason } if reason.contains("`box`")));
}

#[test]
fn the_reach_of_the_other_hand_is_skipped() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = config();
    config.hand_table = with_table(folder.path(), "\"right\"", "\"left\"");
    let units = Trajectories::units(&config, &scope("box")).unwrap();
    let outcome = run(&config, &units[0], folder.path());
    let expected = "a right hand's reach, but the hand's file says that the robot's is a left hand";
    assert!(matches!(outcome, Outcome::Skipped { reason } if reason == expected));
}

#[test]
fn a_demonstration_whose_times_do_not_increase_is_skipped() {
    let folder = tempfile::tempdir().unwrap();
    let config = config();
    let units = Trajectories::units(&config, &scope("box")).unwrap();
    let mut shown = demonstration();
    shown.steps[2].time_s = shown.steps[1].time_s;
    let outcome = run_on(&shown, &config, &units[0], folder.path());
    assert!(matches!(outcome, Outcome::Skipped { reason } if reason.contains("step 2 is at")));
}

#[test]
fn non_finite_time_or_landmark_is_refused() {
    let mut shown = demonstration();
    let table = hand_files::load_table(TABLE.as_ref()).unwrap();
    assert_eq!(retargeted::unusable(&shown, &table), None);
    shown.steps[2].time_s = f64::INFINITY;
    let reason = retargeted::unusable(&shown, &table).unwrap();
    assert!(reason.contains("step 2 has a time"), "{reason}");
    let mut shown = demonstration();
    shown.steps[1].keypoints_m[7][2] = f64::NAN;
    let reason = retargeted::unusable(&shown, &table).unwrap();
    assert!(reason.contains("step 1"), "{reason}");
    // Its square is not a number.
    shown.steps[1].keypoints_m[7][2] = 1e200;
    assert_eq!(retargeted::unusable(&shown, &table), Some(reason));
}

/// Writes the Allegro hand table with a part of it replaced.
fn with_table(folder: &Path, from: &str, to: &str) -> PathBuf {
    let text = fs::read_to_string(TABLE).unwrap();
    assert!(text.contains(from));
    let path = folder.join("hand.toml");
    fs::write(&path, text.replacen(from, to, 1)).unwrap();
    path
}

/// An error with its causes.
fn whole(err: &BoxedDiagnostic) -> String {
    let mut text = err.to_string();
    let mut cause = err.source();
    while let Some(err) = cause {
        text = format!("{text}: {err}");
        cause = err.source();
    }
    text
}

#[test]
fn a_missing_link_is_named_with_the_files_and_near_names() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = config();
    config.hand_table = with_table(folder.path(), "link_15.0_tip", "link_15.0_top");
    let err = Retarget::prepare(&config).unwrap_err();
    let message = whole(&err);
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
fn value_in_place_of_a_table_is_refused_with_its_line() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = config();
    config.hand_table = with_table(folder.path(), "scale =", "size =");
    let err = Retarget::prepare(&config).unwrap_err();
    let message = whole(&err);
    assert!(
        message.contains("hand.toml") && message.contains("`size`"),
        "{message}"
    );
    assert!(err.hint().unwrap().contains("doctor --robot"));
    config.hand_table = with_table(folder.path(), "thumb_tip", "thumb_top");
    let message = whole(&Retarget::prepare(&config).unwrap_err());
    assert!(
        message.contains("`thumb_top`") && message.contains("thumb_tip"),
        "{message}"
    );
}

#[test]
fn a_fixed_wrist_needs_points_on_the_palm() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = config();
    config.retargeting.wrist = Wrist::Fixed;
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
fn invalid_options_are_refused() {
    let refused = |change: fn(&mut RetargetConfig)| {
        let mut config = config();
        change(&mut config);
        Retarget::check(&config)[0].to_string()
    };
    assert_eq!(Retarget::check(&config()), []);
    assert!(refused(|c| c.retargeting.smooth_l1_beta_m = 0.0).contains("`smooth_l1_beta_m`"));
    assert!(refused(|c| c.field_spacing_m = 0.0).contains("`field_spacing_m`"));
    assert!(refused(|c| c.retargeting.object_weight = f64::NAN).contains("`object_weight`"));
    assert!(refused(|c| c.field_spacing_m = 5.0).contains("`field_spacing_m`"));
    assert!(refused(|c| c.retargeting.object_weight = 1e200).contains("`object_weight`"));
    assert!(refused(|c| c.retargeting.smoothing_s = -1.0).contains("`smoothing_s`"));
    assert!(refused(|c| c.field_spacing_m = 1e-9).contains("`field_spacing_m`"));
    assert!(refused(|c| c.retargeting.max_iterations = usize::MAX).contains("`max_iterations`"));
    assert!(refused(|c| c.retargeting.max_iterations = 0).contains("`max_iterations`"));
}

/// Writes a configuration of dex-retargeting for the Allegro hand.
fn configuration(folder: &Path, of_type: &str) -> PathBuf {
    let path = folder.join("allegro.yml");
    let text =
        format!("retargeting:\n  urdf_path: allegro_right.urdf\n{of_type}  low_pass_alpha: 1\n");
    fs::write(&path, text).unwrap();
    path
}

const POSITION: &str = "  type: position
  target_link_names: [ link_15.0_tip, link_3.0_tip, link_7.0_tip ]
  target_link_human_indices: [ 4, 8, 12 ]
  add_dummy_free_joint: True
";
const VECTOR: &str = "  type: vector
  target_origin_link_names: [ base_link, base_link, base_link ]
  target_task_link_names: [ link_15.0_tip, link_3.0_tip, link_7.0_tip ]
  target_link_human_indices: [ [ 0, 0, 0 ], [ 4, 8, 12 ] ]
";
const DEXPILOT: &str = "  type: DexPilot
  wrist_link_name: base_link
  finger_tip_link_names: [ link_15.0_tip, link_3.0_tip, link_7.0_tip ]
";

#[test]
fn objectives_of_dex_retargeting_make_trajectories() {
    for of_type in [POSITION, VECTOR, DEXPILOT] {
        let folder = tempfile::tempdir().unwrap();
        let mut config = config();
        config.dex_retargeting = Some(configuration(folder.path(), of_type));
        config.max_keypoint_error_m = 0.2;
        Retarget::prepare(&config).unwrap();
        let units = Trajectories::units(&config, &scope("box")).unwrap();
        let Outcome::Made(made) = run(&config, &units[0], folder.path()) else {
            panic!("nothing was made of {of_type}");
        };
        assert_eq!(made.steps_n, 3.0);
        let (_, artifact) = place(folder.path(), "out");
        let trajectory: Trajectory = lake::table::read(&artifact).unwrap();
        assert_eq!((trajectory.keypoints.len(), trajectory.tips.len()), (9, 4));
        let model = robot_meshes::load(URDF.as_ref()).unwrap().model;
        assert_eq!(&trajectory.motion.joints()[..], model.joint_names());
        for (step, tracking) in trajectory.motion.steps().iter().zip(&trajectory.tracking) {
            assert_eq!(tracking.keypoint_errors_m.len(), 9);
            for (q, joint) in step.q_rad.iter().zip(model.joints()) {
                assert!((joint.lower..=joint.upper).contains(q), "{}", joint.name);
            }
        }
        if of_type != POSITION {
            // The palm is at the person's wrist, z to the middle finger.
            let palm = trajectory.motion.grasp().frame_from_palm;
            let [wrist, middle] = [0, 9].map(|idx| demonstration().steps[2].keypoints_m[idx]);
            let way = (Point3::from(middle) - Point3::from(wrist)).normalize();
            assert!((palm.translation.vector - Vector3::from(wrist)).norm() < 1e-9);
            assert!((palm.rotation * Vector3::z() - way).norm() < 1e-9);
        }
    }
}

#[test]
fn a_configuration_that_cannot_be_used_is_refused_before_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |of_type: &str, parts: [&str; 2]| {
        let mut config = config();
        config.dex_retargeting = Some(configuration(folder.path(), of_type));
        let err = Retarget::prepare(&config).unwrap_err();
        let message = whole(&err);
        assert!(message.contains("allegro.yml"), "{message}");
        assert!(message.contains(parts[0]), "{message}");
        let hint = err.hint().unwrap();
        assert!(hint.contains(parts[1]), "{hint}");
    };
    let misspelled = VECTOR.replace("target_task_", "target_tasks_");
    refused(
        &misspelled,
        ["target_tasks_link_names", "`target_task_link_names`"],
    );
    refused(
        &VECTOR.replace("link_3.0_tip", "link_3_tip"),
        ["`link_3_tip`", "`link_3.0_tip`"],
    );
    let mut config = config();
    config.dex_retargeting = Some(folder.path().join("nowhere.yml"));
    let err = Retarget::prepare(&config).unwrap_err();
    assert!(err.to_string().contains("nowhere.yml"), "{err}");
}
