//! The stage `ingest` on a made-up dataset with a known answer, and on real recordings.

mod bench;
mod damage;
mod hand_model;
mod hocap;
mod labels;
mod objects;
mod places;
mod real;
mod rig;
mod selection;
mod tracks;

use std::{fs, path::PathBuf};

use bench::{Bench, config};
use dataflow::Stage;
use rig::{FIRST, IMAGES, LAST, OBJECT, Quaternions, Rig};
use schemas::demonstrations::{Demonstration, Side};
use stage_ingest::{Ingest, IngestConfig, TableRule};
use tempfile::TempDir;

fn dataset(rig: &Rig) -> TempDir {
    let root = tempfile::tempdir().unwrap();
    rig.write(root.path());
    root
}

/// Makes what the rig recorded, with options changed from the usual ones.
fn make_with(rig: &Rig, change: impl FnOnce(&mut IngestConfig)) -> Bench {
    let root = dataset(rig);
    let mut config = config(root.path());
    change(&mut config);
    Bench::new(config)
}

fn make(rig: &Rig) -> Bench {
    make_with(rig, |_| {})
}

fn assert_known_answer(demonstration: &Demonstration) {
    assert_known_but_rest(demonstration);
    // Turned by a quarter about x, the object's y is up.
    let up = demonstration.rest.up_in_object;
    assert!(up.angle(&nalgebra::Vector3::y_axis()) < 1e-5, "{up:?}");
    assert!((demonstration.rest.height_m - 0.04).abs() < 1e-6);
}

fn assert_known_but_rest(demonstration: &Demonstration) {
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
}

#[test]
fn eight_turned_cameras_give_the_known_reach() {
    let bench = make(&Rig::default());
    let units = &bench.units["demonstrations"];
    assert_eq!(units.len(), 1);
    assert_eq!(units[0].partition, "20200709-subject-01-20200709_141754");
    assert_eq!(units[0].files.len(), 8 * IMAGES + 4);
    let is_local = |name: &str| !name.starts_with('/');
    assert!(units[0].files.iter().all(|file| is_local(&file.name)));
    let demonstration = bench.only();
    assert_known_answer(&demonstration);
    assert_eq!(
        (demonstration.hand, demonstration.mirrored),
        (Side::Right, false)
    );
    assert_eq!(
        demonstration.start_reason,
        "image 3 is the first that shows the hand"
    );
    assert_eq!(
        demonstration.end_reason,
        "in image 28 the object is 10.0 mm and 0.0 degrees from its rest"
    );
    let seen_by = |image: usize| demonstration.steps[image - FIRST].cameras_n;
    assert_eq!((seen_by(3), seen_by(5)), (5, 6));
    let (metrics, labels) = bench.made("demonstrations", &units[0].partition);
    assert_eq!(labels["object"], OBJECT.0);
    assert_eq!(labels["subject"], "20200709-subject-01");
    assert!(metrics["camera_spread_m"] < 1e-6);
    assert_eq!(metrics["disagreeing_labels_n"], 0.0);
    let shown = bench.path("demonstrations", &units[0].partition);
    let shown = lake::recording::read(&shown.join("demonstration.mcap")).unwrap();
    // It goes on after the grasp, so that one sees the object leave.
    for topic in ["/tf", "/hand"] {
        assert_eq!(shown.topic(topic).count(), IMAGES - FIRST);
    }
    assert_eq!(shown.topic("/markers").count(), 1);
}

#[test]
fn one_camera_two_cameras_and_a_master_that_is_the_world_give_the_same_reach() {
    for (cameras, turned_master) in [(1, true), (1, false), (2, true), (8, false)] {
        let rig = Rig {
            cameras,
            turned_master,
            ..Rig::default()
        };
        assert_known_answer(&make(&rig).only());
    }
}

#[test]
fn cameras_that_disagree_are_outvoted() {
    let bench = make(&Rig {
        wrong: vec![1, 4],
        ..Rig::default()
    });
    assert_known_answer(&bench.only());
    let (metrics, _) = bench.made(
        "demonstrations",
        &bench.units["demonstrations"][0].partition,
    );
    assert!(metrics["disagreeing_labels_n"] > 20.0);
    assert!(metrics["camera_spread_m"] < 1e-6);
}

#[test]
fn two_cameras_that_disagree_are_refused() {
    let bench = make(&Rig {
        cameras: 2,
        wrong: vec![1],
        ..Rig::default()
    });
    // In images 12 to 15 the second one looks away: the first is alone, and believed.
    let (word, reason) = bench.reason();
    assert_eq!(word, "skipped");
    assert!(reason.starts_with("no hand in "), "{reason}");
}

#[test]
fn only_pose_npz_has_the_object() {
    let bench = make(&Rig {
        labels_show_object: false,
        ..Rig::default()
    });
    assert_known_answer(&bench.only());
}

#[test]
fn without_a_tag_the_still_objects_say_where_the_table_is() {
    for tag in [true, false] {
        let rig = Rig {
            tag,
            ..Rig::default()
        };
        let bench = make_with(&rig, |config| {
            if tag {
                config.table = TableRule::Objects;
            }
        });
        let demonstration = bench.only();
        assert_known_but_rest(&demonstration);
        let up = demonstration.rest.up_in_object;
        assert!(up.angle(&nalgebra::Vector3::y_axis()) < 1e-3, "{up:?}");
        assert!((demonstration.rest.height_m - 0.04).abs() < 1e-4);
        let key = &bench.units["demonstrations"][0].partition;
        let (metrics, _) = bench.made("demonstrations", key);
        assert_eq!(metrics["table_objects_n"], 3.0);
        // Shapes of all three are made, and an object of the one that is grasped alone.
        assert_eq!(bench.units["shapes"].len(), 3);
        assert_eq!(bench.units["objects"].len(), 1);
    }
}

#[test]
fn swapped_quaternions_are_noticed_by_the_labels_or_by_the_table() {
    let reason = |labels_show_object: bool| {
        make(&Rig {
            quaternions: Quaternions::Wxyz,
            labels_show_object,
            ..Rig::default()
        })
        .reason()
    };
    let (word, reason_by_labels) = reason(true);
    assert_eq!(word, "skipped");
    assert!(
        reason_by_labels.contains("`pose_y` of the labels is"),
        "{reason_by_labels}"
    );
    let (_, reason_by_table) = reason(false);
    assert!(
        reason_by_table.contains("are quaternions x, y, z, w?"),
        "{reason_by_table}"
    );
}

#[test]
fn jitter_of_a_resting_object_moves_neither_edge_nor_hand() {
    let demonstration = make(&Rig {
        jitter_m: 0.002,
        ..Rig::default()
    })
    .only();
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
    let bench = make(&Rig {
        hidden: vec![12, 13, 14],
        ..Rig::default()
    });
    // The made-up hand moves evenly, so that interpolation meets it.
    assert_known_answer(&bench.only());
    let bridged = bench.only().steps.into_iter().filter(|step| step.bridged);
    let images: Vec<u32> = bridged.map(|step| step.image).collect();
    assert_eq!(images, [12, 13, 14]);
    let bench = make(&Rig {
        hidden: vec![12, 13, 14, 15],
        ..Rig::default()
    });
    let reason = "no hand in 4 images from image 12 on, more than the 3 that are bridged";
    assert_eq!(bench.reason(), ("skipped", reason.to_owned()));
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
        let expected = format!(
            "unpack the dataset so that `{shown}/20200709-subject-01` exists, or try the bundled \
             sample: `pipeline run pipelines/cgf.toml`"
        );
        let hint = err.hint().unwrap();
        let relative_to = hint.strip_prefix(&expected).unwrap();
        assert_eq!(relative_to.is_empty(), root.is_absolute(), "{hint}");
        let _ = fs::remove_dir(&root);
    }
}

#[test]
fn invalid_option_is_named() {
    let root = dataset(&Rig::default());
    let mut config = config(root.path());
    config.rate_hz = Some(0.0);
    let fault = Ingest::check(&config).remove(0).to_string();
    assert!(
        fault.starts_with("`rate_hz` is 0.0, and must be more than 0"),
        "{fault}"
    );
}
