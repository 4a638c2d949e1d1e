//! A failed write to stdout is an error; a closed pipe is not.

use std::{
    fs::File,
    process::{Command, Output, Stdio},
};

use crate::program::{
    bench::{Bench, first, stderr},
    commands::{finished, subcommands},
};

/// Commands that only say on stderr what they did.
const WITHOUT_DATA: [&str; 5] = ["new", "tag", "untag", "push", "pull"];

/// Commands that need a run in the background, which `tests/engine/detached.rs` tries.
const OF_DETACHED_RUNS: [&str; 1] = ["attach"];

/// Commands that go on until they are interrupted, and print where they listen.
const SERVING: [&[&str]; 2] = [
    &["cell", "--listen", "tcp/127.0.0.1:0"],
    &["router", "--listen", "tcp/127.0.0.1:0"],
];

/// Measurements for a calibration.
const MEASURED: &str = "crates/robotics/calibration/tests/golden/fixed.json";

/// Every command that writes data and ends, in every form.
fn commands(bench: &Bench) -> Vec<Command> {
    let plain: [&[&str]; 33] = [
        &["query", "select * from demonstrations"],
        &["query", "select * from objects", "--format", "csv"],
        &["query", "select * from objects", "--format", "json"],
        &["query", "select * from objects", "--format", "parquet"],
        &["inspect", "ingest.objects"],
        &["inspect", "ingest.objects", "--skipped"],
        &["runs"],
        &["runs", "--format", "json"],
        &["diff", "newest", "newest", "--format", "json"],
        &["lineage", "retarget.tracking"],
        &["lineage", "retarget.tracking", "--format", "json"],
        &["stages"],
        &["stages", "train"],
        &["graph", "pipelines/cgf.toml"],
        &["graph", "pipelines/cgf.toml", "--format", "dot"],
        &["graph", "pipelines/cgf.toml", "--format", "mermaid"],
        &["doctor"],
        &["doctor", "--robot", "data/robots/allegro_right.urdf"],
        &["calibrate", MEASURED],
        &["calibrate", MEASURED, "--format", "json"],
        &["verify", "--format", "json"],
        &["gc", "--dry-run", "--format", "json"],
        &["completions", "bash"],
        &["completions", "elvish"],
        &["completions", "fish"],
        &["completions", "powershell"],
        &["completions", "zsh"],
        &["help"],
        &["help", "run"],
        &["--help"],
        &["run", "-h"],
        &["--version"],
        &["stages", "screen", "--quiet"],
    ];
    let small: [(&str, &[&str]); 5] = [
        ("plan", &[]),
        ("plan", &["--format", "json"]),
        ("plan", &["--until", "ingest"]),
        ("run", &["--dry-run"]),
        ("unit", &["ingest.objects", "025_mug"]),
    ];
    let plain = plain.iter().map(|arguments| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pipeline"));
        command
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .args(*arguments);
        if arguments[0] != "help" {
            command.arg("--lake").arg(bench.lake());
        }
        command
    });
    let small = small.iter();
    let small = small.map(|(command, arguments)| bench.command(command, arguments));
    let beside = |name: &str| bench.lake().with_file_name(name).display().to_string();
    let trajectories = bench.lake().join("files/cgf/retarget/trajectories");
    let motion = first(&trajectories, |_| true);
    let motion = motion.file_name().unwrap().to_str().unwrap();
    let written = [
        vec!["report".to_owned(), "--out".to_owned(), beside("report")],
        [
            "export",
            "glb",
            "retarget.trajectories",
            motion,
            "--out",
            &beside("motion.glb"),
        ]
        .map(str::to_owned)
        .to_vec(),
    ];
    let written = written.map(|arguments| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pipeline"));
        command
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .args(arguments)
            .arg("--lake")
            .arg(bench.lake());
        command
    });
    plain.chain(small).chain(written).collect()
}

fn with_stdout(command: &mut Command, stdout: impl Into<Stdio>) -> Output {
    command
        .stdout(stdout)
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
        .wait_with_output()
        .unwrap()
}

/// A file whose disk is full.
fn full() -> File {
    File::options().write(true).open("/dev/full").unwrap()
}

#[test]
fn data_for_which_the_disk_has_no_space_is_an_error_of_every_command() {
    let bench = finished();
    let mut commands = commands(bench);
    for name in subcommands() {
        let is_tried = |command: &Command| command.get_args().next().unwrap() == &name[..];
        let serves = SERVING.iter().any(|serving| serving[0] == name);
        assert!(
            commands.iter().any(is_tried)
                || serves
                || WITHOUT_DATA.contains(&&name[..])
                || OF_DETACHED_RUNS.contains(&&name[..]),
            "{name}"
        );
    }
    for serving in SERVING {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pipeline"));
        command
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .args(serving)
            .arg("--lake")
            .arg(bench.lake());
        commands.push(command);
    }
    for mut command in commands {
        let output = with_stdout(&mut command, full());
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{command:?}: {text}");
        let says = "error: cannot write to standard output: no space left on the disk";
        assert!(text.contains(says), "{command:?}: {text}");
    }
}

#[test]
fn closed_output_pipe_is_not_an_error() {
    for mut command in commands(finished()) {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let output = with_stdout(&mut command, writer);
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(0), "{command:?}: {text}");
        assert!(!text.contains("error"), "{command:?}: {text}");
        assert!(!text.contains("panic"), "{command:?}: {text}");
    }
}
