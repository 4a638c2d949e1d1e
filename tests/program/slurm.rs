//! The main job and a sweep of trainings on Slurm itself, of which parts die. They take minutes, and skip
//! unless `PIPELINE_SLURM` is set.

use std::{
    env,
    fs::{self, File},
    path::Path,
    process::{Child, Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use tempfile::TempDir;

use crate::cluster::{Slurm, processes_with, words, workers};
use crate::program::bench::{Bench, stderr};

/// Longest time until something happens.
const LONG: Duration = Duration::from_mins(5);

/// Time for which a controller is away.
const AWAY: Duration = Duration::from_secs(3);

/// Starts it, if these tests are asked for.
fn slurm() -> Option<Slurm> {
    if env::var_os("PIPELINE_SLURM").is_none() {
        measured_data::print_skipped("`PIPELINE_SLURM` is not set: they take minutes");
        return None;
    }
    Slurm::start()
}

#[test]
fn the_main_job_on_slurm_ends_in_the_bytes_of_this_machine() {
    let Some(slurm) = slurm() else { return };
    let here = Bench::new();
    here.run_well(&[]);
    let depot = TempDir::new().unwrap();
    let bench = Bench::new();
    let ran = slurm.with(depot.path(), bench.command("run", &["--on", "slurm"]));
    well(ran);
    pull_and_compare(&slurm, depot.path(), &bench, &here);
}

/// A sweep of four trainings that are long enough to be interrupted.
const SWEEP: [&str; 6] = [
    "--until",
    "train",
    "--set",
    "train.training.epochs=800",
    "--set",
    "train.training.kl_weight=1e-3,2e-3,5e-3,1e-2",
];

#[test]
fn a_sweep_on_slurm_survives_the_death_of_driver_controller_and_node() {
    let Some(slurm) = slurm() else { return };
    let here = Bench::new();
    here.run_well(&SWEEP);
    let depot = TempDir::new().unwrap();
    let bench = Bench::new();
    let arguments = [&SWEEP[..], &["--on", "slurm"]].concat();
    let start = || Life::start(slurm.with(depot.path(), bench.command("run", &arguments)));

    let mut driver = start();
    driver.wait_for_training("variant 1 of 4", depot.path());
    driver.process.kill().unwrap();
    driver.process.wait().unwrap();

    let mut driver = start();
    driver.wait_for_training("variant 2 of 4", depot.path());
    slurm.kill("slurmctld");
    thread::sleep(AWAY);
    slurm.start_again("slurmctld");
    let worker = driver.wait_for_training("variant 3 of 4", depot.path());
    let node = kill_the_node_of(&slurm, &worker);
    let status = driver.process.wait().unwrap();
    let said = driver.said();
    assert!(status.success(), "{said}");
    let lost = said.lines().find(|line| line.starts_with("lost "));
    assert!(
        lost.is_some_and(|lost| lost.contains("train.checkpoint")),
        "{node}: {said}"
    );
    pull_and_compare(&slurm, depot.path(), &bench, &here);
}

/// Asserts that what came from the depot is what was made here.
fn pull_and_compare(slurm: &Slurm, depot: &Path, bench: &Bench, here: &Bench) {
    let on_lake = |command: &str| {
        let mut program = Command::new(env!("CARGO_BIN_EXE_pipeline"));
        program.arg(command).arg("--lake").arg(bench.lake());
        slurm.with(depot, program)
    };
    well(on_lake("pull"));
    let mut verify = on_lake("verify");
    verify.arg("--depot");
    well(verify);
    assert_eq!(bench.published(), here.published());
}

fn well(mut command: Command) {
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
}

/// A run whose process may be killed.
struct Life {
    process: Child,
    folder: TempDir,
}

impl Life {
    fn start(mut run: Command) -> Self {
        let folder = TempDir::new().unwrap();
        let said = File::create(folder.path().join("said")).unwrap();
        let process = run.stdout(Stdio::null()).stderr(said).spawn().unwrap();
        Self { process, folder }
    }

    fn said(&self) -> String {
        fs::read_to_string(self.folder.path().join("said")).unwrap()
    }

    /// Waits until a worker makes the training of a variant; returns it.
    fn wait_for_training(&mut self, variant: &str, depot: &Path) -> String {
        let until = Instant::now() + LONG;
        let mut before = Vec::new();
        loop {
            let said = self.said();
            let since = said.split_once(variant).map_or("", |(_, since)| since);
            let mut now = workers(depot);
            if since.contains("queue  train.checkpoint") {
                now.retain(|worker| !before.contains(worker));
                if let Some(worker) = now.pop() {
                    return worker;
                }
            } else {
                // Those of what came before, which may be ending.
                before = now;
            }
            let ended = self.process.try_wait().unwrap();
            assert!(
                ended.is_none() && Instant::now() < until,
                "{variant}: {said}"
            );
            thread::sleep(Duration::from_millis(50));
        }
    }
}

/// Kills every process of the jobs of a worker's node; returns the node.
fn kill_the_node_of(slurm: &Slurm, worker: &str) -> String {
    let variables = words(worker, "environ");
    let node = variables
        .iter()
        .find_map(|variable| variable.strip_prefix("SLURMD_NODENAME="));
    let node = node.unwrap().to_owned();
    slurm.kill(&format!("slurmd.{node}"));
    for process in processes_with("SLURM_CONF", &slurm.conf()) {
        let is_of_node = |variable: &String| *variable == format!("SLURMD_NODENAME={node}");
        if words(&process, "environ").iter().any(is_of_node) {
            // It may have ended with another.
            let _killed = Command::new("kill").args(["-9", &process]).output();
        }
    }
    node
}
