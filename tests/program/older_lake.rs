//! A lake of the version before this one is still read: `older_lake.tar.gz` is that of a small `replay.toml`, with
//! `candidates/4` and `rollouts/6`.

use std::process::{Command, Output};

use tempfile::TempDir;

use crate::program::bench::{stderr, stdout};

#[test]
fn a_lake_of_the_version_before_still_answers() {
    let folder = TempDir::new().unwrap();
    let archive = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/tests/program/older_lake.tar.gz"
    );
    let mut unpack = Command::new("tar");
    unpack.args(["-xzf", archive, "-C"]).arg(folder.path());
    assert!(unpack.status().unwrap().success());
    let ask = |arguments: &[&str]| -> Output {
        let mut program = Command::new(env!("CARGO_BIN_EXE_pipeline"));
        program.args(arguments).current_dir(folder.path());
        let output = program.args(["--lake", "lake"]).output().unwrap();
        assert_eq!(
            output.status.code(),
            Some(0),
            "{arguments:?}: {}",
            stderr(&output)
        );
        output
    };
    assert!(stdout(&ask(&["runs"])).contains("replay"));
    let asked = ask(&[
        "query",
        "--run",
        "1",
        "select r.success, c.depth_m, r.paper_joints_position > 0 as moves from rollouts r \
         join candidates c on r.candidate_id = c.candidate_id",
        "--format",
        "json",
    ]);
    let rows = stdout(&asked);
    assert_eq!(
        rows.trim(),
        r#"{"success":true,"depth_m":0.0,"moves":true}"#,
        "{rows}"
    );
    let page = folder.path().join("page");
    ask(&["report", "1", "--out", page.to_str().unwrap()]);
    let page = std::fs::read_to_string(page.join("index.html")).unwrap();
    assert!(page.contains("004_sugar_box"));
    assert!(stdout(&ask(&["inspect", "screen.rollouts", "--run", "1"])).contains("success"));
}
