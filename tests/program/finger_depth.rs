//! The depth of fingers in each other and in the palm, measured again by `MuJoCo` from recorded joint positions.

use std::{fs, path::PathBuf, process::Output};

use robot::RobotModel;

use crate::program::{
    bench::{Bench, first, stderr, stdout},
    python::{program_at, python},
};

const CHECK: &str = "stages/program/examples/finger_depth.py";
const MODULES: [&str; 4] = ["mujoco", "numpy", "pyarrow", "rosbags"];
const ALL_RECORDED: [&str; 4] = [
    "screen.recorded_per_object=10000",
    "screen.recorded_failures_per_object=0",
    "screen.robustness.trials=0",
    "screen.pose_errors_per_object=0",
];
/// Motions whose fingers refinement does not keep apart, and whose depth the screen does not judge.
const DEEP: [&str; 2] = [
    "refine.self_collision_weight=0",
    "screen.max_finger_penetration_m=1",
];

#[test]
fn no_accepted_motion_of_full_contact_has_deep_fingers_by_another_measurement() {
    let Some(python) = python(&MODULES) else {
        return;
    };
    let bench = Bench::of_objects(&["004_sugar_box", "024_bowl"]);

    screen(&bench, &ALL_RECORDED);
    let whole = check(&bench, &python);
    let said = stdout(&whole);
    println!("{said}");
    assert_eq!(whole.status.code(), Some(0), "{said}{}", stderr(&whole));
    let (pairs, with_palm) = pairs();
    let pairs = format!("pairs of shapes {pairs}, of them {with_palm} of a finger and the palm");
    assert!(said.starts_with(&pairs), "{said}");

    // Motions without a recording are not checked.
    fs::remove_file(a_recording(&bench)).unwrap();
    let part = check(&bench, &python);
    assert_eq!(part.status.code(), Some(3), "{}", stdout(&part));
    let said = stderr(&part);
    assert!(
        said.starts_with("1 accepted motions are not recorded"),
        "{said}"
    );

    screen(&bench, &[&ALL_RECORDED[..], &DEEP].concat());
    let deep = check(&bench, &python);
    let said = stdout(&deep);
    println!("{said}");
    assert_eq!(deep.status.code(), Some(1), "{said}{}", stderr(&deep));
    assert!(!said.contains("tolerance of 0.500 mm: 0\n"), "{said}");
}

/// Screens the small sample's motions by `full_contact`, with these values.
fn screen(bench: &Bench, values: &[&str]) {
    let mut run = bench.command_on("pipelines/cgf.toml", "run", &["--until", "screen"]);
    for value in values {
        run.args(["--set", value]);
    }
    let ran = run.output().unwrap();
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
}

/// A recording of an accepted motion: failures are not recorded.
fn a_recording(bench: &Bench) -> PathBuf {
    let folder = bench.lake().join("files/cgf/screen/rollouts");
    let object = folder.join("004_sugar_box");
    first(&object, |name| name.starts_with("004_sugar_box-"))
}

/// Runs the check on the newest rollouts.
fn check(bench: &Bench, python: &str) -> Output {
    let mut check = program_at(python, CHECK);
    check.arg("--lake").arg(bench.lake()).output().unwrap()
}

/// The pairs of shapes that touch each other in the simulation, and those of them with the palm.
fn pairs() -> (usize, usize) {
    let hand = RobotModel::from_urdf(include_str!("../../data/robots/allegro_right.urdf")).unwrap();
    let shapes = hand.hand_shapes();
    let of = |idx: usize| shapes[idx + 1..].iter().map(move |other| (idx, other));
    let pairs = (0..shapes.len()).flat_map(of);
    let touching = pairs.filter(|&(idx, other)| shapes[idx].touches(other));
    let with_palm = touching
        .clone()
        .filter(|&(idx, other)| shapes[idx].finger.is_none() || other.finger.is_none());
    (touching.count(), with_palm.count())
}
