//! The stage `ingest` on a made-up dataset with a known answer, and on real recordings.

mod labels;
mod real;
mod rig;

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use dataflow::{Advise, Artifact, Context, Inputs, Made, Outcome, Partition, Scope, Stage, Unit};
use rig::{FIRST, IMAGES, LAST, OBJECT, Rig};
use schemas::demonstrations::Demonstration;
use stage_ingest::{Hand, Ingest, IngestConfig, IngestError};
use tempfile::TempDir;

fn config(root: &Path) -> IngestConfig {
    IngestConfig {
        root: root.to_owned(),
        hand: Hand::Right,
        rate_hz: 30.0,
        move_threshold_m: 0.004,
        move_threshold_rad: 0.07,
        jitter_factor: 4.0,
        settle_n: 5,
        max_gap_n: 3,
        min_steps_n: 11,
        points_n: 500,
        max_convex_parts_n: 16,
        masses_kg: BTreeMap::new(),
    }
}

fn dataset(rig: &Rig) -> TempDir {
    let root = tempfile::tempdir().unwrap();
    rig.write(root.path());
    root
}

fn units(config: &IngestConfig) -> Vec<Unit> {
    Ingest::units(config, "demonstrations", &Scope::default()).unwrap()
}

/// Makes a unit in `folder`, reading `artifacts`.
fn run(
    config: &IngestConfig,
    output: &str,
    unit: &Unit,
    artifacts: BTreeMap<String, Vec<Artifact>>,
    folder: &Path,
) -> Result<Outcome, IngestError> {
    let inputs = Inputs::new(artifacts, unit.files.clone());
    let cx = Context::detached(output, &unit.partition, 7, folder);
    Ingest::run(config, &inputs, &cx)
}

fn artifact(key: &str, made: &Made, folder: &Path) -> Artifact {
    let file = |name: &str| (name.to_owned(), folder.join(name));
    Artifact {
        key: key.to_owned(),
        labels: made.labels.clone(),
        files: BTreeMap::from([file("part.parquet"), file("mesh.obj")]),
    }
}

/// Makes the demonstration of a unit and reads it back.
fn demonstration(config: &IngestConfig, unit: &Unit) -> Result<(Demonstration, Made), Outcome> {
    let folder = tempfile::tempdir().unwrap();
    match run(
        config,
        "demonstrations",
        unit,
        BTreeMap::new(),
        folder.path(),
    )
    .unwrap()
    {
        Outcome::Made(made) => {
            let artifact = artifact(&unit.partition, &made, folder.path());
            let batch = lake::table::read(&artifact).unwrap();
            let demonstration =
                schemas::demonstrations::from_batch(&unit.partition, &batch).unwrap();
            let film = lake::recording::read(&folder.path().join("demonstration.mcap")).unwrap();
            for topic in ["/tf", "/hand"] {
                assert_eq!(
                    film.topic(topic).count(),
                    demonstration.steps.len(),
                    "{topic}"
                );
            }
            assert_eq!(film.topic("/markers").count(), 1);
            Ok((demonstration, made))
        }
        other => Err(other),
    }
}

/// Returns why the only recording of the dataset is skipped.
fn reason(root: &Path) -> String {
    let config = config(root);
    match demonstration(&config, &units(&config)[0]) {
        Err(Outcome::Skipped { reason }) => reason,
        other => panic!("not skipped: {other:?}"),
    }
}

fn assert_known_answer(demonstration: &Demonstration) {
    assert_eq!(demonstration.object, OBJECT.0);
    assert_eq!(demonstration.subject, "20200709-subject-01");
    assert_eq!(demonstration.steps.len(), LAST - FIRST + 1);
    for (step, image) in demonstration.steps.iter().zip(FIRST..) {
        assert_eq!(step.image as usize, image);
        assert!((step.time_s - (image - FIRST) as f64 / 30.0).abs() < 1e-12);
        for (k, point) in step.keypoints_m.iter().enumerate() {
            let expected = Rig::keypoint(image, k);
            let error_m = (expected - nalgebra::Point3::from(*point)).norm();
            assert!(error_m < 1e-6, "{error_m} m at image {image}, landmark {k}");
        }
    }
    // Turned by a quarter about x, the object's y is up.
    let up = demonstration.rest.up_in_object;
    assert!(up.angle(&nalgebra::Vector3::y_axis()) < 1e-5, "{up:?}");
    assert!((demonstration.rest.height_m - 0.04).abs() < 1e-6);
}

#[test]
fn finds_the_known_reach_through_two_turned_cameras() {
    let root = dataset(&Rig::default());
    let config = config(root.path());
    Ingest::prepare(&config).unwrap();
    let units = units(&config);
    assert_eq!(units.len(), 1);
    assert_eq!(units[0].partition, "20200709-subject-01-20200709_141754");
    assert_eq!(units[0].files.len(), 2 * IMAGES + 4);
    assert!(
        units[0]
            .files
            .iter()
            .all(|file| !file.name.starts_with('/'))
    );
    let (demonstration, made) = demonstration(&config, &units[0]).unwrap();
    assert_known_answer(&demonstration);
    assert_eq!(made.labels["object"], OBJECT.0);
    assert_eq!(made.labels["subject"], "20200709-subject-01");
}

#[test]
fn finds_the_same_reach_where_only_pose_npz_has_the_object() {
    let root = dataset(&Rig {
        labels_show_object: false,
        ..Rig::default()
    });
    let config = config(root.path());
    let (demonstration, _) = demonstration(&config, &units(&config)[0]).unwrap();
    assert_known_answer(&demonstration);
}

#[test]
fn jitter_of_a_resting_object_moves_neither_edge_nor_hand() {
    let root = dataset(&Rig {
        jitter_m: 0.002,
        ..Rig::default()
    });
    let config = config(root.path());
    let (demonstration, _) = demonstration(&config, &units(&config)[0]).unwrap();
    let last = demonstration.steps.last().unwrap();
    assert!((LAST - 1..=LAST + 1).contains(&(last.image as usize)));
    // Every landmark is off by the one error of the rest, which is less than the jitter.
    let error = |image: usize| {
        let step = &demonstration.steps[image - FIRST];
        Rig::keypoint(image, 4) - nalgebra::Point3::from(step.keypoints_m[4])
    };
    assert!(error(FIRST).norm() < 0.001, "{}", error(FIRST).norm());
    assert!((error(FIRST) - error(LAST - 1)).norm() < 1e-6);
}

#[test]
fn gaps_are_bridged_up_to_the_limit() {
    let root = dataset(&Rig {
        hidden: vec![12, 13, 14],
        ..Rig::default()
    });
    let config = config(root.path());
    let (demonstration, _) = demonstration(&config, &units(&config)[0]).unwrap();
    // The made-up hand moves evenly, so that interpolation meets it.
    assert_known_answer(&demonstration);
    let root = dataset(&Rig {
        hidden: vec![12, 13, 14, 15],
        ..Rig::default()
    });
    assert_eq!(
        reason(root.path()),
        "no hand in 4 images from image 12 on, more than the 3 that are bridged"
    );
}

#[test]
fn left_hands_are_filtered_without_reading_labels() {
    let root = dataset(&Rig {
        side: "left",
        ..Rig::default()
    });
    fs::write(Rig::label(root.path(), 5), "damaged").unwrap();
    let config = config(root.path());
    match demonstration(&config, &units(&config)[0]) {
        Err(Outcome::Filtered { reason }) => {
            assert_eq!(reason, "left hand, `hand` asks for right");
        }
        other => panic!("not filtered: {other:?}"),
    }
}

#[test]
fn damaged_files_are_skipped_with_their_name_and_the_reason() {
    let check = |change: &dyn Fn(&Path), expected: &[&str]| {
        let root = dataset(&Rig::default());
        change(root.path());
        let reason = reason(root.path());
        for part in expected {
            assert!(reason.contains(part), "`{reason}` lacks `{part}`");
        }
    };
    let joints = vec![0.1; 63];
    let label = |root: &Path| Rig::label(root, 5);
    let name = "836212060125/labels_000005.npz";
    check(
        &|root| {
            let bytes = fs::read(label(root)).unwrap();
            fs::write(label(root), &bytes[..bytes.len() / 2]).unwrap();
        },
        &["damaged archive", name],
    );
    check(
        &|root| fs::write(label(root), "").unwrap(),
        &["damaged archive", name],
    );
    check(
        &|root| rig::npz(&label(root), &[("pose_y", &[2, 3, 4], &[0.0; 24])]),
        &["no array `joint_3d`", name],
    );
    check(
        &|root| rig::npz(&label(root), &[("joint_3d", &[21, 3], &joints)]),
        &["shape [21, 3], expected [1, 21, 3]", name],
    );
    let mut with_nan = joints.clone();
    with_nan[7] = f32::NAN;
    check(
        &|root| rig::npz(&label(root), &[("joint_3d", &[1, 21, 3], &with_nan)]),
        &["`joint_3d` holds a number that is not finite", name],
    );
    check(
        &|root| {
            let arrays: [(&str, &[u64], &[f32]); 2] = [
                ("joint_3d", &[1, 21, 3], &joints),
                ("pose_y", &[2, 3, 4], &[1.0; 24]),
            ];
            rig::npz(&label(root), &arrays);
        },
        &["`pose_y` is not a rotation", name],
    );
    let sequence = |root: &Path, name: &str| Rig::sequence(root).join(name);
    check(
        &|root| fs::write(sequence(root, "meta.yml"), "serials: [").unwrap(),
        &["meta.yml`: "],
    );
    check(
        &|root| fs::write(sequence(root, "meta.yml"), [0xff, 0xfe]).unwrap(),
        &["meta.yml`: not UTF-8"],
    );
    check(
        &|root| fs::remove_file(sequence(root, "meta.yml")).unwrap(),
        &["no `meta.yml`"],
    );
    check(
        &|root| fs::remove_dir_all(root.join("calibration")).unwrap(),
        &["no `calibration/extrinsics_20200702_151821/extrinsics.yml`"],
    );
    check(
        &|root| {
            for camera in ["836212060125", "839512060362"] {
                fs::remove_dir_all(sequence(root, camera)).unwrap();
            }
        },
        &["no camera has `labels_*.npz` files"],
    );
}

#[test]
fn a_calibration_without_the_tag_or_a_camera_is_named() {
    let identity = "[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]";
    let check = |lines: String, expected: &str| {
        let root = dataset(&Rig {
            calibration: Some(lines),
            ..Rig::default()
        });
        let reason = reason(root.path());
        assert!(reason.contains(expected), "`{reason}` lacks `{expected}`");
    };
    let cameras = format!("  '836212060125': {identity}\n  '839512060362': {identity}\n");
    check(cameras, "no pose of `apriltag`");
    check(
        format!("  apriltag: {identity}\n"),
        "no pose of `836212060125`",
    );
    check(
        format!("  '836212060125': [1, 2, 3]\n  apriltag: {identity}\n"),
        "extrinsics.yml`: ",
    );
}

#[test]
fn a_folder_without_sequences_is_refused_with_the_way_out() {
    for root in [
        PathBuf::from("no/such/folder"),
        tempfile::tempdir().unwrap().keep(),
    ] {
        let err = Ingest::prepare(&config(&root)).unwrap_err();
        let shown = root.display();
        assert_eq!(
            err.to_string(),
            format!("no DexYCB sequences under `{shown}`")
        );
        assert_eq!(
            err.hint().unwrap(),
            format!(
                "unpack the dataset so that `{shown}/20200709-subject-01` exists, or try the \
                 bundled sample: `pipeline run pipelines/cgf.toml`"
            )
        );
        let _ = fs::remove_dir(&root);
    }
}

#[test]
fn an_option_that_makes_no_sense_is_named() {
    let root = dataset(&Rig::default());
    let mut config = config(root.path());
    config.rate_hz = 0.0;
    let err = Ingest::prepare(&config).unwrap_err();
    assert_eq!(err.to_string(), "`rate_hz` must be positive, found 0");
}

#[test]
fn the_object_has_its_mesh_mass_and_the_rest_in_which_it_lay() {
    let root = dataset(&Rig::default());
    let config = config(root.path());
    let unit = &units(&config)[0];
    let folder = tempfile::tempdir().unwrap();
    let Outcome::Made(made) = run(
        &config,
        "demonstrations",
        unit,
        BTreeMap::new(),
        folder.path(),
    )
    .unwrap() else {
        panic!("not made");
    };
    let scope = Scope::new(BTreeMap::from([(
        "demonstrations".to_owned(),
        vec![Partition::new(unit.partition.clone(), made.labels.clone())],
    )]));
    let units = Ingest::units(&config, "objects", &scope).unwrap();
    assert_eq!(units.len(), 1);
    assert_eq!(units[0].partition, OBJECT.0);
    assert_eq!(units[0].reads["demonstrations"], [unit.partition.as_str()]);
    let read = BTreeMap::from([(
        "demonstrations".to_owned(),
        vec![artifact(&unit.partition, &made, folder.path())],
    )]);
    let object_folder = tempfile::tempdir().unwrap();
    let outcome = run(&config, "objects", &units[0], read, object_folder.path()).unwrap();
    let Outcome::Made(made) = outcome else {
        panic!("not made: {outcome:?}");
    };
    let artifact = artifact(OBJECT.0, &made, object_folder.path());
    let batch = lake::table::read(&artifact).unwrap();
    let object = schemas::objects::from_batch(OBJECT.0, &batch).unwrap();
    assert!((object.mass_kg - 0.187).abs() < 1e-12);
    assert_eq!(object.points_m.len(), 500);
    assert_eq!(object.parts_m.len(), 1);
    let rest = &object.rests[0];
    assert_eq!(rest.seen_n, 1);
    assert!(rest.rest.up_in_object.angle(&nalgebra::Vector3::y_axis()) < 1e-6);
    assert!((rest.rest.height_m - 0.04).abs() < 1e-9);
    assert!(
        fs::read_to_string(artifact.file("mesh.obj").unwrap())
            .unwrap()
            .starts_with("v ")
    );
}

#[test]
fn an_object_of_unknown_mass_is_refused_with_the_way_out() {
    let root = dataset(&Rig::default());
    let mut config = config(root.path());
    let scope = Scope::new(BTreeMap::from([(
        "demonstrations".to_owned(),
        vec![Partition::new(
            "a-b",
            BTreeMap::from([("object".to_owned(), "teapot".to_owned())]),
        )],
    )]));
    let err = Ingest::units(&config, "objects", &scope).unwrap_err();
    assert_eq!(err.to_string(), "the mass of `teapot` is not known");
    assert!(err.hint().unwrap().contains("`[stages.ingest.masses_kg]`"));
    config.masses_kg.insert("teapot".to_owned(), 0.6);
    assert!(Ingest::units(&config, "objects", &scope).is_ok());
}
