//! Landmarks from `pose.npz` alone, by a made-up hand model of MANO's form.

use std::{
    fs::{self, File},
    io,
    path::Path,
};

use dataflow::Stage;
use nalgebra::Point3;
use schemas::demonstrations::Demonstration;
use stage_ingest::{Format, Ingest, IngestConfig, Landmarks, ManoModel};
use tempfile::TempDir;

use crate::{
    assert_known_answer,
    bench::{Bench, config},
    dataset,
    rig::{FIRST, LAST, Rig},
};

/// A folder with the made-up models under their licensed names.
pub(crate) fn models() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/mano/models.zip");
    let mut archive = npyz::zip::ZipArchive::new(File::open(path).unwrap()).unwrap();
    for (from, to) in [
        ("right.pkl", "MANO_RIGHT.pkl"),
        ("left.pkl", "MANO_LEFT.pkl"),
    ] {
        let mut file = File::create(folder.path().join(to)).unwrap();
        io::copy(&mut archive.by_name(from).unwrap(), &mut file).unwrap();
    }
    folder
}

fn bench(root: &Path, models: &Path, change: impl FnOnce(&mut IngestConfig)) -> Bench {
    let mut config = config(root);
    config.mano_models = Some(models.to_owned());
    change(&mut config);
    Bench::until(config, "demonstrations").unwrap()
}

fn without_labels(root: &Path) {
    for entry in fs::read_dir(Rig::sequence(root)).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            fs::remove_dir_all(path).unwrap();
        }
    }
}

/// Asserts that every landmark is where the model puts it.
fn assert_posed(demonstration: &Demonstration, models: &Path) {
    let model = ManoModel::from_pickle(&fs::read(models.join("MANO_RIGHT.pkl")).unwrap()).unwrap();
    let shaped = model.shaped(&Rig::BETAS);
    let object_from_world = (Rig::world_from_tag() * Rig::tag_from_object(0)).inverse();
    assert_eq!(demonstration.steps.len(), LAST - FIRST + 1);
    for step in &demonstration.steps {
        let numbers = Rig::hand_numbers(step.image as usize).map(f64::from);
        assert_eq!(step.cameras_n, 0);
        for (point, in_world) in step.keypoints_m.iter().zip(shaped.keypoints(&numbers)) {
            let error_m = (Point3::from(*point) - object_from_world * in_world).norm();
            assert!(error_m < 1e-6, "{error_m} m");
        }
    }
}

#[test]
fn without_labels_the_hand_model_gives_the_landmarks() {
    let (root, models) = (dataset(&Rig::default()), models());
    without_labels(root.path());
    let bench = bench(root.path(), models.path(), |_| {});
    assert_posed(&bench.only(), models.path());
}

#[test]
fn missing_part_of_a_hand_model_is_named() {
    for (file, expected) in [("mano.yml", "mano.yml`"), ("pose.npz", "no `pose.npz`")] {
        let (root, models) = (dataset(&Rig::default()), models());
        let path = match file {
            "mano.yml" => root.path().join("calibration/mano_x/mano.yml"),
            _ => Rig::sequence(root.path()).join(file),
        };
        fs::remove_file(path).unwrap();
        // The labels do without.
        assert_known_answer(&bench(root.path(), models.path(), |_| {}).only());
        without_labels(root.path());
        let (_, reason) = bench(root.path(), models.path(), |_| {}).reason();
        assert!(reason.ends_with(expected), "{reason}");
    }
}

#[test]
fn both_routes_are_compared_and_the_chosen_one_is_taken() {
    let (root, models) = (dataset(&Rig::default()), models());
    let difference = |landmarks: Landmarks| {
        let bench = bench(root.path(), models.path(), |config| {
            config.landmarks = landmarks;
        });
        let key = bench.units["demonstrations"][0].partition.clone();
        let (metrics, _) = bench.made("demonstrations", &key);
        let mean_m = metrics["mano_difference_m"];
        assert!(metrics["mano_largest_difference_m"] > mean_m);
        (bench.only(), mean_m)
    };
    let (labeled, mean_m) = difference(Landmarks::Either);
    assert_known_answer(&labeled);
    let (posed, other_mean_m) = difference(Landmarks::Mano);
    assert_posed(&posed, models.path());
    assert!((mean_m - other_mean_m).abs() < 1e-12);
    // What is reported is the difference of the two answers, up to the images after the reach.
    let distances = labeled.steps.iter().zip(&posed.steps).flat_map(|(a, b)| {
        let points = a.keypoints_m.iter().zip(&b.keypoints_m);
        points.map(|(&a, &b)| (Point3::from(a) - Point3::from(b)).norm())
    });
    let distances: Vec<f64> = distances.collect();
    let in_reach_m = distances.iter().sum::<f64>() / distances.len() as f64;
    assert!(
        (in_reach_m - mean_m).abs() < 0.3 * mean_m,
        "{in_reach_m} {mean_m}"
    );
}

#[test]
fn synthetic_recordings_are_marked_and_not_posed() {
    let (root, models) = (dataset(&Rig::default()), models());
    fs::write(Rig::sequence(root.path()).join("NOT_MANO.txt"), "made up").unwrap();
    assert_known_answer(&bench(root.path(), models.path(), |_| {}).only());
    let bench = bench(root.path(), models.path(), |config| {
        config.landmarks = Landmarks::Mano;
    });
    let reason = "no hand model poses this hand, but `landmarks` asks for one";
    assert_eq!(bench.reason(), ("skipped", reason.to_owned()));
}

#[test]
fn a_model_that_is_missing_or_of_the_other_hand_is_named() {
    let (root, models) = (dataset(&Rig::default()), models());
    let right = models.path().join("MANO_RIGHT.pkl");
    fs::copy(models.path().join("MANO_LEFT.pkl"), &right).unwrap();
    let (_, reason) = bench(root.path(), models.path(), |_| {}).reason();
    assert_eq!(reason, "`mano/MANO_RIGHT.pkl`: the model of a left hand");
    fs::write(&right, "not a pickle").unwrap();
    let (_, reason) = bench(root.path(), models.path(), |_| {}).reason();
    assert!(
        reason.starts_with("`mano/MANO_RIGHT.pkl`: no pickle that can be read"),
        "{reason}"
    );
    fs::remove_file(&right).unwrap();
    let mut config = config(root.path());
    config.mano_models = Some(models.path().to_owned());
    let err = Ingest::prepare(&config).unwrap_err();
    assert!(err.to_string().contains("MANO_RIGHT.pkl"), "{err}");
    assert!(err.hint().unwrap().contains("mano.is.tue.mpg.de"));
}

#[test]
fn landmarks_of_a_hand_model_are_refused_where_the_dataset_has_no_poses_of_it() {
    let root = dataset(&Rig::default());
    for format in [Format::HoCap, Format::Tracks] {
        let mut config = config(root.path());
        (config.format, config.landmarks) = (format, Landmarks::Mano);
        let err = Ingest::prepare(&config).unwrap_err();
        assert!(
            err.to_string().contains("only recordings of DexYCB"),
            "{err}"
        );
        assert!(err.hint().unwrap().contains("labels"));
    }
}
