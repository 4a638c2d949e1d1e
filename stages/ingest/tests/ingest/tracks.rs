//! Plain tracks: the same reach as through `DexYCB`'s layout.

use std::{error::Error, fs, path::Path};

use dataflow::{Advise, Stage};
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
        matches!(err, IngestError::NoneTold { found: 1, .. }),
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
