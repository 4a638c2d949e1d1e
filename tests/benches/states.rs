//! Compares builds of several commits: the size of the program, one main job each, then start and cached run in turns.
//!
//! `cargo bench --bench states -- FOLDER…` takes clones of this repository in which `cargo build --release` has been
//! run, and prints a row for each. The main job is made once in a lake of its own; the rest are medians of 20.

#![expect(clippy::print_stdout, reason = "a bench prints what it measured")]
#![expect(clippy::unwrap_used, reason = "a bench may break off")]

mod shell_times;

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::{Command, ExitCode, Output, Stdio},
    thread,
    time::{Duration, Instant, SystemTime},
};

use shell_times::children_s;
use tempfile::TempDir;

/// Times that each short command is run.
const N_TIMES: usize = 20;
const JOB: [&str; 3] = ["run", "pipelines/cgf.toml", "--lake"];

fn main() -> ExitCode {
    // Cargo adds `--bench`.
    let folders = env::args().skip(1).filter(|name| !name.starts_with("--"));
    let states: Vec<State> = folders.map(|folder| State::of(&folder)).collect();
    if states.is_empty() {
        println!(
            "no state of the tree to measure: name the folders of clones that have been built"
        );
        return ExitCode::FAILURE;
    }
    let jobs: Vec<Job> = states.iter().map(State::make).collect();
    // A file written just now is not trusted by its time alone; soon it is.
    thread::sleep(Duration::from_secs(3));
    for state in &states {
        let said = state.succeed(&state.job());
        let said = [said.stdout, said.stderr].concat();
        let said = String::from_utf8_lossy(&said);
        assert!(said.contains("nothing to run"), "{said}");
    }
    let starts = in_turns(&states, |state| {
        state.succeed(&["stages".into()]);
    });
    let cached = in_turns(&states, |state| {
        state.succeed(&state.job());
    });
    println!("| state | program | start | cached run | main job | its CPU time |");
    println!("| --- | --- | --- | --- | --- | --- |");
    for (((state, job), start), cached) in states.iter().zip(jobs).zip(starts).zip(cached) {
        println!(
            "| {} | {:.0} MB | {start} | {cached} | {:.0} s | {:.0} s |",
            state.commit, state.megabytes, job.wall_s, job.cpu_s
        );
    }
    ExitCode::SUCCESS
}

/// A built clone, with a lake of its own.
struct State {
    folder: PathBuf,
    commit: String,
    megabytes: f64,
    /// A copy, for one that the linker has just written starts slower.
    program: PathBuf,
    lake: TempDir,
}

/// What a run of the main job took.
struct Job {
    wall_s: f64,
    cpu_s: f64,
}

impl State {
    fn of(folder: &str) -> Self {
        let built = Path::new(folder).join("target/release/pipeline");
        let lake = tempfile::tempdir().unwrap();
        let program = lake.path().join("pipeline");
        let advice = "build it with `cargo build --release`";
        if let Err(err) = fs::copy(&built, &program) {
            panic!("`{}`: {err}; {advice}", built.display());
        }
        let commit = git(folder, &["describe", "--always", "--dirty", "--abbrev=8"]);
        let committed = git(folder, &["log", "-1", "--format=%ct"]);
        let committed = SystemTime::UNIX_EPOCH + Duration::from_secs(committed.parse().unwrap());
        let metadata = fs::metadata(&built).unwrap();
        assert!(
            metadata.modified().unwrap() >= committed,
            "`{}` is older than the commit {commit}; {advice}",
            built.display()
        );
        Self {
            folder: folder.into(),
            commit,
            megabytes: 1e-6 * metadata.len() as f64,
            program,
            lake,
        }
    }

    fn job(&self) -> Vec<PathBuf> {
        let lake = self.lake.path().join("lake");
        JOB.iter().map(PathBuf::from).chain([lake]).collect()
    }

    fn succeed(&self, arguments: &[PathBuf]) -> Output {
        let mut command = Command::new(&self.program);
        command
            .args(arguments)
            .current_dir(&self.folder)
            .env_remove("PIPELINE_DEPOT");
        let output = command.output().unwrap();
        assert!(
            output.status.success(),
            "{command:?}: {}",
            String::from_utf8_lossy(&output.stderr)
        );
        output
    }

    /// Makes the main job; the shell says the processor time of what it started.
    fn make(&self) -> Job {
        let mut shell = Command::new("sh");
        shell.args(["-c", "\"$@\" >/dev/null || exit 1; times", "sh"]);
        shell
            .arg(&self.program)
            .args(self.job())
            .current_dir(&self.folder);
        shell.env_remove("PIPELINE_DEPOT").stderr(Stdio::inherit());
        let before = Instant::now();
        let output = shell.output().unwrap();
        assert!(
            output.status.success(),
            "{}: the main job failed",
            self.commit
        );
        let wall_s = before.elapsed().as_secs_f64();
        Job {
            wall_s,
            cpu_s: children_s(&String::from_utf8(output.stdout).unwrap()),
        }
    }
}

/// What git says of a clone.
fn git(folder: &str, arguments: &[&str]) -> String {
    let output = Command::new("git")
        .args(["-C", folder])
        .args(arguments)
        .output()
        .unwrap();
    assert!(output.status.success(), "`{folder}` is no clone");
    String::from_utf8(output.stdout).unwrap().trim().to_owned()
}

/// Times a command of every state in turns: the median, and the least and the greatest, of each.
fn in_turns(states: &[State], run: impl Fn(&State)) -> Vec<String> {
    let mut times = vec![Vec::new(); states.len()];
    for _ in 0..N_TIMES {
        for (state, times) in states.iter().zip(&mut times) {
            let before = Instant::now();
            run(state);
            times.push(1e3 * before.elapsed().as_secs_f64());
        }
    }
    let lines = times.into_iter().map(|mut times| {
        times.sort_by(f64::total_cmp);
        let (least, most) = (times[0], times[N_TIMES - 1]);
        format!("{:.1} ms ({least:.1} to {most:.1})", times[N_TIMES / 2])
    });
    lines.collect()
}
