//! The reader of label files alone.

use std::{fs, path::Path};

use dataflow::SourceFile;
use npyz::npz::NpzArchive;
use stage_ingest::{
    RecordingError,
    read::{LabelReader, Labels},
};

use crate::rig;

/// A label file's numbers: landmarks, then poses of two objects.
fn write(path: &Path, joints: &[f32; 63], poses: &[f32; 24]) -> SourceFile {
    rig::npz(
        path,
        &[
            ("joint_3d", &[1, 21, 3], joints),
            ("pose_y", &[2, 3, 4], poses),
        ],
    );
    source(path)
}

fn source(path: &Path) -> SourceFile {
    SourceFile::new("a/b/c/labels_000000.npz".to_owned(), path.to_owned())
}

fn read(file: &SourceFile, grasped: usize) -> Result<Labels, RecordingError> {
    LabelReader::new().read(file, 2, grasped)
}

const JOINTS: [f32; 63] = [0.1; 63];
/// The first object is not there, the second one turned by a quarter about z.
const POSES: [f32; 24] = [
    0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, //
    0.0, -1.0, 0.0, 0.1, 1.0, 0.0, 0.0, 0.2, 0.0, 0.0, 1.0, 0.3,
];

#[test]
fn missing_value_marks_become_none() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("labels.npz");
    let mut file = write(&path, &JOINTS, &POSES);
    assert_eq!(read(&file, 0).unwrap().camera_from_object, None);
    let labels = read(&file, 1).unwrap();
    let landmarks = labels.keypoints_in_camera.unwrap();
    assert!(landmarks.iter().all(|point| point.x == f64::from(0.1_f32)));
    let pose = labels.camera_from_object.unwrap();
    let turned = pose * nalgebra::Point3::new(1.0, 0.0, 0.0);
    assert!((turned - nalgebra::Point3::new(0.1, 1.2, 0.3)).norm() < 1e-7);
    file = write(&path, &[-1.0; 63], &POSES);
    assert_eq!(read(&file, 1).unwrap().keypoints_in_camera, None);
    // One number that is not a mark makes all of them numbers.
    let mut joints = [-1.0; 63];
    joints[62] = 0.5;
    let landmarks = read(&write(&path, &joints, &POSES), 1).unwrap();
    let landmarks = landmarks.keypoints_in_camera.unwrap();
    assert_eq!((landmarks[0].x, landmarks[20].z), (-1.0, 0.5));
}

#[test]
fn unreadable_file_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("labels.npz");
    let check = |file: &SourceFile, expected: &str| {
        let said = read(file, 1).unwrap_err().to_string();
        assert!(said.contains(expected), "`{said}` lacks `{expected}`");
        assert!(said.contains("`a/b/c/labels_000000.npz`"), "{said}");
    };
    check(&source(&path), "cannot read");
    check(&source(folder.path()), "cannot read");
    fs::write(&path, vec![0; (4 << 20) + 1]).unwrap();
    check(&source(&path), "has 4194305 bytes, more than the 4194304");
    fs::write(&path, vec![0; 4 << 20]).unwrap();
    check(&source(&path), "damaged archive");
    // An archive that is whole lies before what makes the file too large.
    let file = write(&path, &JOINTS, &POSES);
    let mut bytes = fs::read(&path).unwrap();
    bytes.resize(8 << 20, 0);
    fs::write(&path, bytes).unwrap();
    check(&file, "has 8388608 bytes");
    let mut stretched = POSES;
    stretched[13] = -1.5;
    check(
        &write(&path, &JOINTS, &stretched),
        "`pose_y` is not a rotation",
    );
    let mut not_finite = POSES;
    not_finite[0] = f32::NAN;
    check(
        &write(&path, &JOINTS, &not_finite),
        "expected a finite number",
    );
    let file = write(&path, &JOINTS, &POSES);
    let said = LabelReader::new().read(&file, 3, 1).unwrap_err();
    assert!(
        said.to_string()
            .contains("shape [2, 3, 4], expected [3, 3, 4]")
    );
}

#[test]
fn reader_keeps_no_state_between_files() {
    let folder = tempfile::tempdir().unwrap();
    let large = folder.path().join("large.npz");
    let file = write(&folder.path().join("labels.npz"), &JOINTS, &POSES);
    let mut bytes = fs::read(&file.path).unwrap();
    bytes.extend(vec![7; 1 << 20]);
    fs::write(&large, bytes).unwrap();
    let mut reader = LabelReader::new();
    let first = reader.read(&file, 2, 1).unwrap();
    assert!(reader.read(&source(&large), 2, 1).is_err());
    assert_eq!(reader.read(&file, 2, 1).unwrap(), first);
    fs::write(&large, "").unwrap();
    assert!(reader.read(&source(&large), 2, 1).is_err());
    assert_eq!(reader.read(&file, 2, 0).unwrap().camera_from_object, None);
}

/// Beside an independent reader, on every file of the real recordings that are there.
#[test]
fn landmarks_are_those_of_an_independent_reader() {
    for name in ["dexycb-right", "dexmv-mustard"] {
        let Some(root) = measured_data::folder(name) else {
            continue;
        };
        let mut reader = LabelReader::new();
        let mut n_files = 0;
        let mut folders = vec![root];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    folders.push(path);
                } else if path.to_string_lossy().contains("/labels_") {
                    // The independent reader is slow: every seventh file.
                    n_files += 1;
                    if n_files % 7 == 0 {
                        compare(&mut reader, &path);
                    }
                }
            }
        }
        assert!(n_files > 0);
    }
}

fn compare(reader: &mut LabelReader, path: &Path) {
    let name = path.display();
    let mut npz = NpzArchive::open(path).unwrap();
    let poses = npz.by_name("pose_y").unwrap().unwrap();
    let n_objects = poses.shape()[0] as usize;
    let poses: Vec<f32> = poses.into_vec().unwrap();
    let joints: Vec<f32> = npz
        .by_name("joint_3d")
        .unwrap()
        .unwrap()
        .into_vec()
        .unwrap();
    for grasped in 0..n_objects {
        let labels = reader.read(&source(path), n_objects, grasped).unwrap();
        match labels.keypoints_in_camera {
            Some(landmarks) => {
                let found = landmarks.iter().flat_map(|point| <[f64; 3]>::from(*point));
                assert!(
                    found.eq(joints.iter().map(|&number| f64::from(number))),
                    "{name}"
                );
            }
            None => assert!(joints.iter().all(|&number| number == -1.0), "{name}"),
        }
        let rows = &poses[12 * grasped..][..12];
        match labels.camera_from_object {
            Some(pose) => {
                let matrix = pose.to_homogeneous();
                for (n, &number) in rows.iter().enumerate() {
                    let error = matrix[(n / 4, n % 4)] - f64::from(number);
                    assert!(error.abs() < 0.01, "{error} in {name}");
                }
            }
            None => assert!(rows.iter().all(|&number| number == 0.0), "{name}"),
        }
    }
}
