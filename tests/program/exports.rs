//! Exports for other labs: from every artifact that has motions, whole or not at all, with what is lost.

use std::{fs, path::Path, process::Output};

use crate::program::{
    bench::{Bench, stderr, stdout},
    cell_lab::executed,
};

/// Runs `export` on the finished lake; `out` is a folder beside it.
fn export(bench: &Bench, arguments: &[&str], out: &Path) -> Output {
    std::process::Command::new(env!("CARGO_BIN_EXE_pipeline"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .arg("export")
        .args(arguments)
        .arg("--out")
        .arg(out)
        .arg("--lake")
        .arg(bench.lake())
        .output()
        .unwrap()
}

/// The table of an export as CSV: its header and its rows.
fn table(folder: &Path) -> (Vec<String>, Vec<Vec<String>>) {
    let text = fs::read_to_string(folder.join("motions.csv")).unwrap();
    let row = |line: &str| line.split(',').map(str::to_owned).collect::<Vec<_>>();
    let mut lines = text.lines().map(row);
    (lines.next().unwrap(), lines.collect())
}

#[test]
fn every_artifact_with_motions_is_exported_and_says_what_is_lost() {
    let bench = executed();
    let lab = tempfile::tempdir().unwrap();
    for (artifact, is_executed, has_commands) in [
        ("retarget.trajectories", false, false),
        ("refine.candidates", false, false),
        ("screen.rollouts", true, true),
        ("dispatch.executions", true, true),
    ] {
        let out = lab.path().join(artifact);
        let ran = export(bench, &["csv", artifact], &out);
        let said = stderr(&ran);
        assert_eq!(ran.status.code(), Some(0), "{artifact}: {said}");
        assert_eq!(stdout(&ran).trim(), out.display().to_string());
        assert!(
            said.lines()
                .filter(|line| line.starts_with("lost   "))
                .count()
                >= 3,
            "{said}"
        );
        assert_eq!(said.contains("lost   commands: "), !has_commands, "{said}");
        assert!(
            said.lines().last().unwrap().starts_with("done   "),
            "{said}"
        );
        let (header, rows) = table(&out);
        let at = |name: &str| header.iter().position(|other| other == name).unwrap();
        assert!(rows.len() > 100, "{artifact}: {}", rows.len());
        let (outcome, command) = (at("outcome"), at("command_joint_0.0_rad"));
        for row in &rows {
            assert_eq!(row[outcome].is_empty(), !is_executed, "{artifact}");
            assert_eq!(row[command].is_empty(), !has_commands, "{artifact}");
            // A palm is above the table that it reaches for.
            assert!(row[at("palm_z_m")].parse::<f64>().unwrap() > 0.0);
        }
    }
}

#[test]
fn outcomes_and_partitions_choose_and_names_that_there_are_not_are_refused() {
    let bench = executed();
    let lab = tempfile::tempdir().unwrap();
    let out = lab.path().join("held");
    let chosen = ["csv", "screen.rollouts", "025_mug", "--outcome", "held"];
    let ran = export(bench, &chosen, &out);
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    let (header, rows) = table(&out);
    let at = |name: &str| header.iter().position(|other| other == name).unwrap();
    assert!(!rows.is_empty());
    for row in &rows {
        assert_eq!(
            (row[at("object")].as_str(), row[at("outcome")].as_str()),
            ("025_mug", "held")
        );
    }
    let refused = |arguments: &[&str], out: &Path, expected: &str| {
        let ran = export(bench, arguments, out);
        let said = stderr(&ran);
        assert_eq!(ran.status.code(), Some(2), "{said}");
        assert!(said.contains(expected), "{expected}: {said}");
    };
    let before = fs::read(out.join("motions.csv")).unwrap();
    refused(&chosen, &out, "is there already");
    assert_eq!(fs::read(out.join("motions.csv")).unwrap(), before);
    let other = lab.path().join("other");
    refused(
        &["csv", "screen.rollouts", "025_mag"],
        &other,
        "did you mean `025_mug`?",
    );
    refused(&["lerobot", "ingest.objects"], &other, "has no motions");
    refused(
        &["csv", "refine.candidates", "--outcome", "held"],
        &other,
        "has no outcomes",
    );
    let ran = export(
        bench,
        &["csv", "screen.rollouts", "--outcome", "flown"],
        &other,
    );
    assert_eq!(ran.status.code(), Some(1), "{}", stderr(&ran));
    assert!(
        stderr(&ran).contains("no motion to export"),
        "{}",
        stderr(&ran)
    );
    // Nothing is left of what was refused, or failed.
    let left: Vec<_> = fs::read_dir(lab.path())
        .unwrap()
        .map(|entry| entry.unwrap().file_name())
        .collect();
    assert_eq!(left, ["held"]);
}

#[test]
fn folders_of_other_labs_have_what_their_readers_look_for() {
    let bench = executed();
    let lab = tempfile::tempdir().unwrap();
    let out = lab.path().join("lerobot");
    let ran = export(
        bench,
        &["lerobot", "refine.candidates", "025_mug", "--fps", "25"],
        &out,
    );
    let said = stderr(&ran);
    assert_eq!(ran.status.code(), Some(0), "{said}");
    assert!(
        said.contains("lost   motion between frames: linear between frames at 25 Hz"),
        "{said}"
    );
    let info = fs::read_to_string(out.join("meta/info.json")).unwrap();
    let info: serde_json::Value = serde_json::from_str(&info).unwrap();
    assert_eq!(
        (&info["codebase_version"], &info["fps"]),
        (&"v3.0".into(), &25.into())
    );
    assert_eq!(info["robot_type"], "allegro_right");
    assert_eq!(info["features"]["action"]["names"][7], "joint_0.0_rad");
    for file in [
        "meta/tasks.parquet",
        "meta/stats.json",
        "data/chunk-000/file-000.parquet",
        "README.md",
    ] {
        assert!(out.join(file).is_file(), "{file}");
    }

    let out = lab.path().join("bench");
    let ran = export(
        bench,
        &["dexgraspbench", "screen.rollouts", "--outcome", "held"],
        &out,
    );
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    let grasps = |object: &str| fs::read_dir(out.join("graspdata").join(object)).unwrap();
    let grasp = grasps("025_mug").next().unwrap().unwrap().path();
    let bytes = fs::read(&grasp).unwrap();
    assert!(bytes.starts_with(b"\x93NUMPY"));
    // The folder of the object, as it is found from anywhere.
    let object = out.join("objects/025_mug");
    let named = object.to_str().unwrap();
    assert!(
        bytes
            .windows(named.len())
            .any(|part| part == named.as_bytes())
    );
    for file in [
        "info/simplified.json",
        "mesh/simplified.obj",
        "urdf/meshes/convex_piece_000.obj",
    ] {
        assert!(object.join(file).is_file(), "{file}");
    }
}
