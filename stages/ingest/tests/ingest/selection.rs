//! Selection of recordings.

use std::{fs, path::Path};

use dataflow::{Outcome, Output, Stage};
use schemas::demonstrations::Side;
use stage_ingest::{AddedMesh, Demonstrations, Ingest, IngestConfig, Split};
use tempfile::TempDir;

use crate::{
    bench::{Bench, config},
    dataset, make_with,
    rig::Rig,
};

/// Folders of the ten subjects, as the dataset names them.
const SUBJECTS: [&str; 10] = [
    "20200709-subject-01",
    "20200813-subject-02",
    "20200820-subject-03",
    "20200903-subject-04",
    "20200908-subject-05",
    "20200918-subject-06",
    "20200928-subject-07",
    "20201002-subject-08",
    "20201015-subject-09",
    "20201022-subject-10",
];

/// All 1,000 recordings as far as listing them needs: `meta.yml` alone, in the dataset's order.
fn listed() -> TempDir {
    let root = tempfile::tempdir().unwrap();
    for subject in SUBJECTS {
        for i in 0..100 {
            let id = match i / 5 {
                18 => 20,
                19 => 21,
                object => object + 1,
            };
            let side = if matches!(i % 5, 2 | 3) {
                "left"
            } else {
                "right"
            };
            let folder = root.path().join(subject).join(format!("{i:06}"));
            fs::create_dir_all(&folder).unwrap();
            let meta = format!(
                "serials: []\nnum_frames: 72\nextrinsics: x\nycb_ids: [{id}]\nycb_grasp_ind: 0\n\
                 mano_sides: [{side}]\nmano_calib: [x]\n"
            );
            fs::write(folder.join("meta.yml"), meta).unwrap();
        }
    }
    root
}

/// Recordings that are taken.
fn taken(root: &Path, change: impl FnOnce(&mut IngestConfig)) -> Vec<String> {
    let mut config = config(root);
    config.mirror = true;
    change(&mut config);
    let units = Demonstrations::units(&config, &dataflow::Scope::default()).unwrap();
    assert_eq!(units.len(), 1000);
    let taken = units.into_iter().filter(|unit| unit.facts.is_empty());
    taken.map(|unit| unit.partition).collect()
}

#[test]
fn the_splits_have_their_published_sizes() {
    let root = listed();
    let n = |split: Split| taken(root.path(), |config| config.split = split).len();
    let (train, val, test) = (n(Split::S0Train), n(Split::S0Val), n(Split::S0Test));
    assert_eq!((train, val, test), (800, 40, 160));
    let (train, val, test) = (n(Split::S1Train), n(Split::S1Val), n(Split::S1Test));
    assert_eq!((train, val, test), (700, 100, 200));
    let (train, val, test) = (n(Split::S3Train), n(Split::S3Val), n(Split::S3Test));
    assert_eq!((train, val, test), (750, 100, 150));
    assert_eq!((n(Split::All), n(Split::S2Train)), (1000, 1000));
    // 15 objects and 5, of 50 recordings each.
    assert_eq!((n(Split::PaperTrain), n(Split::PaperUnseen)), (750, 250));
}

#[test]
fn hand_subjects_and_objects_choose() {
    let root = listed();
    let right = taken(root.path(), |config| config.mirror = false);
    assert_eq!(right.len(), 600);
    let left = taken(root.path(), |config| {
        config.mirror = false;
        config.hand = Side::Left;
    });
    assert_eq!(left.len(), 400);
    let few = taken(root.path(), |config| {
        config.subjects = vec![SUBJECTS[3].to_owned()];
        config.objects = vec!["011_banana".to_owned(), "024_bowl".to_owned()];
    });
    assert_eq!(few.len(), 10);
    assert!(few.iter().all(|key| key.starts_with(SUBJECTS[3])));
}

#[test]
fn a_name_that_no_recording_has_is_refused_with_the_nearest() {
    let root = listed();
    let mut config = config(root.path());
    config.objects = vec!["025_mugg".to_owned()];
    let err = Ingest::prepare(&config).unwrap_err();
    assert_eq!(
        err.to_string(),
        "no recording has the name `025_mugg` of `objects`"
    );
    assert_eq!(err.hint().unwrap(), "did you mean `025_mug`?");
    config.objects.clear();
    config.subjects = vec!["alice".to_owned()];
    let err = Ingest::prepare(&config).unwrap_err();
    assert!(
        err.hint()
            .unwrap()
            .starts_with("there are: 20200709-subject-01, ")
    );
}

#[test]
fn a_split_by_trials_needs_all_of_them() {
    let root = listed();
    fs::remove_dir_all(root.path().join(SUBJECTS[0]).join("000003")).unwrap();
    let mut config = config(root.path());
    config.split = Split::S0Train;
    let err = Ingest::prepare(&config).unwrap_err().to_string();
    assert!(
        err.contains("there are 4 of `20200709-subject-01` with `002_master_chef_can`"),
        "{err}"
    );
    config.split = Split::S1Train;
    Ingest::prepare(&config).unwrap();
}

#[test]
fn filtered_recordings_are_not_read() {
    let root = dataset(&Rig {
        side: "left",
        ..Rig::default()
    });
    fs::write(Rig::label(root.path(), 5), "damaged").unwrap();
    let mut config = config(root.path());
    let err = Ingest::prepare(&config).unwrap_err();
    let expected = "the options leave out all 1 recordings: left hand (1)";
    assert_eq!(err.to_string(), expected);
    assert!(err.hint().unwrap().contains("`mirror = true`"));
    // An object of the user's own is enough to go on.
    let file = root.path().join("teapot.obj");
    fs::write(&file, crate::rig::brick([0.1, 0.1, 0.2])).unwrap();
    let teapot = AddedMesh { file, mass_kg: 0.6 };
    config.meshes.insert("teapot".to_owned(), teapot);
    let bench = Bench::new(config);
    assert_eq!(bench.reason(), ("filtered", "left hand".to_owned()));
    let files = &bench.units["demonstrations"][0].files;
    assert_eq!(files.len(), 1);
    assert!(files[0].name.ends_with("meta.yml"));
    assert_eq!(bench.units["shapes"][0].partition, "teapot");
    assert_eq!(bench.units["shapes"].len(), 1);
}

#[test]
fn a_split_by_cameras_reads_those_alone() {
    let check = |split: Split, expected: usize| {
        let bench = make_with(&Rig::default(), |config| config.split = split);
        let files = &bench.units["demonstrations"][0].files;
        let labels = files.iter().filter(|file| file.name.contains("/labels_"));
        assert_eq!(labels.count(), expected * crate::rig::IMAGES);
        bench
    };
    crate::assert_known_answer(&check(Split::S2Train, 6).only());
    // A camera alone loses the hand for four images now and then.
    for split in [Split::S2Val, Split::S2Test] {
        let (word, reason) = check(split, 1).reason();
        assert_eq!(word, "skipped");
        assert!(reason.starts_with("no hand in 4 images"), "{reason}");
    }
}

#[test]
fn a_left_hand_becomes_a_right_one_on_request() {
    let bench = make_with(
        &Rig {
            side: "left",
            ..Rig::default()
        },
        |config| config.mirror = true,
    );
    let demonstration = bench.only();
    assert!(demonstration.mirrored);
    assert_eq!(demonstration.hand, Side::Right);
    // Its box is its own mirror image in three planes through its middle: one coordinate changes
    // its sign, the same one in all landmarks and steps.
    let mirror = bench.object("shapes", crate::rig::OBJECT.0).mirror.unwrap();
    assert!(
        mirror.error_m < 1e-3 && mirror.offset_m.abs() < 1e-3,
        "{mirror:?}"
    );
    for step in &demonstration.steps {
        for (k, &point) in step.keypoints_m.iter().enumerate() {
            let recorded = Rig::keypoint(step.image as usize, k);
            let along = mirror.normal.dot(&recorded.coords);
            let expected = recorded - 2.0 * along * *mirror.normal;
            assert!((expected - nalgebra::Point3::from(point)).norm() < 2e-3);
        }
    }
    assert!(matches!(
        bench.outcomes[&("objects", crate::rig::OBJECT.0.to_owned())],
        Outcome::Labeled(..)
    ));
    // An object that is hardly its own mirror image has none.
    let bench = make_with(
        &Rig {
            side: "left",
            ..Rig::default()
        },
        |config| {
            config.mirror = true;
            config.max_mirror_error_m = 1e-12;
        },
    );
    let (_, reason) = bench.reason();
    assert!(reason.contains("from its mirror image"), "{reason}");
    assert!(
        reason.ends_with("the left hand cannot be mirrored"),
        "{reason}"
    );
}
