//! Files on disk: layout, consistency, determinism, and files that are left alone.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use demonstrator::{DemonstratorError, RECIPE_FILE, Recipe, SampleOutcome, ensure_sample};
use geometry::TriMesh;
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use npyz::npz::NpzArchive;

const RECIPE: &str = include_str!("../../../../data/sample/recipe.toml");
const CAMERA: &str = "836212060125";
/// Stands for the sources.
const CODE: &str = "demonstrator=1";

/// The committed recipe with one recording of each object.
fn small_recipe() -> String {
    let replaced = |text: String, key: &str, value: &str| {
        text.lines()
            .map(|line| {
                if line.starts_with(&format!("{key} =")) {
                    format!("{key} = {value}\n")
                } else {
                    format!("{line}\n")
                }
            })
            .collect::<String>()
    };
    let text = replaced(RECIPE.to_owned(), "sequences_per_object", "1");
    let text = replaced(text, "grasp_draws", "250");
    replaced(text, "grasp_tries", "8")
}

fn folder_with(recipe: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join(RECIPE_FILE), recipe).unwrap();
    folder
}

/// Every file below a folder with its bytes.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut open = vec![folder.to_owned()];
    while let Some(next) = open.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else {
                files.insert(
                    path.strip_prefix(folder).unwrap().to_owned(),
                    fs::read(&path).unwrap(),
                );
            }
        }
    }
    files
}

fn sequences(root: &Path) -> Vec<PathBuf> {
    let mut found: Vec<_> = contents(root)
        .keys()
        .filter(|path| path.ends_with("meta.yml"))
        .map(|path| root.join(path.parent().unwrap()))
        .collect();
    found.sort();
    found
}

fn array(path: &Path, name: &str) -> (Vec<u64>, Vec<f32>) {
    let mut archive = NpzArchive::open(path).unwrap();
    let array = archive.by_name(name).unwrap().unwrap();
    (array.shape().to_vec(), array.into_vec::<f32>().unwrap())
}

/// The value of a one-line key of `meta.yml`.
fn value<'a>(meta: &'a str, key: &str) -> &'a str {
    meta.lines()
        .find_map(|line| line.strip_prefix(&format!("{key}: ")))
        .unwrap()
}

/// The entries of a list in YAML.
fn list(meta: &str, key: &str) -> Vec<String> {
    let lines = meta
        .lines()
        .map(str::trim)
        .skip_while(|line| *line != format!("{key}:"))
        .skip(1);
    lines
        .map_while(|line| line.strip_prefix("- "))
        .map(|entry| entry.trim_matches('\'').to_owned())
        .collect()
}

fn pose_from_rows(numbers: &[f64]) -> Isometry3<f64> {
    let rotation = Matrix3::from_fn(|row, column| numbers[4 * row + column]);
    Isometry3::from_parts(
        Translation3::new(numbers[3], numbers[7], numbers[11]),
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&rotation)),
    )
}

fn extrinsic(root: &Path, name: &str) -> Isometry3<f64> {
    let text =
        fs::read_to_string(root.join("calibration/extrinsics_20000101_090000/extrinsics.yml"))
            .unwrap();
    let numbers: Vec<f64> = list(&text, name)
        .iter()
        .map(|number| number.parse().unwrap())
        .collect();
    pose_from_rows(&numbers)
}

#[test]
fn the_sample_is_consistent_and_of_the_datasets_layout() {
    let folder = folder_with(&small_recipe());
    let root = folder.path();
    let SampleOutcome::Written {
        sequences: made,
        frames,
    } = ensure_sample(root, CODE).unwrap()
    else {
        panic!()
    };
    let sequences = sequences(root);
    assert_eq!(made, sequences.len());
    let world_from_camera = extrinsic(root, &format!("'{CAMERA}'"));
    let world_from_table = extrinsic(root, "apriltag");
    assert!(world_from_camera.translation.vector.norm() > 0.1);
    let mut frames_seen = 0;
    let mut sides = BTreeMap::new();
    for sequence in &sequences {
        let meta = fs::read_to_string(sequence.join("meta.yml")).unwrap();
        let n: usize = value(&meta, "num_frames").parse().unwrap();
        frames_seen += n;
        *sides
            .entry(list(&meta, "mano_sides")[0].clone())
            .or_insert(0) += 1;
        let ids = list(&meta, "ycb_ids");
        let grasped: usize = value(&meta, "ycb_grasp_ind").parse().unwrap();
        assert!((3..=5).contains(&ids.len()) && grasped < ids.len());
        let (shape, pose_y) = array(&sequence.join("pose.npz"), "pose_y");
        assert_eq!(shape, [n as u64, ids.len() as u64, 7]);
        let (shape, pose_m) = array(&sequence.join("pose.npz"), "pose_m");
        assert_eq!(shape, [n as u64, 1, 51]);
        let object = |frame: usize, idx: usize| {
            let at = 7 * (frame * ids.len() + idx);
            let [x, y, z, w, tx, ty, tz]: [f64; 7] =
                std::array::from_fn(|k| f64::from(pose_y[at + k]));
            let rotation = spatial::quaternion_xyzw([x, y, z, w]).unwrap();
            Isometry3::from_parts(Translation3::new(tx, ty, tz), rotation)
        };
        // Only the grasped object moves.
        for idx in 0..ids.len() {
            let moved =
                (object(0, idx).translation.vector - object(n - 1, idx).translation.vector).norm();
            assert_eq!(moved > 0.05, idx == grasped, "{}", sequence.display());
            assert!(moved == 0.0 || idx == grasped);
        }
        // Everything stands on the table.
        for (idx, id) in ids.iter().enumerate() {
            let name = models(root)
                .into_iter()
                .find(|name| NAMES.contains(&(id.as_str(), name.as_str())))
                .unwrap();
            let text =
                fs::read_to_string(root.join("models").join(name).join("textured_simple.obj"))
                    .unwrap();
            let mesh = TriMesh::from_obj(&text).unwrap();
            let table_from_object = world_from_table.inverse() * object(0, idx);
            let lowest = mesh
                .vertices_m
                .iter()
                .map(|v| (table_from_object * v).z)
                .fold(f64::MAX, f64::min);
            assert!(lowest.abs() < 1e-4, "{} {id}: {lowest}", sequence.display());
        }
        let mut first_bones: Option<Vec<f64>> = None;
        for frame in 0..n {
            let path = sequence.join(CAMERA).join(format!("labels_{frame:06}.npz"));
            let (shape, joints) = array(&path, "joint_3d");
            assert_eq!(shape, [1, 21, 3]);
            let (_, hand) = array(&path, "pose_m");
            let (_, rows) = array(&path, "pose_y");
            let rows: Vec<f64> = rows[12 * grasped..12 * grasped + 12]
                .iter()
                .copied()
                .map(f64::from)
                .collect();
            let apart = (world_from_camera * pose_from_rows(&rows))
                .translation
                .vector
                - object(frame, grasped).translation.vector;
            assert!(apart.norm() < 1e-5);
            let tracked = &pose_m[51 * frame..51 * frame + 51];
            if joints.iter().all(|&number| number == -1.0) {
                assert!(
                    tracked.iter().chain(&hand).all(|&number| number == 0.0)
                        && first_bones.is_none()
                );
                continue;
            }
            let points: Vec<Point3<f64>> = joints
                .chunks(3)
                .map(|p| {
                    world_from_camera
                        * Point3::new(f64::from(p[0]), f64::from(p[1]), f64::from(p[2]))
                })
                .collect();
            let wrist = Vector3::new(
                f64::from(tracked[48]),
                f64::from(tracked[49]),
                f64::from(tracked[50]),
            );
            assert!((points[0].coords - wrist).norm() < 1e-5);
            let bones: Vec<f64> = (1..21)
                .map(|idx| (points[idx] - points[if idx % 4 == 1 { 0 } else { idx - 1 }]).norm())
                .collect();
            for (now, then) in bones.iter().zip(first_bones.get_or_insert(bones.clone())) {
                assert!((now - *then).abs() < 1e-3, "a bone changes its length");
            }
            assert!(
                points
                    .iter()
                    .all(|p| (world_from_table.inverse() * p).z > 0.0)
            );
        }
        assert!(first_bones.is_some());
    }
    assert_eq!(frames_seen, frames);
    // Of fifteen recordings, every fifth from the fourth on is of a left hand.
    assert_eq!(
        sides,
        BTreeMap::from([("left".to_owned(), 3), ("right".to_owned(), 12)])
    );
}

fn models(root: &Path) -> Vec<String> {
    fs::read_dir(root.join("models"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect()
}

/// Numbers and names as in the dataset.
const NAMES: [(&str, &str); 15] = [
    ("1", "002_master_chef_can"),
    ("2", "003_cracker_box"),
    ("3", "004_sugar_box"),
    ("4", "005_tomato_soup_can"),
    ("5", "006_mustard_bottle"),
    ("7", "008_pudding_box"),
    ("9", "010_potted_meat_can"),
    ("10", "011_banana"),
    ("12", "021_bleach_cleanser"),
    ("13", "024_bowl"),
    ("14", "025_mug"),
    ("15", "035_power_drill"),
    ("16", "036_wood_block"),
    ("21", "061_foam_brick"),
    ("22", "056_tennis_ball"),
];

#[test]
fn equal_recipes_give_equal_bytes_on_one_and_on_three_threads() {
    let made = [1, 3].map(|threads| {
        let folder = folder_with(&small_recipe());
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| ensure_sample(folder.path(), CODE)).unwrap();
        contents(folder.path())
    });
    assert!(made[0].keys().eq(made[1].keys()));
    for (path, bytes) in &made[0] {
        assert_eq!(bytes, &made[1][path], "{}", path.display());
    }
}

#[test]
fn valid_recordings_are_kept_and_others_are_regenerated() {
    let folder = folder_with(&small_recipe());
    let root = folder.path();
    assert!(matches!(
        ensure_sample(root, CODE).unwrap(),
        SampleOutcome::Written { .. }
    ));
    let whole = contents(root);

    // An edit is the user's.
    let edited = sequences(root).remove(0).join("meta.yml");
    fs::write(&edited, "edited").unwrap();
    assert_eq!(ensure_sample(root, CODE).unwrap(), SampleOutcome::Kept);
    assert_eq!(fs::read(&edited).unwrap(), b"edited");

    // An interrupted making: no stamp, half of the files, and work in progress.
    fs::remove_file(root.join(".made")).unwrap();
    fs::remove_dir_all(root.join("models")).unwrap();
    fs::create_dir_all(root.join(".making/models")).unwrap();
    assert!(matches!(
        ensure_sample(root, CODE).unwrap(),
        SampleOutcome::Written { .. }
    ));
    assert_eq!(contents(root), whole);

    // Another recipe with fewer people leaves nothing of the old one, and nothing of the user's goes.
    fs::write(root.join("notes.txt"), "mine").unwrap();
    fs::write(
        root.join(RECIPE_FILE),
        small_recipe().replace("subjects = 6", "subjects = 2"),
    )
    .unwrap();
    assert!(matches!(
        ensure_sample(root, CODE).unwrap(),
        SampleOutcome::Written { .. }
    ));
    let people = fs::read_dir(root).unwrap().filter(|entry| {
        entry
            .as_ref()
            .unwrap()
            .file_name()
            .to_string_lossy()
            .contains("-subject-")
    });
    assert_eq!(people.count(), 2);
    assert!(root.join("notes.txt").is_file());
}

#[test]
fn a_folder_without_a_recipe_is_not_touched() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(
        ensure_sample(folder.path(), CODE).unwrap(),
        SampleOutcome::NoRecipe
    );
    assert!(contents(folder.path()).is_empty());
}

#[test]
fn refuses_invalid_recipes() {
    let refuses = |from: &str, to: &str| {
        assert!(RECIPE.contains(from), "{from}");
        Recipe::from_toml(&RECIPE.replace(from, to)).unwrap_err()
    };
    for (from, to) in [
        ("seed = 7", ""),
        ("seed = 7", "sed = 7"),
        ("seed = 7", "seed = -1"),
        ("rate_hz = 30.0", "rate_hz = 'a'"),
    ] {
        assert!(
            matches!(refuses(from, to), DemonstratorError::Recipe(_)),
            "{to}"
        );
    }
    for (from, to, key) in [
        ("rate_hz = 30.0", "rate_hz = 0.0", "rate_hz"),
        ("rate_hz = 30.0", "rate_hz = nan", "rate_hz"),
        ("subjects = 6", "subjects = 0", "subjects"),
        (
            "distractors = [2, 4]",
            "distractors = [4, 2]",
            "distractors",
        ),
        ("lying_share = 0.25", "lying_share = 1.5", "lying_share"),
        (
            "reach_time_s = [0.7, 1.1]",
            "reach_time_s = [1.1, 0.7]",
            "reach_time_s",
        ),
        (
            "wrist_noise_m = 0.0005",
            "wrist_noise_m = 0.5",
            "wrist_noise_m",
        ),
    ] {
        let DemonstratorError::Option { option, .. } = refuses(from, to) else {
            panic!("{to}")
        };
        assert_eq!(option, key);
    }
}
