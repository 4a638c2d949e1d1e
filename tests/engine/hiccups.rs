//! A depot that is away for seconds, full, or damaged for a moment, while a run or its jobs use it: nothing that is
//! finished is lost, nothing is made again, and no run ends.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
    thread,
    time::{Duration, Instant},
};

use crate::engine::{
    elsewhere::Cluster,
    place::{CHAIN, LONG, Place, Running, assert_same, files_below, put, stderr, well},
};

/// Longer than a run without patience survives.
const AWAY: Duration = Duration::from_secs(6);

fn machine() -> Place {
    Place::with_inputs(CHAIN, 2)
}

/// Moves a depot away, and back after some time.
pub(crate) fn away_for(depot: &Path, time: Duration) {
    let away = depot.with_extension("away");
    fs::rename(depot, &away).unwrap();
    thread::sleep(time);
    fs::rename(&away, depot).unwrap();
}

/// Starts a run by jobs whose units wait; returns it when its units are being made.
fn held(cluster: &Cluster, place: &Place, arguments: &[&str]) -> Running {
    let arguments = [&["--on", "slurm", "--until", "split"], arguments].concat();
    let mut run = Running::start(cluster.with(place.held(&arguments)));
    for partition in ["p000", "p001"] {
        run.wait_for(place, partition);
    }
    run
}

/// Takes the depot away from a run by jobs until its patience is over; returns the place of the depot, where it is
/// now, and what the run said.
fn without_patience(cluster: &Cluster, place: &Place) -> (PathBuf, PathBuf, String) {
    let run = held(cluster, place, &["--depot-patience-min", "0.05"]);
    let (depot, away) = (cluster.path("depot"), cluster.path("away"));
    fs::rename(&depot, &away).unwrap();
    let (code, said) = run.finish();
    assert_eq!(code, Some(1), "{said}");
    (depot, away, said)
}

fn let_go(place: &Place) {
    for partition in ["p000", "p001"] {
        place.let_go(partition);
    }
}

#[test]
fn a_folder_that_is_away_while_units_end_loses_no_result_and_ends_no_run() {
    let cluster = Cluster::new();
    let place = machine();
    let run = held(&cluster, &place, &[]);
    thread::scope(|scope| {
        scope.spawn(|| away_for(&cluster.path("depot"), AWAY));
        thread::sleep(Duration::from_millis(300));
        let_go(&place);
    });
    let (code, said) = run.finish();
    assert_eq!(code, Some(0), "{said}");
    assert!(
        said.contains("wait   the depot does not answer since "),
        "{said}"
    );
    assert!(said.contains("note   the depot is back after "), "{said}");
    assert_eq!(place.take_log().len(), 2, "made once: {said}");
    assert_eq!(cluster.calls("submit").len(), 1, "{said}");
    assert_eq!(cluster.calls("cancel").len(), 0, "{said}");
    cluster.assert_tidy();
}

#[test]
fn a_run_that_begins_while_its_depot_is_away_makes_no_other_in_its_place() {
    let (cluster, place) = (Cluster::new(), machine());
    let (depot, away) = (cluster.path("depot"), cluster.path("away"));
    fs::rename(&depot, &away).unwrap();
    let run = place.command("run", &["--on", "slurm", "--until", "split"]);
    let run = Running::start(cluster.with(run));
    thread::sleep(AWAY);
    assert!(!depot.exists());
    fs::rename(&away, &depot).unwrap();
    let (code, said) = run.finish();
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(place.take_log().len(), 2, "{said}");
}

#[test]
fn a_depot_that_stays_away_leaves_the_jobs_and_the_same_command_takes_them_over() {
    let cluster = Cluster::new();
    let place = machine();
    let (depot, away, said) = without_patience(&cluster, &place);
    for part in [
        "error: the depot was down for ",
        "mounted",
        "are left in the queue of `slurm`",
        "--on slurm --until split --depot-patience-min 0.05",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
    assert!(!said.contains("done here alone"), "{said}");
    assert_eq!(cluster.calls("cancel").len(), 0, "{said}");
    fs::rename(&away, &depot).unwrap();
    let arguments = ["--on", "slurm", "--until", "split"];
    let mut again = Running::start(cluster.with(place.held(&arguments)));
    again.wait_for_line("it goes on", |line| line.starts_with("adopt  split.parts"));
    let_go(&place);
    let (code, said) = again.finish();
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(place.take_log().len(), 2, "made once: {said}");
    assert_eq!(cluster.calls("submit").len(), 1, "{said}");
    cluster.assert_tidy();
}

#[test]
fn a_job_that_must_end_before_the_depot_is_back_says_where_its_result_lies_and_push_sends_it() {
    let cluster = Cluster::new();
    let place = machine();
    let (depot, away, _) = without_patience(&cluster, &place);
    let_go(&place);
    thread::sleep(Duration::from_secs(2));
    // As a scheduler does at the end of a job's time.
    let workers = crate::cluster::workers(&depot);
    assert_eq!(workers.len(), 2);
    for process in &workers {
        let mut end = Command::new("kill");
        end.args(["-TERM", process]);
        well(end);
    }
    let until = Instant::now() + LONG;
    let logs = || {
        let logs = files_below(&away.join("logs")).into_iter();
        logs.map(|log| fs::read_to_string(log).unwrap())
            .collect::<String>()
    };
    while logs().matches("kept   ").count() < 2 {
        assert!(Instant::now() < until, "{}", logs());
        thread::sleep(Duration::from_millis(50));
    }
    fs::rename(&away, &depot).unwrap();
    let logs: String = files_below(&depot.join("logs"))
        .iter()
        .map(|log| fs::read_to_string(log).unwrap())
        .collect();
    let lakes = logs.split("pipeline push --lake ").skip(1);
    let lakes: Vec<&str> = lakes.map(|rest| rest.split('`').next().unwrap()).collect();
    assert_eq!(lakes.len(), 2, "{logs}");
    for lake in lakes {
        well(cluster.with(place.bare(Path::new(lake), "push")));
        fs::remove_dir_all(lake).unwrap();
    }
    let other = machine();
    well(cluster.with(other.command("run", &["--until", "split"])));
    assert_eq!(other.take_log(), [], "they are in the depot");
    assert_eq!(place.take_log().len(), 2);
}

/// Runs without `--on`, and a full depot that another machine filled.
fn full() -> (Cluster, Place, usize) {
    let cluster = Cluster::new();
    let place = Place::with_inputs(CHAIN, 12);
    well(cluster.with(place.command("run", &[])));
    let n_units = place.take_log().len();
    (cluster, place, n_units)
}

#[test]
fn a_full_depot_that_is_away_is_waited_for_and_nothing_is_made_again() {
    let (cluster, first, _) = full();
    let place = Place::with_inputs(CHAIN, 12);
    let (depot, away) = (cluster.path("depot"), cluster.path("away"));
    fs::rename(&depot, &away).unwrap();
    let mut run = Running::start(cluster.with(place.command("run", &[])));
    run.wait_for_line("it waits", |line| {
        line.starts_with("wait   the depot does not answer since ")
    });
    run.wait_for_line("what is at stake", |line| {
        line.starts_with("hint: without it 12 units of `split.parts` would be made again")
    });
    thread::sleep(AWAY);
    fs::rename(&away, &depot).unwrap();
    let (code, said) = run.finish();
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(place.take_log(), [], "{said}");
    well(cluster.with(place.bare(&place.lake(), "pull")));
    assert_same(&place.published(), &first.published(), &said);
}

#[test]
fn a_run_without_its_depot_waits_fails_or_goes_on_alone_as_it_is_told() {
    let (cluster, _, n_units) = full();
    let depot = cluster.path("depot");
    fs::rename(&depot, cluster.path("away")).unwrap();
    for (arguments, code, n_made) in [
        (["--depot-patience-min", "0.04"].as_slice(), 1, 0),
        (
            &["--depot-down", "fail", "--depot-patience-min", "0.04"],
            1,
            0,
        ),
        (&["--depot-down", "alone"], 0, n_units),
    ] {
        let place = Place::with_inputs(CHAIN, 12);
        let ran = cluster
            .with(place.command("run", arguments))
            .output()
            .unwrap();
        let said = stderr(&ran);
        assert_eq!(ran.status.code(), Some(code), "{arguments:?}: {said}");
        assert_eq!(place.take_log().len(), n_made, "{arguments:?}: {said}");
        if code == 1 {
            assert!(said.contains("error: the depot was down for "), "{said}");
            let hint = format!("check that `{}` is mounted", depot.display());
            assert!(said.contains(&hint), "{said}");
        }
    }
}

#[test]
fn results_are_sent_when_a_depot_that_could_not_be_written_is_back() {
    let cluster = Cluster::new();
    let place = machine();
    well(cluster.with(place.command("run", &["--until", "split"])));
    // It can be read.
    let writing = cluster.path("depot/writing");
    fs::remove_dir(&writing).unwrap();
    put(&writing, b"not a folder");
    let arguments = ["--until", "split", "--set", "split.table=false"];
    let mut run = Running::start(cluster.with(place.held(&arguments)));
    run.wait_for(&place, "p000");
    place.let_go("p000");
    run.wait_for_line("it tells at once", |line| {
        line.starts_with("wait   results are not sent to the depot since ")
    });
    fs::remove_file(&writing).unwrap();
    place.let_go("p001");
    let (code, said) = run.finish();
    assert_eq!(code, Some(0), "{said}");
    assert!(!said.contains("warn "), "{said}");
    let other = machine();
    well(cluster.with(other.command("run", &arguments)));
    assert_eq!(other.take_log(), [], "everything was sent");
}
