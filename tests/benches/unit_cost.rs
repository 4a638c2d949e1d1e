//! Processor time of a unit that copies a few bytes: by threads, by processes, by the jobs of Slurm, by make and by
//! Snakemake, one after the other on the same machine.
//!
//! `PIPELINE_PYTHON=/path/to/python-with-snakemake cargo bench --bench unit_cost`, as root with Debian's `slurm-wlm`
//! and `munge`. Every way runs the same script for each unit, two at once. The time is that of the processes that end
//! below the command and, with Slurm, of its workers; Slurm's own daemons are left out, the shells of its jobs too.

#![expect(clippy::print_stdout, reason = "a bench prints what it measured")]
#![expect(clippy::unwrap_used, reason = "a bench may break off")]

#[path = "../slurm/cluster.rs"]
#[expect(dead_code, reason = "tests kill its daemons")]
mod cluster;
#[path = "../folder.rs"]
mod folder;
mod limits;
#[path = "../own_stages/stages.rs"]
mod own_stages;
mod shell_times;

use std::{
    env, fs,
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
    process::{Command, ExitCode, Stdio},
    time::Instant,
};

use cluster::Slurm;
use limits::Limits;
use shell_times::children_s;
use tempfile::TempDir;

/// Variable with which this program is the pipeline's program, not the bench.
const AS_PROGRAM: &str = "OWN_STAGES_AS_PROGRAM";

/// Number of units.
const N_UNITS: usize = 300;

/// Rounds, of which the cheapest counts.
const ROUNDS: usize = 3;

/// Most processor time of a unit by processes and by jobs, in milliseconds.
const MAX_MS: f64 = 20.0;

/// Relative difference of processor time from run to run.
const NOISE: f64 = 0.1;

/// What makes a unit.
const COPY: &str = "cat \"$1\" > \"$2\"\n";

/// Adds the processor time of all processes that have ended below it to a file.
const TIMED: &str = "#!/bin/sh\nOWN_STAGES_AS_PROGRAM=1 PROGRAM \"$@\"\ncode=$?\ntimes > \"TIMES/$$-$(cat /proc/sys/kernel/random/uuid)\"\nexit $code\n";

fn main() -> ExitCode {
    if env::var_os(AS_PROGRAM).is_some() {
        return pipeline::command_line(&own_stages::kinds_with(|_| 1));
    }
    let slurm = Slurm::start();
    let mut limits = Limits::with_noise(NOISE);
    println!(
        "{:<28} {:>14} {:>14}",
        "by", "CPU, ms/unit", "wall, ms/unit"
    );
    let mut row = |name: &str, limit: Option<f64>, measure: &dyn Fn() -> Option<Cost>| {
        let rounds = (0..ROUNDS).map_while(|_| measure());
        let best = rounds.min_by(|a, b| a.cpu_ms.total_cmp(&b.cpu_ms));
        let Some(best) = best else {
            println!("{name:<28} {:>14} {:>14}", "skipped", "");
            return;
        };
        println!("{name:<28} {:>14.1} {:>14.1}", best.cpu_ms, best.wall_ms);
        if let Some(limit) = limit {
            limits.keep(name, best.cpu_ms, ..=limit);
        }
    };
    row("make -j2", None, &|| Lab::new().make());
    row("Snakemake -j2", None, &|| Lab::new().snakemake());
    let alone = |_: &Path, run: Command| run;
    let with_depot = |depot: &Path, mut run: Command| {
        run.env("PIPELINE_DEPOT", depot);
        run
    };
    row("threads", None, &|| Lab::new().run(&[], &alone));
    row("threads, a folder as depot", None, &|| {
        Lab::new().run(&[], &with_depot)
    });
    row("--processes", Some(MAX_MS), &|| {
        Lab::new().run(&["--processes"], &alone)
    });
    row("--on slurm", Some(MAX_MS), &|| {
        let slurm = slurm.as_ref()?;
        Lab::new().run(&["--on", "slurm"], &|depot, run| slurm.with(depot, run))
    });
    limits.end()
}

/// Cost of a unit in milliseconds.
struct Cost {
    cpu_ms: f64,
    wall_ms: f64,
}

/// A folder with inputs, and what makes units of them.
struct Lab(TempDir);

impl Lab {
    fn new() -> Self {
        let lab = Self(TempDir::new().unwrap());
        // Jobs of Slurm are no processes of this one: what they read must be open to them.
        fs::set_permissions(lab.0.path(), fs::Permissions::from_mode(0o755)).unwrap();
        for folder in ["inputs", "out", "depot", "times"] {
            fs::create_dir(lab.path(folder)).unwrap();
        }
        for number in 0..N_UNITS {
            lab.write(&format!("inputs/p{number:03}.bin"), &number.to_string());
        }
        lab.write("copy.sh", COPY);
        lab.write("unit.sh", "cat in/parts/*/data.bin > out/data.bin\n");
        lab.write("copies.toml", include_str!("unit_cost/copies.toml"));
        lab.write("Makefile", include_str!("unit_cost/Makefile"));
        lab.write("Snakefile", include_str!("unit_cost/Snakefile"));
        lab.write("pipeline.sh", TIMED);
        let program = lab.path("pipeline.sh");
        fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
        let table = format!("[slurm]\nprogram = \"{}\"\n", program.display());
        lab.write("executors.toml", &table);
        lab
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes a file, in which words in capitals stand for paths.
    fn write(&self, name: &str, text: &str) {
        let text = text.replace("COPY", &self.path("copy.sh").display().to_string());
        let text = text.replace("UNIT", &self.path("unit.sh").display().to_string());
        let text = text.replace("INPUTS", &self.path("inputs").display().to_string());
        let text = text.replace("TIMES", &self.path("times").display().to_string());
        let text = text.replace(
            "PROGRAM",
            &env::current_exe().unwrap().display().to_string(),
        );
        fs::write(self.path(name), text).unwrap();
    }

    fn make(&self) -> Option<Cost> {
        let mut make = Command::new("make");
        self.measure(make.args(["-j2", "-s"]))
    }

    fn snakemake(&self) -> Option<Cost> {
        let mut snakemake = Command::new(env::var_os("PIPELINE_PYTHON")?);
        self.measure(snakemake.args(["-m", "snakemake", "-j2", "-q", "all"]))
    }

    /// Makes the units with these arguments, after their inputs.
    fn run(&self, arguments: &[&str], on: &dyn Fn(&Path, Command) -> Command) -> Option<Cost> {
        let on = |run| on(&self.path("depot"), run);
        let mut inputs = on(self.command(&["--until", "split"]));
        assert!(quiet(&mut inputs).status().unwrap().success());
        let mut run = on(self.command(arguments));
        run.env("PIPELINE_EXECUTORS", self.path("executors.toml"));
        fs::remove_dir_all(self.path("times")).unwrap();
        fs::create_dir(self.path("times")).unwrap();
        self.measure(&mut run)
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut run = Command::new(env::current_exe().unwrap());
        run.env(AS_PROGRAM, "1").env_remove("PIPELINE_DEPOT");
        run.args(["run", "copies.toml", "--jobs", "2", "--lake"]);
        run.arg(self.path("lake")).args(arguments);
        run.current_dir(self.0.path());
        run
    }

    /// Runs a command below a shell, which says how much time it took; `None` if it fails.
    fn measure(&self, command: &mut Command) -> Option<Cost> {
        let mut shell = Command::new("sh");
        shell.args(["-c", "\"$@\" && times > times/run", "sh"]);
        shell.arg(command.get_program()).args(command.get_args());
        for (name, value) in command.get_envs() {
            match value {
                Some(value) => shell.env(name, value),
                None => shell.env_remove(name),
            };
        }
        let began = Instant::now();
        let status = quiet(&mut shell).current_dir(self.0.path()).status();
        let wall_s = began.elapsed().as_secs_f64();
        status.unwrap().success().then_some(())?;
        let files = fs::read_dir(self.path("times")).unwrap();
        let cpu_s: f64 = files
            .map(|file| children_s(&fs::read_to_string(file.unwrap().path()).unwrap()))
            .sum();
        Some(Cost {
            cpu_ms: 1e3 * cpu_s / N_UNITS as f64,
            wall_ms: 1e3 * wall_s / N_UNITS as f64,
        })
    }
}

fn quiet(command: &mut Command) -> &mut Command {
    command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
}
