//! Plain tracks: the same reach as through `DexYCB`'s layout.

use std::{error::Error, fs, path::Path};

use dataflow::{BoxedDiagnostic, Stage};
use spatial::{Object, Pose, World};
use stage_ingest::{Format, Ingest, IngestConfig, IngestError};

use crate::{
    bench::{Bench, config},
    rig::{self, FIRST, IMAGES, LAST, OBJECT, Rig, brick, rows},
};

/// Says what is wrong with the only recording, which does not say what it is about.
fn refused(config: &IngestConfig) -> String {
    let err = Ingest::prepare(config).unwrap_err();
    assert!(
        matches!(
            err.downcast_ref(),
            Some(IngestError::NoneTold { found: 1, .. })
        ),
        "{err}"
    );
    err.source().unwrap().to_string()
}

/// Writes the known recording as tracks.
pub(crate) fn tracks(root: &Path) {
    let folder = root.join("20200709-subject-01/first try");
    let model = root.join("models").join(OBJECT.0);
    for folder in [&folder, &model] {
        fs::create_dir_all(folder).unwrap();
    }
    fs::write(model.join("textured_simple.obj"), brick([0.1, 0.08, 0.03])).unwrap();
    fs::write(folder.join("track.yml"), about(IMAGES)).unwrap();
    let (mut hands, mut poses) = (Vec::new(), Vec::new());
    for image in 0..IMAGES {
        let world_from_object = Rig::world_from_tag() * Rig::tag_from_object(image);
        let resting = Rig::world_from_tag() * Rig::tag_from_object(LAST.min(image));
        for k in 0..21 {
            let point = <[f64; 3]>::from(resting * Rig::keypoint(image, k));
            hands.extend(point.map(|v| if image < FIRST { -1.0 } else { v as f32 }));
        }
        let pose = Pose::<World, Object>::new(world_from_object).to_array();
        poses.extend(pose.map(|v| v as f32));
    }
    rig::npz(
        &folder.join("track.npz"),
        &[
            ("keypoints_m", &[IMAGES as u64, 21, 3], &hands),
            ("world_from_object", &[IMAGES as u64, 7], &poses),
        ],
    );
}

/// The recording's `track.yml` with so many images.
fn about(images: usize) -> String {
    format!(
        "object: {}\nhand: right\nimages: {images}\ntable: {}\n",
        OBJECT.0,
        rows(&Rig::world_from_tag())
    )
}

#[test]
fn plain_tracks_give_the_known_reach() {
    let root = tempfile::tempdir().unwrap();
    tracks(root.path());
    let folder = root.path().join("20200709-subject-01/first try");
    let mut config = config(root.path());
    config.format = Format::Tracks;
    let bench = Bench::new(config.clone());
    crate::assert_known_answer(&bench.only());
    let key = &bench.units["demonstrations"][0].partition;
    assert_eq!(key, "20200709-subject-01-first_try");
    assert_eq!(bench.object("objects", OBJECT.0).rests[0].seen_n, 1);

    fs::write(folder.join("track.yml"), about(IMAGES + 1)).unwrap();
    let (word, reason) = Bench::new(config.clone()).reason();
    assert_eq!(word, "skipped");
    assert!(
        reason.contains("`keypoints_m` has shape [40, 21, 3], expected [41, 21, 3]"),
        "{reason}"
    );
    fs::write(folder.join("track.yml"), "object: [").unwrap();
    let reason = refused(&config);
    assert!(reason.contains("track.yml`: "), "{reason}");
    fs::write(folder.join("track.yml"), about(IMAGES) + "unit: inch\n").unwrap();
    let reason = refused(&config);
    assert!(
        reason.contains("unknown variant `inch`, expected one of m, cm, mm"),
        "{reason}"
    );
    // A name that would lead elsewhere.
    for name in ["../mug", "a/b", "''"] {
        let about = format!("object: {name}\nhand: right\nimages: 1\n");
        fs::write(folder.join("track.yml"), about).unwrap();
        let reason = refused(&config);
        assert!(reason.starts_with("`object` is `"), "{reason}");
    }

    fs::remove_file(folder.join("track.yml")).unwrap();
    let err = Ingest::prepare(&config).unwrap_err();
    assert!(
        err.to_string()
            .starts_with("no `SUBJECT/SEQUENCE/track.yml`")
    );
    assert!(err.hint().unwrap().contains("track.npz"));
}

/// Says why a description is refused.
fn untold(about: &str) -> String {
    let err = changed(about, "keypoints_m", 1.0).err().unwrap();
    assert!(
        matches!(err.downcast_ref(), Some(IngestError::NoneTold { .. })),
        "{err}"
    );
    err.source().unwrap().to_string()
}

#[test]
fn a_fault_in_a_description_is_told_with_file_and_line() {
    let good = format!(
        "object: {}\nhand: right\nimages: {IMAGES}\ntable_plane: {}\n",
        OBJECT.0,
        plane(1.0)
    );
    changed(&good, "keypoints_m", 1.0).unwrap().only();
    for (right, wrong, expected) in [
        ("table_plane:", "table_palne:", ["table_palne", "line 4"]),
        ("images:", "iamges:", ["iamges", "line 3"]),
        ("hand: right", "hand: Right", ["Right", "line 2"]),
        ("hand: right", "hand: right\nrate: 60", ["rate", "line 3"]),
        (
            "hand: right",
            "hand: right\nrate_hz: fast",
            ["floating point", "line 3"],
        ),
        (
            "hand: right",
            "hand: right\nrate_hz: 0",
            ["`rate_hz` is 0", "more than 0"],
        ),
        (
            "hand: right",
            "hand: right\nrate_hz: -30",
            ["`rate_hz` is -30", "more than 0"],
        ),
        (
            "hand: right",
            "hand: right\nrate_hz: .nan",
            ["`rate_hz` is NaN", "more than 0"],
        ),
    ] {
        let said = untold(&good.replace(right, wrong));
        assert!(said.contains("track.yml"), "{said}");
        for word in expected {
            assert!(said.contains(word), "{wrong}: {said}");
        }
    }
    let with = |table: &str| {
        let head = good.split("table_plane").next().unwrap();
        untold(&format!("{head}{table}\n"))
    };
    assert!(with("table_plane: [0, 0, 2, 0]").contains("not a direction of length 1"));
    assert!(with("table: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0]").contains("not a rotation"));
    let both = format!(
        "table: {}\ntable_plane: {}",
        rows(&Rig::world_from_tag()),
        plane(1.0)
    );
    assert!(with(&both).contains("one too many"));
}

#[test]
fn a_fault_in_a_description_is_not_hidden_by_a_selection() {
    let root = tempfile::tempdir().unwrap();
    tracks(root.path());
    let folder = root.path().join("20200709-subject-01/first try");
    fs::write(
        folder.join("track.yml"),
        about(IMAGES).replace("hand: right", "hand: Right"),
    )
    .unwrap();
    let mut config = config(root.path());
    config.format = Format::Tracks;
    let name = OBJECT.0.to_owned();
    let selections: [fn(&mut IngestConfig, String); 4] = [
        |config, name| {
            let _new = config.masses_kg.insert(name, 0.3);
        },
        |config, name| config.objects.push(name),
        |config, _| config.subjects.push("20200709-subject-01".to_owned()),
        |config, _| config.hand = schemas::demonstrations::Side::Left,
    ];
    for select in selections {
        let mut config = config.clone();
        select(&mut config, name.clone());
        let err = Ingest::prepare(&config).unwrap_err();
        let said = err.source().map(ToString::to_string).unwrap_or_default();
        assert!(
            said.contains("track.yml") && said.contains("Right"),
            "{err}: {said}"
        );
    }
}

#[test]
fn the_rate_stands_beside_the_recording_or_in_the_pipeline_file() {
    let with = |line: &str, given: Option<f64>| {
        let root = tempfile::tempdir().unwrap();
        tracks(root.path());
        let file = root.path().join("20200709-subject-01/first try/track.yml");
        fs::write(file, about(IMAGES) + line).unwrap();
        let mut config = config(root.path());
        config.format = Format::Tracks;
        config.rate_hz = given;
        Bench::until(config, "objects")
    };
    let last_s = |bench: Bench| bench.only().steps.last().unwrap().time_s;
    let at_30 = last_s(with("", None).unwrap());
    assert_eq!(last_s(with("rate_hz: 60\n", None).unwrap()), at_30 / 2.0);
    assert_eq!(last_s(with("", Some(60.0)).unwrap()), at_30 / 2.0);
    assert_eq!(
        last_s(with("rate_hz: 60\n", Some(60.0)).unwrap()),
        at_30 / 2.0
    );
    let err = with("rate_hz: 60\n", Some(30.0)).err().unwrap();
    let said = err.source().unwrap().to_string();
    assert!(
        said.contains("`rate_hz` is 60, and 30 in the pipeline file"),
        "{said}"
    );
}

#[test]
fn a_number_that_is_none_is_told_with_its_image_and_what_to_write() {
    let root = tempfile::tempdir().unwrap();
    tracks(root.path());
    let file = root.path().join("20200709-subject-01/first try/track.npz");
    let bytes = fs::read(&file).unwrap();
    let array = |name: &str, shape: &[u64]| -> Vec<f32> {
        let numbers = stage_ingest::read::npz(&bytes, name, shape).unwrap();
        numbers.into_iter().map(|number| number as f32).collect()
    };
    let (of_hands, of_poses) = ([IMAGES as u64, 21, 3], [IMAGES as u64, 7]);
    let hands = array("keypoints_m", &of_hands);
    let poses = array("world_from_object", &of_poses);
    let mut config = config(root.path());
    config.format = Format::Tracks;
    let reason = |hands: &[f32], poses: &[f32]| {
        rig::npz(
            &file,
            &[
                ("keypoints_m", &of_hands, hands),
                ("world_from_object", &of_poses, poses),
            ],
        );
        Bench::new(config.clone()).reason().1
    };
    let mut hidden = hands.clone();
    hidden[(20 * 21 + 8) * 3 + 2] = f32::NAN;
    let said = reason(&hidden, &poses);
    let expected = "`keypoints_m` is NaN in image 20, landmark 8: write -1 -1 -1";
    assert!(said.contains(expected), "{said}");
    let mut lost = poses.clone();
    lost[7 * 31 + 4] = f32::INFINITY;
    let said = reason(&hands, &lost);
    let expected = "`world_from_object` is inf in image 31: write seven times 0";
    assert!(said.contains(expected), "{said}");
}

/// Makes the known recording with another `track.yml`, and lengths of the tracks multiplied.
fn changed(about: &str, keypoints: &str, factor: f32) -> Result<Bench, BoxedDiagnostic> {
    let root = tempfile::tempdir().unwrap();
    tracks(root.path());
    let folder = root.path().join("20200709-subject-01/first try");
    let file = fs::read(folder.join("track.npz")).unwrap();
    let array = |name: &str, shape: &[u64]| -> Vec<f32> {
        let numbers = stage_ingest::read::npz(&file, name, shape).unwrap();
        numbers.into_iter().map(|number| number as f32).collect()
    };
    let mut hands = array("keypoints_m", &[IMAGES as u64, 21, 3]);
    for number in hands.iter_mut().filter(|number| **number != -1.0) {
        *number *= factor;
    }
    let mut poses = array("world_from_object", &[IMAGES as u64, 7]);
    for pose in poses.chunks_mut(7) {
        pose[..3].iter_mut().for_each(|length| *length *= factor);
    }
    rig::npz(
        &folder.join("track.npz"),
        &[
            (keypoints, &[IMAGES as u64, 21, 3], &hands),
            ("world_from_object", &[IMAGES as u64, 7], &poses),
        ],
    );
    fs::write(folder.join("track.yml"), about).unwrap();
    let mut config = config(root.path());
    config.format = Format::Tracks;
    Bench::until(config, "objects")
}

/// The table's direction up and its distance, in a unit of which a meter has `factor`.
fn plane(factor: f64) -> String {
    let table = Rig::world_from_tag();
    let up = table * nalgebra::Vector3::z();
    let distance = up.dot(&table.translation.vector) * factor;
    format!("[{:?}, {:?}, {:?}, {distance:?}]", up.x, up.y, up.z)
}

#[test]
fn a_plane_and_another_unit_give_the_same_reach() {
    let head = |rest: String| {
        format!(
            "object: {}\nhand: right\nimages: {IMAGES}\n{rest}",
            OBJECT.0
        )
    };
    for (unit, factor) in [("m", 1.0), ("cm", 100.0), ("mm", 1000.0)] {
        let about = head(format!("unit: {unit}\ntable_plane: {}\n", plane(factor)));
        let bench = changed(&about, &format!("keypoints_{unit}"), factor as f32);
        crate::assert_known_answer(&bench.unwrap().only());
    }
    let mut table = Rig::world_from_tag();
    table.translation.vector *= 1000.0;
    let about = head(format!("unit: mm\ntable: {}\n", rows(&table)));
    crate::assert_known_answer(&changed(&about, "keypoints_mm", 1000.0).unwrap().only());
}

#[test]
fn bad_tracks_end_with_a_reason() {
    let head = |rest: &str| {
        format!(
            "object: {}\nhand: right\nimages: {IMAGES}\n{rest}",
            OBJECT.0
        )
    };
    let skipped = |about: String, keypoints: &str, factor: f32, expected: &str| {
        let (word, reason) = changed(&about, keypoints, factor).unwrap().reason();
        assert_eq!(word, "skipped");
        assert!(reason.contains(expected), "{expected}: {reason}");
    };
    let table = format!("table_plane: {}\n", plane(1.0));
    // Millimeters that are taken for meters, with and without a table, and meters for millimeters.
    skipped(
        head(&table),
        "keypoints_m",
        1000.0,
        "m long, as no palm is: is `unit` right?",
    );
    skipped(
        head(""),
        "keypoints_m",
        1000.0,
        "m long, as no palm is: is `unit` right?",
    );
    skipped(
        head("unit: mm\n"),
        "keypoints_mm",
        1.0,
        "0.000 m long, as no palm is",
    );
    skipped(
        head("unit: mm\n"),
        "keypoints_m",
        1000.0,
        "no array `keypoints_mm`",
    );
    // No table: the object alone stands on any of its sides.
    skipped(head(""), "keypoints_m", 1.0, "only 1 of the still objects");
    let off = "table_plane: [0, 0, 1, 0.2]\n";
    skipped(head(off), "keypoints_m", 1.0, "mm from the table");
    let left = head(&table).replace("right", "left");
    let err = changed(&left, "keypoints_m", 1.0).err().unwrap();
    assert!(
        matches!(
            err.downcast_ref(),
            Some(IngestError::NoneChosen { found: 1, .. })
        ),
        "{err}"
    );
}
