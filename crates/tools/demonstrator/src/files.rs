//! Recordings, calibration and models as files in the dataset's layout.

use std::{
    fmt::Write as _,
    fs::{self, File},
    io::{self, Write},
    path::Path,
};

use nalgebra::Point3;
use spatial::{Object, Pose, Table};

use crate::{
    DemonstratorError,
    archive::{Archive, zeros},
    body::Body,
    camera::{CALIBRATION, CameraRig, LABELED, intrinsics_yaml, rows},
    hand::{Hand, Side, point},
    scene::Scene,
};

/// Points in each model's `points.xyz`.
const MODEL_POINTS: usize = 2620;
/// Size of an image, in pixels.
const IMAGE: [u64; 2] = [480, 640];
/// Numbers that describe a hand in `pose_m`.
const HAND_NUMBERS: u64 = 51;
/// Says what the recordings are not.
const NOT_MANO: &str = "Made by a program, not recorded from a person.\n\
    `pose_m` is not MANO: it holds the wrist's orientation (axis-angle) and position, and zeros.\n\
    The hand is in `joint_3d` of the labels.\n";

/// File that says what the sample is and under which terms it may be used.
pub(crate) const TERMS_FILE: &str = "TERMS.txt";
/// Its text.
const TERMS: &str = "Bundled sample, made by a program, MIT OR Apache-2.0\n";

/// Returns the folder of a person.
pub(crate) fn subject_folder(subject: usize) -> String {
    format!("{}-subject-{:02}", date(subject), subject + 1)
}

/// Returns the folder of a recording within its person's.
pub(crate) fn sequence_folder(subject: usize, recording: usize) -> String {
    format!(
        "{}_{:02}{:02}00",
        date(subject),
        10 + recording / 60,
        recording % 60
    )
}

fn date(subject: usize) -> String {
    format!("2000{:02}{:02}", subject / 28 % 12 + 1, subject % 28 + 1)
}

fn mano_calibration(subject: usize, side: Side) -> String {
    format!("{CALIBRATION}_subject-{:02}_{}", subject + 1, side.word())
}

/// Writes a file and the folders above it.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> Result<(), DemonstratorError> {
    let attempt = || -> io::Result<()> {
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder)?;
        }
        File::create(path)?.write_all(bytes)
    };
    attempt().map_err(|source| DemonstratorError::File {
        action: "write",
        path: path.to_owned(),
        source,
    })
}

/// Writes what all recordings share: calibration of cameras and people, and models.
pub(crate) fn write_shared(
    root: &Path,
    bodies: &[Body],
    subjects: usize,
) -> Result<(), DemonstratorError> {
    write(&root.join(TERMS_FILE), TERMS.as_bytes())?;
    let calibration = root.join("calibration");
    let extrinsics = calibration.join(format!("extrinsics_{CALIBRATION}/extrinsics.yml"));
    write(&extrinsics, CameraRig::new().extrinsics_yaml().as_bytes())?;
    let intrinsics = calibration.join(format!("intrinsics/{LABELED}_640x480.yml"));
    write(&intrinsics, intrinsics_yaml().as_bytes())?;
    for subject in 0..subjects {
        for side in [Side::Left, Side::Right] {
            let folder = calibration.join(format!("mano_{}", mano_calibration(subject, side)));
            write(
                &folder.join("mano.yml"),
                format!("betas:\n{}", "- 0.0\n".repeat(10)).as_bytes(),
            )?;
            write(&folder.join("NOT_MANO.txt"), NOT_MANO.as_bytes())?;
        }
    }
    for body in bodies {
        let folder = root.join("models").join(body.kind.name);
        let mesh = format!(
            "# {}, made by a program\n{}",
            body.kind.name,
            body.mesh.to_obj()
        );
        write(&folder.join("textured_simple.obj"), mesh.as_bytes())?;
        let mut points = String::new();
        for p in body.mesh.sample_surface(MODEL_POINTS, 0).0 {
            // Writing to a string cannot fail.
            let _ = writeln!(points, "{:.6} {:.6} {:.6}", p.x, p.y, p.z);
        }
        write(&folder.join("points.xyz"), points.as_bytes())?;
    }
    Ok(())
}

/// Writes one recording.
pub(crate) fn write_recording(
    root: &Path,
    bodies: &[Body],
    recording: usize,
    scene: &Scene,
) -> Result<(), DemonstratorError> {
    let folder = root
        .join(subject_folder(scene.subject))
        .join(sequence_folder(scene.subject, recording));
    write(
        &folder.join("meta.yml"),
        meta_yaml(bodies, scene).as_bytes(),
    )?;
    write(&folder.join("NOT_MANO.txt"), NOT_MANO.as_bytes())?;
    let packed = |action: io::Result<Vec<u8>>, name: &str| {
        let path = folder.join(name);
        let bytes = action.map_err(|source| DemonstratorError::File {
            action: "pack",
            path: path.clone(),
            source,
        })?;
        write(&path, &bytes)
    };
    let rig = CameraRig::new();
    packed(pose_archive(&rig, scene), "pose.npz")?;
    let mut blank = zeros("seg", &IMAGE);
    for idx in 0..scene.frames.len() {
        let labels = match &mut blank {
            Ok(blank) => label_archive(&rig, scene, idx, blank),
            Err(err) => Err(io::Error::from(err.kind())),
        };
        packed(labels, &format!("{LABELED}/labels_{idx:06}.npz"))?;
    }
    Ok(())
}

fn meta_yaml(bodies: &[Body], scene: &Scene) -> String {
    let mut ids = String::new();
    for &idx in &scene.objects {
        // Writing to a string cannot fail.
        let _ = writeln!(ids, "- {}", bodies[idx].kind.id);
    }
    let side = scene.hand.side();
    format!(
        "serials:\n- '{LABELED}'\nnum_frames: {}\nextrinsics: '{CALIBRATION}'\nycb_ids:\n{ids}ycb_grasp_ind: {}\nmano_sides:\n- {}\nmano_calib:\n- {}\n",
        scene.frames.len(),
        scene.grasped,
        side.word(),
        mano_calibration(scene.subject, side),
    )
}

/// Returns the poses of all objects in one frame, in the table's frame.
fn objects_at(scene: &Scene, frame: usize) -> Vec<Pose<Table, Object>> {
    let mut poses = scene.table_from_objects.clone();
    poses[scene.grasped] = scene.frames[frame].table_from_object;
    poses
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "the dataset stores single precision"
)]
fn single(number: f64) -> f32 {
    number as f32
}

/// Returns the hand as the dataset's numbers: orientation as axis-angle, zeros, position; all zero
/// while it is out of sight.
fn hand_numbers<Frame>(hand: Option<Pose<Frame, Hand>>) -> Vec<f32> {
    let Some(pose) = hand else {
        return vec![0.0; 51];
    };
    let turn = pose.rotation.scaled_axis();
    let position = pose.translation.vector;
    turn.iter()
        .copied()
        .chain([0.0; 45])
        .chain(position.iter().copied())
        .map(single)
        .collect()
}

/// Returns `pose.npz`: everything in the world's frame.
fn pose_archive(rig: &CameraRig, scene: &Scene) -> io::Result<Vec<u8>> {
    let (n, objects) = (scene.frames.len(), scene.objects.len());
    let world_from_table = rig.world_from_table;
    let objects_in_world = (0..n)
        .flat_map(|frame| objects_at(scene, frame))
        .flat_map(|pose| {
            let pose = world_from_table * pose;
            let [x, y, z, w] = spatial::xyzw(&pose.rotation);
            let t = pose.translation.vector;
            [x, y, z, w, t.x, t.y, t.z].map(single)
        });
    let hands = scene.frames.iter().flat_map(|frame| {
        hand_numbers(
            frame
                .hand
                .as_ref()
                .map(|(pose, _)| world_from_table * *pose),
        )
    });
    let mut archive = Archive::new();
    archive.f32("pose_y", &[n as u64, objects as u64, 7], objects_in_world)?;
    archive.f32("pose_m", &[n as u64, 1, HAND_NUMBERS], hands)?;
    archive.finish()
}

/// Returns the labels of one image: everything in the labeled camera's frame.
fn label_archive(rig: &CameraRig, scene: &Scene, idx: usize, blank: &[u8]) -> io::Result<Vec<u8>> {
    let camera_from_table = rig.world_from_camera.inverse() * rig.world_from_table;
    let frame = &scene.frames[idx];
    let landmarks: Option<Vec<Point3<f64>>> = frame.hand.as_ref().map(|(pose, q)| {
        let points = scene.hand.points_in(&(camera_from_table * *pose), q);
        points.into_iter().take(point::LANDMARKS).collect()
    });
    let objects = objects_at(scene, idx)
        .into_iter()
        .flat_map(|pose| rows(&(camera_from_table * pose)).map(single));
    let missing = |count: usize| vec![-1.0_f32; point::LANDMARKS * count];
    let in_space = landmarks.as_ref().map_or_else(
        || missing(3),
        |points| {
            points
                .iter()
                .flat_map(|p| [p.x, p.y, p.z].map(single))
                .collect()
        },
    );
    let in_image = landmarks.as_ref().map_or_else(
        || missing(2),
        |points| {
            points
                .iter()
                .flat_map(|p| CameraRig::pixel(p).map(single))
                .collect()
        },
    );
    let mut archive = Archive::new();
    archive.copy(blank)?;
    archive.f32("pose_y", &[scene.objects.len() as u64, 3, 4], objects)?;
    let hand = hand_numbers(
        frame
            .hand
            .as_ref()
            .map(|(pose, _)| camera_from_table * *pose),
    );
    archive.f32("pose_m", &[1, HAND_NUMBERS], hand)?;
    archive.f32("joint_3d", &[1, point::LANDMARKS as u64, 3], in_space)?;
    archive.f32("joint_2d", &[1, point::LANDMARKS as u64, 2], in_image)?;
    archive.finish()
}
