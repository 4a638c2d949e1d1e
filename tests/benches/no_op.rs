//! Duration of a run that finds everything up to date: the whole process, from start to exit.
//!
//! `cargo bench --bench no_op` makes graphs of five mapped stages in a temporary folder (2.2 GB) and
//! compares the program's time with that of a bare stat, and of a bare stat and hash, of the same
//! files. The stages are those of `tests/own_stages`, linked into this bench: it starts itself.

#![expect(clippy::print_stdout, reason = "a bench prints what it measured")]
#![expect(clippy::unwrap_used, reason = "a bench may break off")]

mod limits;
#[path = "../own_stages/stages.rs"]
mod own_stages;

use std::{
    env,
    fs::{self, File},
    io::Write,
    path::{Path, PathBuf},
    process::{Command, ExitCode, Output},
    thread,
    time::{Duration, Instant, SystemTime},
};

use limits::Limits;
use tempfile::TempDir;

/// Variable with which this program is the pipeline's program, not the bench.
const AS_PROGRAM: &str = "OWN_STAGES_AS_PROGRAM";

/// Times that each command is run.
const N_TIMES: usize = 20;

/// Wall time that a run of 1,000 units may take, and the one aimed at, in milliseconds.
const LIMIT_MS: f64 = 50.0;
const GOAL_MS: f64 = 20.0;

/// Greatest growth of the time, as a factor, with ten times the partitions.
const MAX_TIMES_LONGER: f64 = 12.0;

/// Relative difference of the least of the times from run to run, with other programs beside.
const NOISE: f64 = 0.2;

fn main() -> ExitCode {
    if env::var_os(AS_PROGRAM).is_some() {
        return pipeline::command_line(&own_stages::kinds_with(|_| 1));
    }
    println!(
        "{:<44} {:>10} {:>10}",
        "up to date, wall time of", "median", "least"
    );
    row("the program's start (`stages`)", &times(|| bare("stages")));

    let graph = Graph::new(200, 1 << 20);
    let files = graph.files();
    let n_files = files.len();
    let stats = times(|| {
        for path in &files {
            std::hint::black_box(fs::metadata(path).unwrap());
        }
    });
    row(&format!("stat of the {n_files} files"), &stats);
    let hashing = repeat(3, || {
        for path in &files {
            hash(path);
        }
    });
    row(&format!("stat and BLAKE3 of the {n_files} files"), &hashing);
    let run = times(|| graph.run());
    row("run, 5 stages x 200 partitions of 1 MiB", &run);
    row("plan of the same", &times(|| graph.plan()));
    println!("{:<44} {GOAL_MS:>7.1} ms", "  aimed at");
    let mut limits = Limits::with_noise(NOISE);
    // Other programs only add to a time.
    limits.keep("run, least, ms", least(&run), ..=LIMIT_MS);
    drop(graph);

    let few = Graph::new(200, 4096);
    let few = times(|| few.run());
    row("run, 5 stages x 200 partitions of 4 KiB", &few);
    let many = Graph::new(2000, 4096);
    let many = times(|| many.run());
    row("run, 5 stages x 2000 partitions of 4 KiB", &many);
    println!(
        "{:<44} {:>7.1} x  {:>7.1} x",
        "  times longer",
        median(&many) / median(&few),
        least(&many) / least(&few)
    );
    let longer = least(&many) / least(&few);
    limits.keep(
        "ten times the partitions over one time",
        longer,
        ..=MAX_TIMES_LONGER,
    );
    bundled_sample();
    limits.end()
}

/// Five mapped stages, everything made.
struct Graph {
    folder: TempDir,
}

impl Graph {
    fn new(n_partitions: usize, size: usize) -> Self {
        let graph = Self {
            folder: TempDir::new().unwrap(),
        };
        let inputs = graph.folder.path().join("inputs");
        fs::create_dir(&inputs).unwrap();
        // Files that have not changed for long, as recordings have not.
        let hour = Duration::from_hours(1);
        let written = SystemTime::UNIX_EPOCH + 400_000 * hour;
        let mut bytes = vec![0; size];
        for number in 0..n_partitions {
            let name = format!("p{number:04}");
            let mut reader = blake3::Hasher::new().update(name.as_bytes()).finalize_xof();
            reader.fill(&mut bytes);
            let mut file = File::create(inputs.join(format!("{name}.bin"))).unwrap();
            file.write_all(&bytes).unwrap();
            file.set_modified(written).unwrap();
        }
        let mut text = format!(
            "seed = 7\n\n[stages.stage_0]\nkind = \"split\"\nroot = \"{}\"\n",
            inputs.display()
        );
        for stage in 1..5 {
            text.push_str(&format!(
                "[stages.stage_{stage}]\nkind = \"map\"\nadd = 1\ninputs.parts = \"stage_{}.parts\"\n",
                stage - 1
            ));
        }
        let mut file = File::create(graph.folder.path().join("graph.toml")).unwrap();
        file.write_all(text.as_bytes()).unwrap();
        succeed(graph.command("run"));
        // A file written just now is not trusted by its time alone; soon it is.
        thread::sleep(Duration::from_secs(3));
        graph.run();
        let again = succeed(graph.command("run"));
        let said = String::from_utf8_lossy(&again.stderr).into_owned();
        assert!(said.contains("nothing to run"), "{said}");
        graph
    }

    fn command(&self, command: &str) -> Command {
        let mut program = own_program();
        program
            .arg(command)
            .arg(self.folder.path().join("graph.toml"))
            .arg("--lake")
            .arg(self.folder.path().join("lake"));
        program
    }

    fn run(&self) {
        succeed(self.command("run"));
    }

    fn plan(&self) {
        succeed(self.command("plan"));
    }

    /// The input files and the artifacts.
    fn files(&self) -> Vec<PathBuf> {
        let mut files = Vec::new();
        for folder in ["inputs", "lake/files"] {
            collect(&self.folder.path().join(folder), &mut files);
        }
        files
    }
}

/// The same command on the bundled sample, where it has been run.
fn bundled_sample() {
    let command = |command: &str| {
        let mut program = Command::new(env!("CARGO_BIN_EXE_pipeline"));
        program
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .env_remove("PIPELINE_DEPOT")
            .args([command, "pipelines/cgf.toml"]);
        program
    };
    let planned = command("plan").output().unwrap();
    if String::from_utf8_lossy(&planned.stdout).contains("nothing to run") {
        row(
            "pipeline run pipelines/cgf.toml",
            &times(|| drop(succeed(command("run")))),
        );
    } else {
        println!("pipelines/cgf.toml is not up to date here: `pipeline run pipelines/cgf.toml`");
    }
}

fn own_program() -> Command {
    let mut program = Command::new(env::current_exe().unwrap());
    program.env(AS_PROGRAM, "1").env_remove("PIPELINE_DEPOT");
    program
}

fn bare(command: &str) {
    let mut program = own_program();
    program.arg(command);
    succeed(program);
}

fn succeed(mut command: Command) -> Output {
    let output = command.output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {said}");
    output
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            collect(&path, files);
        } else {
            files.push(path);
        }
    }
}

fn hash(path: &Path) {
    let mut file = File::open(path).unwrap();
    file.metadata().unwrap();
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(&mut file).unwrap();
    std::hint::black_box(hasher.finalize());
}

fn times(work: impl FnMut()) -> Vec<f64> {
    repeat(N_TIMES, work)
}

/// Milliseconds that some work takes each time, in order of size.
fn repeat(n_times: usize, mut work: impl FnMut()) -> Vec<f64> {
    let mut times: Vec<f64> = (0..n_times)
        .map(|_| {
            let started = Instant::now();
            work();
            started.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times
}

fn median(times: &[f64]) -> f64 {
    times[times.len() / 2]
}

fn least(times: &[f64]) -> f64 {
    times[0]
}

fn row(what: &str, times: &[f64]) {
    println!(
        "{what:<44} {:>7.1} ms {:>7.1} ms",
        median(times),
        least(times)
    );
}
