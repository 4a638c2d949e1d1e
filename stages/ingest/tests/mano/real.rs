//! The user's licensed hand models against the landmarks that `DexYCB` published: if
//! `PIPELINE_MANO` names the folder with `MANO_RIGHT.pkl` and `PIPELINE_REAL_DATA` the one that
//! holds `dexycb-right`.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use nalgebra::Point3;
use npyz::npz::NpzArchive;
use schemas::demonstrations::Side;
use stage_ingest::ManoModel;

/// Largest accepted distance from a published landmark, in meters: they were computed in single
/// precision.
const AGREES_M: f64 = 5e-4;

fn folders(parent: &Path) -> Vec<PathBuf> {
    let mut all: Vec<PathBuf> = fs::read_dir(parent)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.is_dir())
        .collect();
    all.sort();
    all
}

fn numbers(file: &Path, array: &str) -> Vec<f64> {
    let mut npz = NpzArchive::open(file).unwrap();
    let numbers: Vec<f32> = npz.by_name(array).unwrap().unwrap().into_vec().unwrap();
    numbers.into_iter().map(f64::from).collect()
}

/// Returns what follows a line of YAML, as lines of a list without dashes and quotes.
fn list(text: &str, key: &str) -> Vec<String> {
    text.lines()
        .skip_while(|line| !line.starts_with(key))
        .skip(1)
        .map_while(|line| line.trim_start().strip_prefix("- "))
        .map(|item| item.trim_matches(['\'', '"']).to_owned())
        .collect()
}

/// Returns the hand shape of `mano.yml`.
fn betas(root: &Path, calibration: &str) -> [f64; 10] {
    let path = root.join(format!("calibration/mano_{calibration}/mano.yml"));
    let listed = list(&fs::read_to_string(&path).unwrap(), "betas:");
    let betas: Vec<f64> = listed.iter().map(|item| item.parse().unwrap()).collect();
    betas.try_into().unwrap()
}

#[test]
fn the_licensed_model_gives_the_published_landmarks() {
    let models = measured_data::named_by("PIPELINE_MANO");
    let (Some(models), Some(root)) = (models, measured_data::folder("dexycb-right")) else {
        return;
    };
    let model = ManoModel::from_pickle(&fs::read(models.join("MANO_RIGHT.pkl")).unwrap()).unwrap();
    assert_eq!(model.side(), Side::Right);
    let (mut n_images, mut worst) = (0, 0.0_f64);
    let mut by_subject: BTreeMap<String, f64> = BTreeMap::new();
    for subject in folders(&root) {
        for sequence in folders(&subject) {
            let Ok(meta) = fs::read_to_string(sequence.join("meta.yml")) else {
                continue;
            };
            if list(&meta, "mano_sides:") != ["right"] {
                continue;
            }
            let hand = model.shaped(&betas(&root, &list(&meta, "mano_calib:")[0]));
            for camera in folders(&sequence) {
                for label in fs::read_dir(camera).unwrap() {
                    let label = label.unwrap().path();
                    if label.extension().is_none_or(|end| end != "npz") {
                        continue;
                    }
                    // Both are in the camera's frame.
                    let pose: [f64; 51] = numbers(&label, "pose_m").try_into().unwrap();
                    let published = numbers(&label, "joint_3d");
                    if pose == [0.0; 51] || published.iter().all(|number| *number == -1.0) {
                        continue;
                    }
                    let (published, _) = published.as_chunks::<3>();
                    let error_m = hand
                        .keypoints(&pose)
                        .iter()
                        .zip(published)
                        .map(|(found, &published)| (found - Point3::from(published)).norm())
                        .fold(0.0, f64::max);
                    assert!(error_m < AGREES_M, "{error_m} m in `{}`", label.display());
                    worst = worst.max(error_m);
                    let name = subject.file_name().unwrap().to_string_lossy().into_owned();
                    let largest = by_subject.entry(name).or_default();
                    *largest = largest.max(error_m);
                    n_images += 1;
                }
            }
        }
    }
    println!("{n_images} images, at most {worst} m: {by_subject:?}");
    assert!(n_images > 1000);
}
