//! Units made by the jobs of Slurm itself, some of whose processes are killed. `PIPELINE_KILLS` sets the number of
//! times that each is killed; without it the daemons are killed once, early. `PIPELINE_BAD_MINUTES` sets the number of
//! runs whose driver is killed, and of those whose depot is away for at most `PIPELINE_AWAY_S` seconds.

use std::{
    fs,
    process::Command,
    thread,
    time::{Duration, Instant},
};

use rand::Rng;

use crate::cluster::{Slurm, processes_with, workers};
use crate::engine::{
    elsewhere::graph,
    hiccups::away_for,
    place::{
        CHAIN, LONG, Place, Running, assert_same, chances, number, published, stderr, stdout, well,
    },
};
use crate::folder;

#[test]
fn slurm_gives_the_bytes_of_threads() {
    let Some(slurm) = Slurm::start() else { return };
    let depot = folder::in_memory();
    let (place, n_units) = graph();
    let arguments = ["--on", "slurm"];
    well(slurm.with(depot.path(), place.command("run", &arguments)));
    assert_eq!(place.take_log().len(), n_units);
    well(slurm.with(depot.path(), place.bare(&place.lake(), "pull")));
    let expected = place.undisturbed(&[]);
    assert_same(&place.published(), &expected, "sbatch");

    let other = folder::in_memory();
    let lake = place.path("lake_of_srun");
    well(slurm.with(
        other.path(),
        place.command_in(&lake, "run", &["--on", "srun"]),
    ));
    assert_eq!(place.take_log().len(), n_units);
    well(slurm.with(other.path(), place.bare(&lake, "pull")));
    assert_same(&published(&lake), &expected, "srun");
    let doctor = slurm
        .with(depot.path(), place.command("doctor", &arguments))
        .output()
        .unwrap();
    assert!(
        stdout(&doctor).contains("a worker on `"),
        "{}",
        stderr(&doctor)
    );
}

/// Two units with resources, on Slurm.
fn with_resources(resources: &str) -> Place {
    let more = format!("\n[stages.split.resources]\n{resources}\n");
    Place::with_inputs(&format!("{CHAIN}{more}"), 2)
}

#[test]
fn slurm_says_at_once_what_no_job_of_it_can_have() {
    let Some(slurm) = Slurm::start() else { return };
    for (resources, parts) in [
        (
            "cores = 64",
            [
                "never starts the jobs of `split.parts`: PartitionConfig",
                "`cores = 64`",
            ],
        ),
        (
            "memory_gb = 500",
            [
                "takes no jobs",
                "Requested node configuration is not available",
            ],
        ),
        (
            "partition = \"short\"\ntime_min = 5",
            [
                "never starts the jobs of `split.parts`: PartitionTimeLimit",
                "`time_min = 5`",
            ],
        ),
        (
            "partition = \"none\"",
            ["takes no jobs", "invalid partition"],
        ),
    ] {
        let depot = folder::in_memory();
        let place = with_resources(resources);
        let began = Instant::now();
        let run = place.command("run", &["--on", "slurm", "--until", "split"]);
        let ran = slurm.with(depot.path(), run).output().unwrap();
        let said = stderr(&ran);
        assert_eq!(ran.status.code(), Some(1), "{said}");
        for part in parts {
            assert!(said.contains(part), "{resources}: {said}");
        }
        assert!(
            began.elapsed() < LONG / 2,
            "{resources}: {:?}",
            began.elapsed()
        );
        let doctor = place.command("doctor", &["--on", "slurm"]);
        let doctor = slurm.with(depot.path(), doctor).output().unwrap();
        let said = stdout(&doctor);
        let is_told = said.contains("missing  slurm, split");
        // Slurm's own test does not know the limit of a partition.
        assert_eq!(
            is_told,
            !resources.contains("time_min"),
            "{resources}: {said}"
        );
    }
}

#[test]
fn a_job_without_enough_time_is_tried_once() {
    let Some(slurm) = Slurm::start() else { return };
    let depot = folder::in_memory();
    let place = with_resources("time_min = 1");
    let run = place.held(&["--on", "slurm", "--until", "split"]);
    let mut run = Running::start(slurm.with(depot.path(), run));
    run.wait_for(&place, "p000");
    let (code, said) = run.finish();
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("needed more than 1 min 00 s"), "{said}");
    assert!(
        said.contains("raise `time_min` in `resources` of `[stages.split]`"),
        "{said}"
    );
    assert_eq!(place.take_log().len(), 2, "each once: {said}");
}

#[test]
fn a_job_that_is_preempted_is_tried_again() {
    let Some(slurm) = Slurm::start() else { return };
    let depot = folder::in_memory();
    let place = with_resources("cores = 2");
    let run = place.held(&["--on", "slurm", "--until", "split"]);
    let mut run = Running::start(slurm.with(depot.path(), run));
    for partition in ["p000", "p001"] {
        run.wait_for(&place, partition);
    }
    for n_preempted in 1..=4 {
        let mut urgent = Command::new("srun");
        urgent.args([
            "--partition=urgent",
            "--cpus-per-task=2",
            "--nodes=2",
            "true",
        ]);
        let ran = slurm.with(depot.path(), urgent).output().unwrap();
        assert!(ran.status.success(), "{}", stderr(&ran));
        let until = Instant::now() + LONG;
        while place.log().len() < 2 * (n_preempted + 1) {
            assert!(Instant::now() < until, "not begun again");
            thread::sleep(Duration::from_millis(100));
        }
    }
    for partition in ["p000", "p001"] {
        place.let_go(partition);
    }
    let (code, said) = run.finish();
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(said.matches("ended as PREEMPTED").count(), 8, "{said}");
}

#[test]
fn a_run_says_where_its_units_are_and_how_long_the_others_take() {
    let Some(slurm) = Slurm::start() else { return };
    let depot = folder::in_memory();
    let place = Place::with_inputs(CHAIN, 3);
    let run = place.held(&["--on", "slurm", "--until", "split"]);
    let began = Instant::now();
    let mut run = Running::start(slurm.with(depot.path(), run));
    for partition in ["p000", "p001", "p002"] {
        run.wait_for(&place, partition);
    }
    thread::sleep(Duration::from_secs(6));
    place.let_go("p000");
    let mut said = String::new();
    run.wait_for_line("how long the others take", |line| {
        said = line.to_owned();
        line.contains(" left")
    });
    let passed_s = began.elapsed().as_secs_f64();
    assert!(
        said.starts_with("queue  split.parts on slurm: 1 of 3 units made, "),
        "{said}"
    );
    assert!(said.contains(" on n1") || said.contains(" on n2"), "{said}");
    // The other two take twice the time of the first.
    let left_s: f64 = said
        .rsplit("about ")
        .next()
        .unwrap()
        .trim_end_matches(" s left")
        .parse()
        .unwrap();
    // The line rounds to a tenth of a second.
    assert!(
        (12.0..=2.0 * passed_s + 0.05).contains(&left_s),
        "{said} after {passed_s} s"
    );
    place.let_go("p001");
    place.let_go("p002");
    let (code, said) = run.finish();
    assert_eq!(code, Some(0), "{said}");
}

/// A process of Slurm, or of a job of it.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Part {
    /// The controller, which is started again.
    Controller,
    /// The daemons of both nodes, which are started again.
    Nodes,
    /// The step daemon of a job on its node.
    Step,
    /// The worker that makes the units of a job.
    Worker,
}

/// Time of the kill, after the submission.
#[derive(Clone, Copy, Debug)]
enum Moment {
    /// Within 2 s.
    Early,
    /// After 8 s.
    Late,
}

/// Time for which a daemon that was killed is away.
const AWAY: Duration = Duration::from_secs(2);

#[test]
fn a_run_survives_the_death_of_the_controller() {
    survives_deaths_of(Part::Controller);
}

#[test]
fn a_run_survives_the_death_of_the_nodes() {
    survives_deaths_of(Part::Nodes);
}

#[test]
fn a_run_survives_the_death_of_what_makes_its_units() {
    survives_deaths_of(Part::Worker);
    if number::<usize>("PIPELINE_KILLS", 0) > 0 {
        survives_deaths_of(Part::Step);
    }
}

fn survives_deaths_of(part: Part) {
    let n_rounds = number::<usize>("PIPELINE_KILLS", 0);
    let moments = match n_rounds {
        0 => vec![Moment::Early],
        n_rounds => [Moment::Early, Moment::Late].repeat(n_rounds),
    };
    for moment in moments {
        // One whose job steps were killed may hold their nodes for ever.
        let Some(slurm) = Slurm::start() else { return };
        survives(&slurm, part, moment);
    }
}

/// Has two units made by jobs that wait until a process is killed.
fn survives(slurm: &Slurm, part: Part, moment: Moment) {
    let began = Instant::now();
    let depot = folder::in_memory();
    let place = Place::with_inputs(CHAIN, 2);
    let arguments = ["--on", "slurm", "--until", "split"];
    let mut run = Running::start(slurm.with(depot.path(), place.held(&arguments)));
    match (moment, part) {
        (Moment::Late, _) => {
            run.wait_for(&place, "p000");
            thread::sleep(Duration::from_secs(8));
        }
        // It must be there.
        (Moment::Early, Part::Step | Part::Worker) => run.wait_for(&place, "p000"),
        (Moment::Early, _) => {
            let until = Instant::now() + LONG;
            while fs::read_dir(depot.path().join("messages/waves")).is_err() {
                assert!(Instant::now() < until, "nothing is submitted");
                thread::park_timeout(Duration::from_millis(5));
            }
        }
    }
    let daemons: &[&str] = match part {
        Part::Controller => &["slurmctld"],
        Part::Nodes => &["slurmd.n1", "slurmd.n2"],
        Part::Step | Part::Worker => &[],
    };
    for daemon in daemons {
        slurm.kill(daemon);
    }
    let processes = match part {
        Part::Step => steps(slurm),
        Part::Worker => workers(depot.path()),
        Part::Controller | Part::Nodes => Vec::new(),
    };
    assert_eq!(processes.is_empty(), !daemons.is_empty(), "{part:?}");
    for process in processes {
        let mut kill = Command::new("kill");
        // It may have ended with another.
        let _killed = kill.args(["-9", &process]).output().unwrap();
    }
    if !daemons.is_empty() {
        thread::sleep(AWAY);
        for daemon in daemons {
            slurm.start_again(daemon);
        }
    }
    for partition in ["p000", "p001"] {
        place.let_go(partition);
    }
    let (code, said) = run.finish();
    let what = format!("{part:?} {moment:?}: {said}");
    assert_eq!(code, Some(0), "{what}");
    if part == Part::Worker {
        assert!(said.contains("left no result"), "{what}");
    }
    for partition in ["p000", "p001"] {
        let log = place.log();
        let n_tries = log.iter().filter(|made| made.partition == partition);
        assert!((1..=3).contains(&n_tries.count()), "{what}");
    }
    well(slurm.with(depot.path(), place.bare(&place.lake(), "pull")));
    let expected = place.undisturbed(&["--until", "split"]);
    assert_same(&place.published(), &expected, &what);
    let mut verify = slurm.with(depot.path(), place.bare(&place.lake(), "verify"));
    verify.arg("--depot");
    well(verify);
    eprintln!(
        "{part:?} {moment:?}: {:.0} s",
        began.elapsed().as_secs_f64()
    );
}

/// Processes that look after the jobs of a Slurm, by their numbers.
fn steps(slurm: &Slurm) -> Vec<String> {
    let mut steps = processes_with("SLURM_CONF", &slurm.conf());
    steps.retain(|process| {
        let name = fs::read_to_string(format!("/proc/{process}/comm"));
        name.is_ok_and(|name| name.trim() == "slurmstepd")
    });
    steps
}

/// Units of a run in bad minutes.
const UNITS: usize = 12;

#[test]
fn runs_outlive_the_death_of_their_driver() {
    bad_minutes(Bad::Driver);
}

#[test]
fn runs_outlive_a_depot_that_is_away() {
    bad_minutes(Bad::Depot);
}

/// What happens to a run.
#[derive(Clone, Copy, Debug)]
enum Bad {
    /// Its driver is killed, and it is started again.
    Driver,
    /// Its depot is away for a while.
    Depot,
}

fn bad_minutes(bad: Bad) {
    let n_rounds = number::<usize>("PIPELINE_BAD_MINUTES", 1);
    let longest_s = number("PIPELINE_AWAY_S", 3.0);
    let mut rng = chances(&format!("{bad:?} in bad minutes"));
    let Some(slurm) = Slurm::start() else { return };
    for round in 0..n_rounds {
        let folder = folder::in_memory();
        let depot = folder.path().join("depot");
        fs::create_dir(&depot).unwrap();
        let place = Place::with_inputs(CHAIN, UNITS);
        let start = || {
            let mut run = place.command("run", &["--on", "slurm", "--until", "split"]);
            run.env("OWN_STAGES_TAKES", "700");
            Running::start(slurm.with(&depot, run))
        };
        let mut run = start();
        thread::sleep(Duration::from_secs_f64(rng.random_range(0.0..6.0)));
        let what = match bad {
            Bad::Driver => {
                run.child.kill().unwrap();
                run.finish();
                run = start();
                "driver killed".to_owned()
            }
            Bad::Depot => {
                let away_s = rng.random_range(1.0..=longest_s);
                away_for(&depot, Duration::from_secs_f64(away_s));
                format!("depot away for {away_s:.0} s")
            }
        };
        let (code, said) = run.finish();
        assert_eq!(code, Some(0), "{what}: {said}");
        let n_made = place.take_log().len();
        assert_eq!(n_made, UNITS, "{what}: {said}");
        well(slurm.with(&depot, place.bare(&place.lake(), "pull")));
        let expected = place.undisturbed(&["--until", "split"]);
        assert_same(&place.published(), &expected, &what);
        let mut verify = slurm.with(&depot, place.bare(&place.lake(), "verify"));
        verify.arg("--depot");
        well(verify);
        eprintln!("round {round}: {what}; {n_made} units made");
    }
}
