//! A hand on an arm, from the accepted motions to their execution by the simulated cell.

use std::{collections::BTreeSet, fs};

use schemas::ros2::{
    JointState, JointTrajectory, TfMessage,
    motion::{ARM_TRAJECTORY, JOINT_STATES, JOINT_TRAJECTORY, TF},
};
use serde_json::Value;

use crate::program::bench::{Bench, stderr, stdout};

fn rows(bench: &Bench, sql: &str) -> Vec<Value> {
    let asked = bench.ask(&["query", "--format", "json", sql]);
    let lines = stdout(&asked);
    let lines = lines.lines();
    lines
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

#[test]
fn an_arm_carries_the_hand_or_the_row_says_why_not() {
    let bench = Bench::new();
    let more = ["--set", "sample.per_object=32"];
    let ran = bench
        .command_on("pipelines/arm.toml", "run", &more)
        .output();
    let ran = ran.unwrap();
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    let sql =
        "select object, candidate_id, outcome, message, goal_id from executions order by goal_id";
    let done = rows(&bench, sql);
    let text = |row: &Value, key: &str| row[key].as_str().unwrap().to_owned();
    let (sent, refused): (Vec<&Value>, Vec<&Value>) = done
        .iter()
        .partition(|row| !text(row, "goal_id").is_empty());
    assert!(sent.len() >= 5 && sent.len() > refused.len(), "{done:#?}");
    for row in &refused {
        assert_eq!(text(row, "outcome"), "rejected");
        assert!(text(row, "message").starts_with("not sent: "), "{row}");
    }
    // The cell repeats the checks of its commands, and finds no fault.
    let outcomes: BTreeSet<String> = sent.iter().map(|row| text(row, "outcome")).collect();
    assert!(outcomes.contains("succeeded"), "{done:#?}");
    assert!(!outcomes.contains("rejected"), "{done:#?}");

    let row = sent.iter().find(|row| text(row, "outcome") == "succeeded");
    let name = format!("{}.mcap", text(row.unwrap(), "candidate_id"));
    let found = find(&bench.lake().join("files/arm/dispatch"), &name).unwrap();
    let recording = lake::recording::read(&found).unwrap();
    let told = |topic: &str| -> JointTrajectory {
        let mut messages = recording.topic(topic);
        messages.next().unwrap().decode().unwrap().unwrap()
    };
    let (arm, hand) = (told(ARM_TRAJECTORY), told(JOINT_TRAJECTORY));
    assert_eq!((arm.joint_names.len(), hand.joint_names.len()), (6, 16));
    let last = arm.points.last().unwrap();
    assert!(last.velocities.iter().all(|speed| speed.abs() < 1e-6));
    // All of the robot is there: its joints, and the tree from the arm's base to the fingertips.
    let mut states = recording.topic(JOINT_STATES);
    let state: JointState = states.next().unwrap().decode().unwrap().unwrap();
    assert_eq!(state.name.len(), 22);
    let mut poses = recording.topic(TF);
    let poses: TfMessage = poses.next().unwrap().decode().unwrap().unwrap();
    let children: BTreeSet<&str> = poses
        .transforms
        .iter()
        .map(|pose| pose.child_frame_id.as_str())
        .collect();
    for link in ["link_base", "link6", "link_3.0", "object"] {
        assert!(children.contains(link), "{link}: {children:?}");
    }
}

#[test]
fn an_arm_that_does_not_carry_the_hand_is_refused_before_anything_runs() {
    let bench = Bench::new();
    let refused = |value: &str, code: i32| {
        let mut run = bench.command_on("pipelines/arm.toml", "run", &["--set", value]);
        let ran = run.output().unwrap();
        assert_eq!(ran.status.code(), Some(code), "{}", stderr(&ran));
        let said = stderr(&ran);
        assert!(!said.contains("ingest    "), "{said}");
        said
    };
    let other = refused("dispatch.hand=data/hands/allegro_left.toml", 1);
    assert!(other.contains("differ from the hand"), "{other}");
    let link = refused("dispatch.arm.palm=base", 1);
    assert!(link.contains("has no link `base`"), "{link}");
    let pose = refused(
        "dispatch.arm.table_from_base=[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]",
        2,
    );
    assert!(pose.contains("arm.table_from_base"), "{pose}");
}

/// Looks for a file below a folder.
fn find(folder: &std::path::Path, name: &str) -> Option<std::path::PathBuf> {
    let entries = fs::read_dir(folder).ok()?.flatten();
    entries.map(|entry| entry.path()).find_map(|path| {
        if path.is_dir() {
            return find(&path, name);
        }
        let named = path.file_name().is_some_and(|found| found == name);
        named.then_some(path)
    })
}
