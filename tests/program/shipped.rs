//! Every pipeline file that is shipped, in every command that takes one.

use std::{
    fs,
    io::{BufRead, BufReader},
    process::{Command, Stdio},
};

use dataflow::Pipeline;

use crate::program::{
    bench::{Bench, pipeline_files, stderr},
    cell_lab::Served,
};

/// A pipeline file.
struct Shipped {
    file: String,
    /// Whether a stage sends motions to a cell.
    dispatches: bool,
    /// Whether it reads images instead of recordings.
    reads_views: bool,
}

fn shipped() -> Vec<Shipped> {
    let mut all = Vec::new();
    for path in pipeline_files() {
        let text = fs::read_to_string(&path).unwrap();
        let read = Pipeline::parse(&path, &text, &pipeline::kinds(), None, &[]).unwrap();
        all.push(Shipped {
            file: path.to_str().unwrap().to_owned(),
            dispatches: read
                .stages
                .iter()
                .any(|stage| stage.kind.name == "dispatch"),
            reads_views: read.stages.iter().any(|stage| stage.kind.name == "views"),
        });
    }
    assert!(all.len() > 7 && all.iter().any(|one| one.dispatches));
    all
}

impl Shipped {
    fn name(&self) -> String {
        format!("`{}`", self.file)
    }

    /// The command line of a command on it.
    fn command(&self, command: &str, bench: &Bench) -> Command {
        let mut program = Command::new(env!("CARGO_BIN_EXE_pipeline"));
        program
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .args([command, &self.file, "--lake"])
            .arg(bench.lake());
        program
    }
}

#[test]
fn each_is_planned_and_found_ready() {
    let bench = Bench::new();
    let cloud = bench.root().join("cloud.ply");
    let head = "ply\nformat ascii 1.0\nelement vertex 1";
    let properties = ["x", "y", "z"].map(|axis| format!("property float {axis}\n"));
    let text = format!("{head}\n{}end_header\n0 0 0.5\n", properties.concat());
    fs::write(&cloud, text).unwrap();
    for one in shipped() {
        for command in ["plan", "doctor"] {
            let mut program = one.command(command, &bench);
            let path = if one.reads_views {
                format!("views.path={}", cloud.display())
            } else {
                format!("ingest.root={}", bench.root().display())
            };
            let ran = program.args(["--set", &path]).output().unwrap();
            let said = stderr(&ran);
            assert_eq!(
                ran.status.code(),
                Some(0),
                "{command} {}: {said}",
                one.name()
            );
        }
    }
}

#[test]
fn each_that_dispatches_has_a_cell_and_the_others_say_that_they_have_none() {
    let bench = Bench::new();
    for one in shipped() {
        let mut program = one.command("cell", &bench);
        program.args(["--fast", "--listen", "tcp/127.0.0.1:0"]);
        if !one.dispatches {
            let ran = program.output().unwrap();
            assert_eq!(
                ran.status.code(),
                Some(2),
                "{}: {}",
                one.name(),
                stderr(&ran)
            );
            assert!(stderr(&ran).contains("no stage of kind `dispatch`"));
            continue;
        }
        let program = program.stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut process = program.spawn().unwrap();
        let mut line = String::new();
        let mut said = BufReader::new(process.stdout.take().unwrap());
        said.read_line(&mut line).unwrap();
        let served = Served::of(process);
        assert!(
            line.starts_with("tcp/127.0.0.1:"),
            "{}: {}",
            one.name(),
            served.end()
        );
    }
}

#[test]
fn the_settings_of_the_paper_and_of_its_code_can_be_trained() {
    let bench = Bench::new();
    let root = format!("ingest.root={}", bench.root().display());
    for name in ["paper.toml", "released.toml"] {
        let mut all = shipped().into_iter();
        let one = all.find(|one| one.file.ends_with(name)).unwrap();
        let mut program = one.command("run", &bench);
        program.args(["--until", "train"]);
        for value in [
            root.as_str(),
            "train.unseen_objects=[\"025_mug\"]",
            "train.network.points=64",
            "train.training.epochs=2",
            "train.training.halving_epochs=1",
        ] {
            program.args(["--set", value]);
        }
        let ran = program.output().unwrap();
        let said = stderr(&ran);
        assert_eq!(ran.status.code(), Some(0), "{name}: {said}");
        assert!(said.contains("2 epochs, loss "), "{name}: {said}");
    }
}
