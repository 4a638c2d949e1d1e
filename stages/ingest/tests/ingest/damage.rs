//! Damaged and missing files of a recording: each is named with what is wrong.

use std::{fs, path::Path};

use stage_ingest::IngestError;

use crate::{
    bench::{Bench, config},
    dataset, make,
    rig::{self, Rig},
};

/// Asserts that a change makes the recording be skipped, with all of these in the reason; the only
/// recording, if it does not say what it is about, is refused for the same reason.
fn check(change: &dyn Fn(&Path), expected: &[&str]) {
    let root = dataset(&Rig {
        cameras: 2,
        ..Rig::default()
    });
    change(root.path());
    let reason = match Bench::until(config(root.path()), "demonstrations") {
        Ok(bench) => {
            let (word, reason) = bench.reason();
            assert_eq!(word, "skipped");
            reason
        }
        Err(err) => match err.downcast_ref() {
            Some(IngestError::NoneTold { found: 1, source }) => source.to_string(),
            _ => panic!("{err}"),
        },
    };
    for part in expected {
        assert!(reason.contains(part), "`{reason}` lacks `{part}`");
    }
}

fn label(root: &Path) -> std::path::PathBuf {
    Rig::label(root, 5)
}

fn sequence(root: &Path, name: &str) -> std::path::PathBuf {
    Rig::sequence(root).join(name)
}

const NAME: &str = "836212060125/labels_000005.npz";

#[test]
fn labels() {
    let joints = vec![0.1; 63];
    check(
        &|root| {
            let bytes = fs::read(label(root)).unwrap();
            fs::write(label(root), &bytes[..bytes.len() / 2]).unwrap();
        },
        &["damaged archive", NAME],
    );
    check(
        &|root| fs::write(label(root), "").unwrap(),
        &["damaged archive", NAME],
    );
    check(
        &|root| rig::npz(&label(root), &[("pose_y", &[3, 3, 4], &[0.0; 36])]),
        &["no array `joint_3d`", NAME],
    );
    check(
        &|root| rig::npz(&label(root), &[("joint_3d", &[21, 3], &joints)]),
        &["shape [21, 3], expected [1, 21, 3]", NAME],
    );
    let mut with_nan = joints.clone();
    with_nan[7] = f32::NAN;
    check(
        &|root| rig::npz(&label(root), &[("joint_3d", &[1, 21, 3], &with_nan)]),
        &[
            "`joint_3d` is NaN at [0, 2, 1], expected a finite number",
            NAME,
        ],
    );
    let with_poses = |root: &Path, objects: u64, poses: &[f32]| {
        let arrays: [(&str, &[u64], &[f32]); 2] = [
            ("joint_3d", &[1, 21, 3], &joints),
            ("pose_y", &[objects, 3, 4], poses),
        ];
        rig::npz(&label(root), &arrays);
    };
    check(
        &|root| with_poses(root, 3, &[1.0; 36]),
        &["`pose_y` is not a rotation", NAME],
    );
    check(
        &|root| with_poses(root, 2, &[0.0; 24]),
        &["`pose_y` has shape [2, 3, 4], expected [3, 3, 4]", NAME],
    );
}

#[test]
fn poses() {
    let images = rig::IMAGES as u64;
    let with_poses = |pose: [f32; 7]| {
        move |root: &Path| {
            let poses: Vec<f32> = (0..3 * images).flat_map(|_| pose).collect();
            let path = sequence(root, "pose.npz");
            rig::npz(&path, &[("pose_y", &[images, 3, 7], &poses)]);
        }
    };
    check(
        &with_poses([0.0, 0.0, 0.0, 2.0, 0.1, 0.1, 0.1]),
        &[
            "`pose_y`: quaternion",
            "has length 2, expected 1",
            "pose.npz",
        ],
    );
    check(
        &with_poses([0.0, 0.0, 0.0, 1.0, f32::NAN, 0.1, 0.1]),
        &[
            "`pose_y` is NaN at [0, 0, 4], expected a finite number",
            "pose.npz",
        ],
    );
    // Another object than that of the labels, or one that is somewhere else.
    check(
        &with_poses([0.0, 0.0, 0.0, 1.0, 5.0, 0.1, 0.1]),
        &["`pose_y` of the labels is", "pose.npz"],
    );
    check(
        &|root| fs::write(sequence(root, "pose.npz"), "PK").unwrap(),
        &["damaged archive", "pose.npz"],
    );
}

#[test]
fn a_grasped_object_that_is_not_the_one_that_moves() {
    check(
        &|root| {
            let path = sequence(root, "meta.yml");
            let text = fs::read_to_string(&path).unwrap();
            fs::write(&path, text.replace("ycb_grasp_ind: 1", "ycb_grasp_ind: 0")).unwrap();
        },
        &["the object never moves"],
    );
}

#[test]
fn unreadable_recordings_are_named_with_the_fault() {
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
    let meta = |from: &'static str, to: &'static str| {
        move |root: &Path| {
            let path = sequence(root, "meta.yml");
            let text = fs::read_to_string(&path).unwrap();
            assert!(text.contains(from));
            fs::write(&path, text.replace(from, to)).unwrap();
        }
    };
    check(
        &meta("ycb_grasp_ind: 1", "ycb_grasp_ind: 3"),
        &["`ycb_grasp_ind` is 3, but there are 3 objects"],
    );
    check(
        &meta("ycb_ids: [2, 7, 4]", "ycb_ids: [2, 77, 4]"),
        &["object 77 has no name"],
    );
    check(
        &meta("num_frames: 40", "num_frames: 4000000000"),
        &["`num_frames` is 4000000000, more than 10800"],
    );
    check(
        &meta("num_frames: 40", "num_frames: 41"),
        &[
            "`pose_y` has shape [40, 3, 7], expected [41, 3, 7]",
            "pose.npz",
        ],
    );
    check(
        &meta("- '839512060362'", "- '839512060362'\n- '836212060125'"),
        &["`serials` has `836212060125` twice", "meta.yml"],
    );
    check(
        &meta("mano_sides: [right]", "mano_sides: [both]"),
        &["`mano_sides` is [\"both\"]"],
    );
}

#[test]
fn cameras_and_calibration() {
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
        &["no camera has label files"],
    );
    let identity = "[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]";
    let calibrated = |lines: String, expected: &str| {
        let (_, reason) = make(&Rig {
            cameras: 2,
            calibration: Some(lines),
            ..Rig::default()
        })
        .reason();
        assert!(reason.contains(expected), "`{reason}` lacks `{expected}`");
    };
    calibrated(
        format!("  apriltag: {identity}\n"),
        "no pose of `836212060125`",
    );
    calibrated(
        format!("  '836212060125': [1, 2, 3]\n  apriltag: {identity}\n"),
        "extrinsics.yml`: ",
    );
    let mirrored = "[-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]";
    calibrated(
        format!("  '836212060125': {mirrored}\n  '839512060362': {identity}\n"),
        "`836212060125` is not a rotation and a translation",
    );
}

#[test]
fn result_is_unchanged_without_one_camera() {
    let root = dataset(&Rig::default());
    fs::remove_dir_all(sequence(root.path(), "840412060917")).unwrap();
    // Nor are single images of another.
    fs::remove_file(label(root.path())).unwrap();
    crate::assert_known_answer(&Bench::new(config(root.path())).only());
}

#[cfg(unix)]
#[test]
fn a_recording_in_a_folder_that_cannot_be_named_is_skipped_with_the_reason() {
    use std::{ffi::OsStr, os::unix::ffi::OsStrExt as _};
    let root = dataset(&Rig {
        cameras: 1,
        ..Rig::default()
    });
    let subject = Rig::sequence(root.path()).parent().unwrap().to_owned();
    let strange = subject.join(OsStr::from_bytes(b"20200709_\xff41754"));
    fs::rename(Rig::sequence(root.path()), strange).unwrap();
    let mut config = config(root.path());
    // An object of the pipeline file, so that there is something to make.
    config.meshes.insert(
        "brick".to_owned(),
        stage_ingest::AddedMesh {
            file: root
                .path()
                .join("models/008_pudding_box/textured_simple.obj"),
            mass_kg: 0.2,
        },
    );
    let (word, reason) = Bench::new(config).reason();
    assert_eq!(word, "skipped");
    let name = "20200709-subject-01/20200709_\u{fffd}41754";
    assert_eq!(
        reason,
        format!("the name of `{name}` is not UTF-8: rename it")
    );
}

#[cfg(unix)]
#[test]
fn non_utf8_names_are_ignored() {
    use std::{ffi::OsStr, os::unix::ffi::OsStrExt as _};
    let root = dataset(&Rig {
        cameras: 2,
        ..Rig::default()
    });
    let strange = OsStr::from_bytes(b"color_\xff00001.jpg");
    let camera = sequence(root.path(), "836212060125");
    fs::write(camera.join(strange), "x").unwrap();
    fs::create_dir_all(
        root.path()
            .join(OsStr::from_bytes(b"subject-\xff"))
            .join("s"),
    )
    .unwrap();
    crate::assert_known_answer(&Bench::new(config(root.path())).only());
}
