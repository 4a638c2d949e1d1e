//! Retargeting as a user runs it: other hands, and real recordings.

use std::{collections::BTreeMap, process::Command};

use dataflow::Pipeline;
use serde_json::Value;

use crate::program::bench::{Bench, stderr};

/// Asks the lake in SQL.
fn ask(bench: &Bench, sql: &str) -> Vec<Value> {
    let answer = bench.ask(&["query", sql, "--format", "json"]);
    assert!(answer.status.success(), "{}", stderr(&answer));
    let rows = serde_json::Deserializer::from_slice(&answer.stdout).into_iter();
    rows.collect::<Result<_, _>>().unwrap()
}

/// The number that this many of a hundred do not exceed.
fn quantile(numbers: &mut [f64], percent: usize) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers[(numbers.len() - 1) * percent / 100]
}

/// Compares every joint position of the lake's trajectories with the hand's limits.
fn check_limits(bench: &Bench, urdf: &str) {
    let path = format!("{}/data/robots/{urdf}", env!("CARGO_MANIFEST_DIR"));
    let model = robot::RobotModel::from_urdf(&std::fs::read_to_string(path).unwrap()).unwrap();
    let mut n = 0;
    for row in ask(bench, "select q_rad, limit_margin_rad from trajectories") {
        let q: Vec<f64> = serde_json::from_value(row["q_rad"].clone()).unwrap();
        assert_eq!(q.len(), model.dof());
        let margins = q.iter().zip(model.joints()).map(|(q, joint)| {
            assert!(
                joint.lower <= *q && *q <= joint.upper,
                "{}: {q}",
                joint.name
            );
            (q - joint.lower).min(joint.upper - q)
        });
        let least = margins.fold(f64::INFINITY, f64::min);
        assert!((least - row["limit_margin_rad"].as_f64().unwrap()).abs() < 1e-12);
        n += 1;
    }
    assert!(n > 0);
}

#[test]
fn pipelines_say_the_same_where_they_share_stages() {
    let read = |name: &str| {
        let path = format!("pipelines/{name}.toml");
        let text = std::fs::read_to_string(&path).unwrap();
        Pipeline::parse(path.as_ref(), &text, &pipeline::kinds(), None, &[]).unwrap()
    };
    let whole = read("cgf");
    for (other, stages) in [
        ("replay", &["ingest", "retarget", "screen"][..]),
        ("interpolation", &["ingest", "retarget", "train"]),
        ("baseline", &["ingest", "retarget", "train", "sample"]),
    ] {
        let file = read(other);
        assert_eq!(whole.seed, file.seed);
        for stage in stages {
            let [mut a, b] = [&whole, &file].map(|file| {
                let mut config = file.find(stage).unwrap().config();
                // Trials under errors change no verdict.
                for trials in ["robustness", "pose_errors_per_object"] {
                    let _trials = config.as_object_mut().unwrap().remove(trials);
                }
                config
            });
            if *stage == "screen" {
                // Refined motions squeeze by themselves, demonstrations by script.
                let squeeze_rad = &mut a["protocol"]["squeeze_rad"];
                assert_eq!(*squeeze_rad, 0.0);
                *squeeze_rad = 0.15.into();
            }
            assert_eq!(a, b, "{other}: {stage}");
        }
    }
}

#[test]
fn a_left_hand_takes_the_reaches_of_left_hands() {
    let bench = Bench::new();
    let set = |key: &str, value: &str| ["--set".to_owned(), format!("{key}={value}")];
    let arguments: Vec<String> = [
        set("ingest.hand", "left"),
        set("retarget.hand", "data/hands/allegro_left.toml"),
    ]
    .concat();
    let mut arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    arguments.extend(["--until", "retarget"]);
    bench.run_well(&arguments);
    check_limits(&bench, "allegro_left.urdf");
    let rows = ask(&bench, "select keypoint_error_m from trajectories");
    for row in rows {
        assert!(row["keypoint_error_m"].as_f64().unwrap() < 0.04);
    }
}

#[test]
fn a_hand_with_a_table_of_another_is_refused() {
    let bench = Bench::new();
    let ran = bench.run(&[
        "--until",
        "retarget",
        "--set",
        "retarget.hand_table=data/hands/shadow_right.toml",
    ]);
    assert_eq!(ran.status.code(), Some(1), "{}", stderr(&ran));
    for part in ["shadow_right.toml", "allegro_right.urdf", "`thtip`"] {
        assert!(stderr(&ran).contains(part), "{}", stderr(&ran));
    }
}

/// The claims for the defaults, on all right-handed sequences.
#[test]
fn real_recordings_are_followed_within_limits() {
    let Some(root) = measured_data::folder("dexycb-right") else {
        return;
    };
    let bench = Bench::on(root);
    let ran = bench.run(&["--until", "retarget"]);
    assert!(matches!(ran.status.code(), Some(0 | 3)), "{}", stderr(&ran));
    check_limits(&bench, "allegro_right.urdf");

    let report = ask(&bench, "select * from tracking");
    assert_eq!(report.len(), 20);
    let number = |row: &Value, key: &str| row[key].as_f64().unwrap();
    let sum = |key: &str, by: &str| -> f64 {
        report
            .iter()
            .map(|row| number(row, key) * number(row, by))
            .sum()
    };
    let n: f64 = report.iter().map(|row| number(row, "trajectories_n")).sum();
    assert!(n >= 355.0, "{n} of 361");
    let steps: f64 = report.iter().map(|row| number(row, "steps_n")).sum();
    let tips = sum("tip_error_mean_m", "steps_n") / steps;
    assert!(tips < 0.0051, "{tips} m");
    let below = sum("below_table_share", "trajectories_n") / n;
    assert!(below <= 0.03, "{below}");

    // The grasp is the last row of its sequence.
    let mut grasps: BTreeMap<String, (f64, f64)> = BTreeMap::new();
    for row in ask(
        &bench,
        "select sequence, time_s, penetration_m from trajectories",
    ) {
        let sequence = row["sequence"].as_str().unwrap().to_owned();
        let (time_s, depth_m) = (number(&row, "time_s"), number(&row, "penetration_m"));
        let grasp = grasps.entry(sequence).or_insert((time_s, depth_m));
        if time_s >= grasp.0 {
            *grasp = (time_s, depth_m);
        }
    }
    let mut depths: Vec<f64> = grasps.into_values().map(|(_, depth)| depth).collect();
    assert!(quantile(&mut depths, 50) < 0.001);
    assert!(quantile(&mut depths, 90) < 0.003);
}

/// Hands whose URDFs are not the project's own, by their tables alone.
#[test]
fn published_hands_are_driven_by_their_tables() {
    let (Some(root), Some(urdfs)) = (
        measured_data::folder("dexmv-mustard"),
        measured_data::folder("urdf"),
    ) else {
        return;
    };
    for (urdf, table) in [
        ("allegro_hand_right", "allegro_right"),
        ("leap_hand_right", "leap_right"),
        ("shadow_hand_right", "shadow_right"),
    ] {
        let bench = Bench::on(root.clone());
        // Their meshes are not here: they are followed by their joints alone.
        let published = std::fs::read_to_string(urdfs.join(format!("{urdf}.urdf"))).unwrap();
        let hand = bench.lake().with_file_name("hand.urdf");
        std::fs::write(&hand, without_meshes(&published)).unwrap();
        let ran = bench.run(&[
            "--until",
            "retarget",
            // Its tag is not on the table, and no other object is.
            "--set",
            "ingest.table=objects",
            "--set",
            "ingest.min_table_objects_n=1",
            "--set",
            &format!("retarget.hand={}", hand.display()),
            "--set",
            &format!("retarget.hand_table=data/hands/{table}.toml"),
        ]);
        assert!(matches!(ran.status.code(), Some(0 | 3)), "{}", stderr(&ran));
        let report = ask(&bench, "select * from tracking");
        assert_eq!(report.len(), 1, "{urdf}");
        let tips = report[0]["tip_error_mean_m"].as_f64().unwrap();
        assert!(tips < 0.02, "{urdf}: {tips} m");
        let margin = report[0]["limit_margin_least_rad"].as_f64().unwrap();
        assert!(margin >= 0.0, "{urdf}: {margin} rad");
    }
}

/// Returns a URDF without the collision shapes that are meshes.
fn without_meshes(urdf: &str) -> String {
    let mut kept = String::new();
    let mut left = urdf;
    while let Some(start) = left.find("<collision") {
        let (before, shape) = left.split_at(start);
        let end = shape.find("</collision>").unwrap() + "</collision>".len();
        kept.push_str(before);
        if !shape[..end].contains("<mesh") {
            kept.push_str(&shape[..end]);
        }
        left = &shape[end..];
    }
    kept + left
}

/// The proposal that `doctor` prints is a hand's file that retargets.
#[test]
fn a_hand_proposed_by_doctor_retargets() {
    let bench = Bench::new();
    let urdf = format!(
        "{}/data/robots/allegro_right.urdf",
        env!("CARGO_MANIFEST_DIR")
    );
    let proposed = Command::new(env!("CARGO_BIN_EXE_pipeline"))
        .args(["doctor", "--robot", &urdf])
        .output()
        .unwrap();
    let path = bench.lake().with_file_name("hand.toml");
    std::fs::write(&path, proposed.stdout).unwrap();
    let hand = format!("retarget.hand={}", path.display());
    bench.run_well(&["--until", "retarget", "--set", &hand]);
}
