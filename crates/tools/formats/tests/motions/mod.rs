//! Motions of a right Allegro hand, made of waves, and where they are written.

#![allow(dead_code, reason = "each test uses a part")]

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use formats::{Episode, EpisodeStep, Export, Joint, Unit};
use nalgebra::{UnitQuaternion, Vector3};
use spatial::Pose;

/// Joints in an order that is not the evaluator's.
pub(crate) fn joints() -> Vec<Joint> {
    let numbers = (0..16).map(|idx| (idx * 5 + 3) % 16);
    let joint = |number| Joint {
        name: format!("joint_{number}.0"),
        unit: Unit::Radian,
    };
    numbers.map(joint).collect()
}

/// The hand and the object of motion `seed` at a time.
pub(crate) fn step(seed: u32, time_s: f64) -> EpisodeStep {
    let wave = |k: f64| (k + f64::from(seed) + 1.7 * time_s).sin();
    EpisodeStep {
        time_s,
        table_from_palm: Pose::from_parts(
            [0.2 * wave(0.0), 0.2 * wave(1.0), 0.3 - 0.1 * wave(2.0)],
            UnitQuaternion::from_scaled_axis(Vector3::new(wave(3.0), wave(4.0), wave(5.0))),
        ),
        table_from_object: Pose::from_parts(
            [0.01 * wave(6.0), 0.0, 0.05],
            UnitQuaternion::from_euler_angles(0.3, 0.1 * wave(7.0), -0.2),
        ),
        q: (0..16)
            .map(|joint| 0.8 * wave(8.0 + f64::from(joint)))
            .collect(),
        q_command: None,
    }
}

/// Motions for two objects, with unequal steps; every other one has commands.
pub(crate) fn episodes() -> Vec<Episode> {
    let episode = |seed: u32| {
        let times = (0..20).map(|step| 0.05 * f64::from(step) + 0.002 * f64::from(step % 3));
        let steps = times.map(|time_s| EpisodeStep {
            q_command: (seed % 2 == 1).then(|| step(seed + 10, time_s).q),
            ..step(seed, time_s)
        });
        let object = if seed < 2 { "025_mug" } else { "004_sugar_box" };
        let name = format!("{object}-{seed:05}");
        let episode = Episode::new(&name, object, &joints(), &steps.collect::<Vec<_>>()).unwrap();
        episode.with_outcome(if seed == 0 { "slipped" } else { "held" })
    };
    (0..3).map(episode).collect()
}

/// A Python with these modules; else it is said why nothing is tried.
pub(crate) fn python(modules: &[&str]) -> Option<PathBuf> {
    let python = measured_data::named_by("PIPELINE_PYTHON")?;
    let imports = modules.iter().map(|module| format!("import {module}\n"));
    let imports = imports.collect::<Vec<_>>().concat();
    let has = Command::new(&python).args(["-c", &imports]).output();
    if has.is_ok_and(|ran| ran.status.success()) {
        return Some(python);
    }
    measured_data::print_skipped(&format!("`{}` lacks one of {modules:?}", python.display()));
    None
}

/// Writes an export to an empty folder of this name.
#[expect(clippy::disallowed_methods, reason = "files of a test")]
pub(crate) fn write(export: &Export, name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    if folder.exists() {
        fs::remove_dir_all(&folder).unwrap();
    }
    for (file, bytes) in &export.files {
        let path = folder.join(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }
    folder
}

/// Runs a program of this folder on an export, and returns what it prints.
pub(crate) fn ask(python: &Path, program: &str, arguments: &[&Path]) -> serde_json::Value {
    let ran = Command::new(python)
        .arg("-B")
        .arg(format!("{}/tests/{program}", env!("CARGO_MANIFEST_DIR")))
        .args(arguments)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&ran.stderr);
    assert!(ran.status.success(), "{said}");
    serde_json::from_slice(&ran.stdout).unwrap()
}

/// Asserts that numbers are those expected, within 1e-6.
pub(crate) fn assert_near(found: &serde_json::Value, expected: impl IntoIterator<Item = f64>) {
    let found: Vec<f64> = serde_json::from_value(found.clone()).unwrap();
    let expected: Vec<f64> = expected.into_iter().collect();
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(&expected) {
        assert!((found - expected).abs() < 1e-6, "{found} for {expected}");
    }
}
