//! Machines that share results in a depot, each with a lake of its own. `PIPELINE_ROUNDS`,
//! `PIPELINE_KILLS` and `PIPELINE_FLIPS` set how often.

use std::{
    collections::BTreeMap,
    fs::{self, File},
    path::{Path, PathBuf},
    process::{Command, Output, Stdio},
    thread,
    time::{Duration, Instant, SystemTime},
};

use rand::{Rng, seq::IndexedRandom};
use serde_json::Value;
use tempfile::TempDir;

use crate::engine::place::{
    CHAIN, Place, Running, assert_same, chances, files_below, number, put, read, stderr, stdout,
    well, write_unnoticed,
};
use crate::folder;

/// Longest delay of a run by a depot that is down, beyond the time that it takes alone.
const LOST: Duration = Duration::from_secs(5);

/// A run that goes on without a depot that is down.
const ALONE: [&str; 2] = ["--depot-down", "alone"];

/// The pipeline with another value, for which the inputs of `second` are read.
const OTHER: [&str; 2] = ["--set", "second.add=9"];

/// A depot, and machines that use it.
struct Lab {
    folder: TempDir,
}

impl Lab {
    fn new() -> Self {
        let lab = Self {
            folder: folder::in_memory(),
        };
        fs::create_dir(lab.depot()).unwrap();
        lab
    }

    fn depot(&self) -> PathBuf {
        self.folder.path().join("depot")
    }

    /// Lets a command use the depot.
    fn share(&self, mut command: Command) -> Command {
        command.env("PIPELINE_DEPOT", self.depot());
        command
    }

    fn run(&self, machine: &Place, arguments: &[&str]) -> Output {
        well(self.share(machine.command("run", arguments)))
    }

    /// A command that takes no pipeline file.
    fn ask(&self, machine: &Place, command: &str, arguments: &[&str]) -> Output {
        let mut command = self.share(machine.bare(&machine.lake(), command));
        command.args(arguments).output().unwrap()
    }

    /// Asserts that every file of the depot is whole, and no record lacks a file.
    fn assert_whole(&self, machine: &Place) {
        let verified = self.ask(machine, "verify", &["--depot"]);
        let said = stdout(&verified) + &stderr(&verified);
        assert_eq!(verified.status.code(), Some(0), "{said}");
    }

    fn keys(&self, folder: &str) -> Vec<PathBuf> {
        files_below(&self.depot().join(folder))
    }
}

/// A machine with a lake and inputs of its own, equal to those of every other.
fn machine() -> Place {
    Place::with_inputs(CHAIN, 12)
}

/// The numbers in the line that says what was shared: units found, files fetched, units sent, requests.
fn shared(output: &Output) -> [usize; 4] {
    let said = stderr(output);
    let line = said.lines().find(|line| line.starts_with("depot "));
    let line = line.unwrap_or_else(|| panic!("nothing was shared: {said}"));
    let before = |what: &str| {
        let (before, _) = line.split_once(what).unwrap();
        let word = before.trim_end().rsplit(' ').next().unwrap();
        word.parse().unwrap()
    };
    [" units found", " files fetched", " units sent", " requests"].map(before)
}

/// Number of lines that warn.
fn warnings(output: &Output) -> usize {
    let said = stderr(output);
    said.lines()
        .filter(|line| line.starts_with("warn "))
        .count()
}

#[test]
fn a_second_machine_makes_nothing_and_fetches_what_is_asked_for() {
    let lab = Lab::new();
    let (first, second) = (machine(), machine());
    let [_, _, n_sent, _] = shared(&lab.run(&first, &[]));
    assert_eq!(n_sent, first.take_log().len());
    let plan = well(lab.share(second.command("plan", &[])));
    let [n_found, n_fetched, _, n_requests] = shared(&plan);
    assert_eq!((n_found, n_fetched), (n_sent, 0));
    assert!(n_requests <= 10, "{n_requests} requests to plan");
    let planned = stdout(&plan);
    assert!(
        planned.lines().all(|line| line.starts_with("depot ")),
        "{planned}"
    );
    assert!(!second.lake().exists(), "a plan makes nothing");

    lab.run(&second, &[]);
    assert_eq!(second.take_log(), []);
    let is_shown = |path: &str| path.starts_with("tables/");
    let mut tables = first.published();
    tables.retain(|path, _| is_shown(path));
    assert_same(&second.published(), &tables, "what people look at");
    well(second.bare(&second.lake(), "verify"));
    // The inputs of a new unit, and no more: the data of `first`.
    let [_, n_fetched, _, _] = shared(&lab.run(&second, &OTHER));
    assert_eq!(n_fetched, 12);
    let made = second.take_counts();
    assert_eq!(
        made,
        BTreeMap::from([("gather".to_owned(), 1), ("map".to_owned(), 12)])
    );
    assert_eq!(
        lab.ask(&second, "pull", &["split.parts"]).status.code(),
        Some(0)
    );
    assert!(
        second
            .published()
            .contains_key("files/own/split/parts/p000/data.bin")
    );
    let misspelt = lab.ask(&second, "pull", &["split.part"]);
    assert_ne!(misspelt.status.code(), Some(0));
    let said = stderr(&misspelt);
    assert!(
        said.contains("no run has made `split.part`") && said.contains("split.parts"),
        "{said}"
    );
    lab.run(&second, &[]);
    assert_eq!(lab.ask(&second, "pull", &[]).status.code(), Some(0));
    assert_same(&second.published(), &first.published(), "everything");
    well(second.bare(&second.lake(), "verify"));
    lab.assert_whole(&second);
}

#[test]
fn results_from_before_are_pushed() {
    let lab = Lab::new();
    let (first, second) = (machine(), machine());
    first.run_well(&[]);
    assert!(lab.keys("units").is_empty());
    let pushed = lab.ask(&first, "push", &[]);
    assert_eq!(pushed.status.code(), Some(0), "{}", stderr(&pushed));
    let again = lab.ask(&first, "push", &[]);
    assert_eq!(shared(&again)[2], 0, "everything is there");
    lab.run(&second, &["--processes"]);
    assert_eq!(second.take_log(), []);
    lab.assert_whole(&second);
}

/// The rows of a query over the depot, without a header, and the command's output.
fn rows(lab: &Lab, machine: &Place, sql: &str) -> (Vec<String>, Output) {
    let answer = lab.ask(machine, "query", &["--depot", "--format", "csv", sql]);
    assert_eq!(answer.status.code(), Some(0), "{}", stderr(&answer));
    let rows = stdout(&answer).lines().skip(1).map(str::to_owned).collect();
    (rows, answer)
}

/// The same over a machine's own lake.
fn here(machine: &Place, sql: &str) -> Vec<String> {
    let mut query = machine.bare(&machine.lake(), "query");
    query.args(["--format", "csv", sql]);
    let text = stdout(&well(query));
    text.lines().skip(1).map(str::to_owned).collect()
}

#[test]
fn tables_of_all_machines_are_queried_and_only_they_are_fetched() {
    let lab = Lab::new();
    let (first, second, asking) = (machine(), machine(), machine());
    lab.run(&first, &[]);
    lab.run(&second, &["--set", "first.add=5"]);
    second.take_log();
    // Both stages make the table.
    let newest = "select * from parts order by stage, part";
    let (found, answer) = rows(&lab, &asking, newest);
    assert_eq!(found.len(), 24);
    assert_eq!(
        found,
        here(&second, newest),
        "the newest run is the second's"
    );
    let [_, n_fetched, n_sent, _] = shared(&answer);
    assert_eq!((n_fetched, n_sent), (24, 0), "its tables, and no data");
    let (_, again) = rows(&lab, &asking, newest);
    assert_eq!(shared(&again)[1], 0, "they are here now");
    // Fetched files are checked again.
    let blobs = files_below(&asking.lake().join("blobs"));
    let mut bytes = read(&blobs[0]);
    bytes[10] ^= 1;
    write_unnoticed(&blobs[0], &bytes);
    let damaged = lab.ask(&asking, "query", &["--depot", newest]);
    assert!(
        stderr(&damaged).contains("is damaged"),
        "{}",
        stdout(&damaged)
    );
    fs::remove_dir_all(asking.lake()).unwrap();

    let (counts, _) = rows(
        &lab,
        &asking,
        "select run, count(*) as n from all_parts group by run order by run",
    );
    let [one, other] = counts.as_slice() else {
        panic!("{counts:?}");
    };
    assert!(one.ends_with(",24") && other.ends_with(",24"), "{counts:?}");
    let (runs, _) = rows(
        &lab,
        &asking,
        "select machine, number, overrides, n_made_now from runs order by started",
    );
    let host = lake::host();
    let n_units = first.take_log().len();
    assert_eq!(
        runs,
        [
            format!("{host},1,[],{n_units}"),
            format!("{host},1,\"[\"\"first.add=5\"\"]\",{}", n_units - 12),
        ]
    );
    let metrics = "select count(*) as n from metrics";
    let n_metrics = |machine| here(machine, metrics).concat().parse::<usize>().unwrap();
    let (found, _) = rows(&lab, &asking, metrics);
    let n_found: usize = found.concat().parse().unwrap();
    assert_eq!(n_found, n_metrics(&first) + n_metrics(&second));

    well(asking.bare(&asking.lake(), "verify"));
    well(asking.bare(&asking.lake(), "gc"));
    assert_eq!(asking.take_log(), []);
    for (sql, message, hint) in [
        (
            "select * from part",
            "no table `part`",
            "did you mean `parts`?",
        ),
        ("select n from parts", "no column `n`", "the columns are: "),
    ] {
        let wrong = lab.ask(&asking, "query", &["--depot", sql]);
        assert_eq!(wrong.status.code(), Some(2));
        let said = stderr(&wrong);
        assert!(said.contains(message) && said.contains(hint), "{said}");
    }
}

#[test]
fn a_run_that_is_repeated_or_pushed_is_in_the_depot_and_the_newest() {
    let lab = Lab::new();
    let (machine, asking) = (machine(), machine());
    let newest = |expected: &str| {
        let sums = "select sum(sum) as sum from parts where stage = 'first'";
        let (sums, _) = rows(&lab, &asking, sums);
        assert_eq!(
            sums,
            here(
                &machine,
                "select sum(sum) as sum from parts where stage = 'first'"
            )
        );
        let (overrides, _) = rows(&lab, &asking, "select overrides from runs");
        assert!(
            overrides.iter().any(|it| it.contains(expected)),
            "{overrides:?}"
        );
        sums
    };
    lab.run(&machine, &[]);
    let first = newest("[]");
    lab.run(&machine, &["--set", "first.add=5"]);
    assert_ne!(newest("first.add=5"), first);
    lab.run(&machine, &[]);
    assert_eq!(newest("[]"), first, "the repeated run is the newest");
    // Its units are all there.
    fs::remove_dir_all(lab.depot().join("runs")).unwrap();
    let pushed = lab.ask(&machine, "push", &[]);
    assert_eq!(pushed.status.code(), Some(0), "{}", stderr(&pushed));
    assert_eq!(newest("first.add=5"), first);
}

#[test]
fn a_query_over_a_depot_that_is_empty_damaged_or_down_is_an_error() {
    let lab = Lab::new();
    let machine = machine();
    let fails = |message: &str, hint: &str| {
        let answer = lab.ask(&machine, "query", &["--depot", "select * from parts"]);
        let said = stderr(&answer);
        assert!(!answer.status.success(), "{}", stdout(&answer));
        assert!(said.contains(message) && said.contains(hint), "{said}");
    };
    fails("no runs in the depot", "`pipeline push`");
    lab.run(&machine, &[]);
    fs::remove_dir_all(machine.lake()).unwrap();
    let tables = lab.keys("blobs").into_iter();
    let tables = tables.filter(|blob| read(blob).starts_with(b"PAR1"));
    for blob in tables {
        let mut bytes = read(&blob);
        bytes[10] ^= 1;
        write_unnoticed(&blob, &bytes);
    }
    fails("missing or damaged", "`pipeline verify --depot`");
    fs::remove_dir_all(lab.depot()).unwrap();
    fails("depot", "mounted");
}

#[test]
fn processes_and_single_units_share_as_runs_do() {
    let lab = Lab::new();
    let (first, second, third) = (machine(), machine(), machine());
    lab.run(&first, &["--processes"]);
    lab.assert_whole(&first);
    lab.run(&second, &[]);
    assert_eq!(second.take_log(), []);
    // A worker that has nothing but the depot.
    let unit = lab.share(third.command("unit", &["second.parts", "p003", OTHER[0], OTHER[1]]));
    well(unit);
    assert_eq!(third.take_log().len(), 1);
    lab.run(&second, &OTHER);
    let made = second.take_log();
    assert!(made.iter().all(|made| made.partition != "p003"), "{made:?}");
    assert_eq!(made.len(), 11 + 1);
}

#[test]
fn a_run_that_makes_nothing_asks_nothing() {
    let lab = Lab::new();
    let (first, second) = (machine(), machine());
    lab.run(&first, &[]);
    lab.run(&second, &[]);
    fs::rename(lab.depot(), lab.folder.path().join("elsewhere")).unwrap();
    for machine in [&first, &second] {
        let said = stderr(&lab.run(machine, &[]));
        assert!(said.contains("nothing to run"), "{said}");
        assert!(!said.contains("depot"), "{said}");
    }
}

/// Breaks a depot.
type Break = fn(&Path);

/// Ways in which a depot is down, by name.
const DOWN: [(&str, Break); 4] = [
    ("missing", |depot| {
        fs::rename(depot, depot.with_extension("away")).unwrap();
    }),
    ("a file", |depot| {
        fs::rename(depot, depot.with_extension("away")).unwrap();
        put(depot, b"not a folder");
    }),
    ("cannot be written", |depot| {
        let _old = fs::rename(depot.join("units"), depot.with_extension("units"));
        put(&depot.join("units"), b"not a folder");
    }),
    ("black hole", |depot| {
        // Opening a pipe blocks until another process writes to it.
        let mut pipes = files_below(&depot.join("blobs"));
        pipes.push(depot.join("format"));
        for pipe in pipes {
            let _old = fs::remove_file(&pipe);
            let mut make = Command::new("mkfifo");
            make.arg(pipe);
            well(make);
        }
    }),
];

#[test]
fn a_depot_that_is_down_costs_one_warning_and_the_next_run_sends_the_rest() {
    for (name, break_it) in DOWN {
        let lab = Lab::new();
        let (first, second) = (machine(), machine());
        let expected = first.undisturbed(&[]);
        break_it(&lab.depot());
        let started = Instant::now();
        let ran = lab.run(&first, &ALONE);
        let took = started.elapsed();
        assert!(took < 2 * LOST, "{name}: {took:?}");
        assert_eq!(warnings(&ran), 1, "{name}: {}", stderr(&ran));
        assert_same(&first.published(), &expected, name);
        // It is there again.
        let _gone = fs::remove_dir_all(lab.depot());
        let _gone = fs::remove_file(lab.depot());
        fs::create_dir(lab.depot()).unwrap();
        let drained = lab.run(&first, &[]);
        assert_eq!(warnings(&drained), 0, "{name}: {}", stderr(&drained));
        lab.assert_whole(&first);
        lab.run(&second, &[]);
        assert_eq!(second.take_log(), [], "{name}");
    }
}

#[test]
fn a_depot_that_goes_down_in_the_middle_costs_one_warning() {
    for (name, break_it) in DOWN {
        let lab = Lab::new();
        let (first, second) = (machine(), machine());
        lab.run(&first, &["--until", "first"]);
        lab.run(&second, &["--until", "first"]);
        // Held in the middle of the units whose inputs are still in the depot.
        second.input("held", b"a held one");
        for partition in 0..12 {
            second.let_go(&crate::engine::place::name(partition));
        }
        let mut run = Running::start(lab.share(second.held(&ALONE)));
        run.wait_for(&second, "held");
        break_it(&lab.depot());
        fs::remove_dir_all(second.path("gate")).unwrap();
        let (code, said) = run.finish();
        assert_eq!(code, Some(0), "{name}: {said}");
        let n_warnings = said
            .lines()
            .filter(|line| line.starts_with("warn "))
            .count();
        assert_eq!(n_warnings, 1, "{name}: {said}");
        assert_same(&all_shown(&second), &second.undisturbed(&[]), name);
        // Results made again here are shown although they once were in the depot.
        let _gone = fs::remove_dir_all(lab.depot());
        let _gone = fs::remove_file(lab.depot());
        fs::create_dir(lab.depot()).unwrap();
        lab.run(&second, &[]);
        assert_same(&second.published(), &second.undisturbed(&[]), name);
    }
}

/// Returns the published artifacts after a run without the depot, which makes again everything that was left there.
fn all_shown(machine: &Place) -> BTreeMap<String, String> {
    machine.run_well(&[]);
    machine.published()
}

#[test]
fn units_made_at_once_on_two_machines_are_one_record() {
    let lab = Lab::new();
    let (first, second) = (machine(), machine());
    let n_rounds: usize = number("PIPELINE_ROUNDS", 8);
    for round in 0..n_rounds {
        // Values are bytes; the second one makes more rounds than those differ.
        let values = [
            format!("first.add={}", round % 250),
            format!("second.add={}", round / 250),
        ];
        let arguments = ["--set", &values[0], "--set", &values[1]];
        let runs = [&first, &second].map(|machine| {
            let mut command = lab.share(machine.command("run", &arguments));
            command.stdout(Stdio::null()).stderr(Stdio::piped());
            command.spawn().unwrap()
        });
        for run in runs {
            let output = run.wait_with_output().unwrap();
            assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
            assert_eq!(warnings(&output), 0, "{}", stderr(&output));
            assert!(!stderr(&output).contains("came out differently"));
        }
    }
    lab.assert_whole(&first);
    assert_eq!(lab.keys("differing"), Vec::<PathBuf>::new());
    assert_eq!(lab.keys("writing"), Vec::<PathBuf>::new());
    let third = machine();
    lab.run(&third, &["--set", "first.add=0", "--set", "second.add=0"]);
    assert_eq!(third.take_log(), []);
    assert_same(&first.undisturbed(&[]), &second.undisturbed(&[]), "");
}

/// Runs of several machines at once of units that take a while; returns how many units were made, and what they said.
fn at_once(lab: &Lab, machines: &[Place], takes_ms: u64) -> (usize, String) {
    let runs: Vec<Running> = machines
        .iter()
        .map(|machine| {
            let mut run = lab.share(machine.command("run", &["--until", "split", "--jobs", "2"]));
            run.env("OWN_STAGES_TAKES", takes_ms.to_string());
            Running::start(run)
        })
        .collect();
    let mut all = String::new();
    for run in runs {
        let (code, said) = run.finish();
        assert_eq!(code, Some(0), "{said}");
        all += &said;
    }
    let n_made = machines
        .iter()
        .map(|machine| machine.take_log().len())
        .sum();
    (n_made, all)
}

#[test]
fn machines_at_once_share_the_work() {
    let lab = Lab::new();
    let n_units: usize = number("PIPELINE_UNITS", 40);
    let machines: Vec<Place> = (0..5).map(|_| Place::with_inputs(CHAIN, n_units)).collect();
    let (n_made, said) = at_once(&lab, &machines, 200);
    println!("{n_units} units on five machines at once: {n_made} made");
    assert!(n_made * 10 <= n_units * 11, "{n_made} of {n_units}: {said}");
    lab.assert_whole(&machines[0]);
    assert_eq!(lab.keys("messages"), [] as [PathBuf; 0]);
}

#[test]
fn a_unit_that_another_machine_makes_is_waited_for_until_that_dies() {
    let lab = Lab::new();
    let [first, second] = [(); 2].map(|()| Place::with_inputs(CHAIN, 1));
    for is_killed in [false, true] {
        let arguments = [
            "--until",
            "split",
            "--set",
            &format!("split.table={is_killed}"),
        ];
        let mut run = Running::start(lab.share(first.held(&arguments)));
        run.wait_for(&first, "p000");
        let mut other = Running::start(lab.share(second.command("run", &arguments)));
        other.wait_for_line("it waits", |line| {
            line.starts_with("wait   split.parts `p000`: waiting for `")
                && line.contains("makes it now")
        });
        assert_eq!(second.log(), []);
        if is_killed {
            run.child.kill().unwrap();
        }
        first.let_go("p000");
        let (code, said) = run.finish();
        assert_eq!(code, (!is_killed).then_some(0), "{said}");
        let (code, said) = other.finish();
        assert_eq!(code, Some(0), "{said}");
        assert_eq!(second.take_log().len(), usize::from(is_killed), "{said}");
        first.take_log();
        fs::remove_dir_all(first.path("gate")).unwrap();
    }
}

#[test]
fn a_push_sends_again_what_the_depot_has_lost() {
    let lab = Lab::new();
    let (first, second) = (machine(), machine());
    lab.run(&first, &[]);
    lab.run(&second, &[]);
    let files = [lab.keys("blobs"), lab.keys("recipes")].concat();
    for (idx, file) in files.iter().enumerate().step_by(3) {
        if idx % 2 == 0 {
            fs::remove_file(file).unwrap();
        } else {
            write_unnoticed(file, b"damaged");
        }
    }
    let verify = |arguments: &[&str]| lab.ask(&second, "verify", arguments);
    let found = verify(&["--depot"]);
    assert_eq!(found.status.code(), Some(1));
    assert!(
        stderr(&found).contains("`pipeline verify --depot --drop`"),
        "{}",
        stderr(&found)
    );
    verify(&["--depot", "--drop"]);
    let pushed = lab.ask(&first, "push", &[]);
    assert_eq!(pushed.status.code(), Some(0), "{}", stderr(&pushed));
    lab.assert_whole(&first);
    assert_eq!(lab.ask(&second, "pull", &[]).status.code(), Some(0));
    assert_same(&second.published(), &first.published(), "");
    assert_eq!(first.take_log().len() + second.take_log().len(), 12 * 3 + 2);
}

#[test]
fn a_push_beside_a_run_has_nothing_to_complain_of() {
    let lab = Lab::new();
    let place = machine();
    lab.run(&place, &[]);
    let mut n_pushed = 0;
    for round in 0..number::<usize>("PIPELINE_ROUNDS", 4) {
        let add = format!("first.add={}", round + 2);
        let mut run = place.command("run", &["--set", &add]);
        run.env("OWN_STAGES_TAKES", "50");
        let mut run = Running::start(lab.share(run));
        while run.child.try_wait().unwrap().is_none() {
            let pushed = lab.ask(&place, "push", &[]);
            assert_eq!(pushed.status.code(), Some(0), "{}", stderr(&pushed));
            n_pushed += 1;
        }
        assert_eq!(run.finish().0, Some(0));
    }
    println!("{n_pushed} pushes beside runs");
    assert!(n_pushed > 0);
}

#[test]
fn a_kill_while_sending_leaves_nothing_half_sent() {
    let mut rng = chances("kills while sending");
    let lab = Lab::new();
    let first = machine();
    // Large enough to be cut.
    for partition in 0..12 {
        let bytes = vec![u8::try_from(partition).unwrap(); 1 << 20];
        first.input(&crate::engine::place::name(partition), &bytes);
    }
    first.run_well(&[]);
    let n_kills: usize = number("PIPELINE_KILLS", 12);
    for _ in 0..n_kills {
        let mut push = lab.share(first.bare(&first.lake(), "push"));
        push.stdout(Stdio::null()).stderr(Stdio::null());
        let mut push = push.spawn().unwrap();
        thread::sleep(Duration::from_micros(rng.random_range(0..150_000)));
        push.kill().unwrap();
        push.wait().unwrap();
        lab.assert_whole(&first);
        if rng.random_bool(0.3) {
            fs::remove_dir_all(lab.depot()).unwrap();
            fs::create_dir(lab.depot()).unwrap();
        }
    }
    let pushed = lab.ask(&first, "push", &[]);
    assert_eq!(pushed.status.code(), Some(0), "{}", stderr(&pushed));
    lab.assert_whole(&first);
    let second = Place::new(CHAIN);
    for path in files_below(&first.inputs()) {
        fs::copy(&path, second.inputs().join(path.file_name().unwrap())).unwrap();
    }
    lab.run(&second, &[]);
    assert_eq!(second.take_log(), []);
}

#[test]
fn what_the_depot_has_lost_is_made_again() {
    let lab = Lab::new();
    let (first, second) = (machine(), machine());
    lab.run(&first, &[]);
    lab.run(&second, &[]);
    for blob in lab.keys("blobs").iter().step_by(3) {
        fs::remove_file(blob).unwrap();
    }
    let ran = lab.run(&second, &OTHER);
    let said = stderr(&ran);
    assert!(said.contains("is made again"), "{said}");
    assert_eq!(warnings(&ran), 0, "{said}");
    assert_same(
        &all_shown_of(&second, &OTHER),
        &second.undisturbed(&OTHER),
        &said,
    );
    // Results made again are there again.
    lab.run(&first, &OTHER);
    let third = machine();
    lab.run(&third, &OTHER);
    assert_same(
        &all_shown_of(&third, &OTHER),
        &first.undisturbed(&OTHER),
        "",
    );
}

fn all_shown_of(machine: &Place, arguments: &[&str]) -> BTreeMap<String, String> {
    machine.run_well(arguments);
    machine.published()
}

#[test]
fn a_flipped_byte_is_found_before_it_is_used() {
    let mut rng = chances("flips in a depot");
    let lab = Lab::new();
    let first = machine();
    lab.run(&first, &[]);
    let expected = first.undisturbed(&OTHER);
    for round in 0..number("PIPELINE_FLIPS", 24) {
        let folder = ["blobs", "units", "recipes", "runs"]
            .choose(&mut rng)
            .unwrap();
        let keys = lab.keys(folder);
        let path = keys.choose(&mut rng).unwrap();
        let before = read(path);
        let mut bytes = before.clone();
        let place = rng.random_range(0..bytes.len());
        bytes[place] ^= 1 << rng.random_range(0..8);
        write_unnoticed(path, &bytes);
        let context = format!("round {round}: {}", path.display());
        let verified = lab.ask(&first, "verify", &["--depot"]);
        assert_eq!(verified.status.code(), Some(1), "{context}");
        let key = path
            .strip_prefix(lab.depot())
            .unwrap()
            .display()
            .to_string();
        assert!(
            stdout(&verified).contains(&key),
            "{context}: {}",
            stdout(&verified)
        );
        let second = machine();
        lab.run(&second, &OTHER);
        lab.ask(&second, "pull", &[]);
        assert_same(&all_shown_of(&second, &OTHER), &expected, &context);
        write_unnoticed(path, &before);
    }
}

/// Makes everything in a depot older.
fn age(depot: &Path, by: Duration) {
    set_times(depot, |time| time - by);
}

/// Changes when the files of a depot were stored, by its clock.
fn set_times(depot: &Path, change: impl Fn(SystemTime) -> SystemTime) {
    for path in files_below(depot) {
        let file = File::options().append(true).open(&path);
        let file = file.or_else(|_| File::open(&path)).unwrap();
        let then = file.metadata().unwrap().modified().unwrap();
        file.set_modified(change(then)).unwrap();
    }
}

const DAY: Duration = Duration::from_hours(24);

#[test]
fn gc_of_a_depot_keeps_the_newest_runs_and_whatever_is_young() {
    let lab = Lab::new();
    let (first, second) = (machine(), machine());
    lab.run(&first, &["--set", "first.add=3"]);
    age(&lab.depot(), 8 * DAY);
    lab.run(&first, &[]);
    let collect = |arguments: &[&str]| -> Value {
        let arguments = [&["--depot", "--format", "json"], arguments].concat();
        let output = lab.ask(&first, "gc", &arguments);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let n_before = lab.keys("").len();
    let said = collect(&["--dry-run"]);
    assert_eq!(lab.keys("").len(), n_before, "a dry run removes nothing");
    // Results that another machine makes meanwhile, and that the old run had as well, stay.
    second.input("held", b"a held one");
    for partition in 0..12 {
        second.let_go(&crate::engine::place::name(partition));
    }
    let mut run = Running::start(lab.share(second.held(&["--set", "first.add=4"])));
    run.wait_for(&second, "held");
    let done = collect(&[]);
    assert_eq!(done["units"], said["units"]);
    assert_eq!(done["units"]["first.parts"]["n_units"], 12, "{done}");
    assert!(done["units"].get("split.parts").is_none(), "{done}");
    fs::remove_dir_all(second.path("gate")).unwrap();
    let (code, said) = run.finish();
    assert_eq!(code, Some(0), "{said}");
    lab.assert_whole(&first);
    let third = machine();
    lab.run(&third, &[]);
    assert_eq!(third.take_log(), [], "the newest run was kept");
    lab.run(&third, &["--set", "first.add=3"]);
    assert!(!third.take_log().is_empty(), "the old one was not");
}

#[test]
fn clocks_that_differ_by_an_hour_make_no_difference() {
    let hour = Duration::from_hours(1);
    let late: fn(SystemTime, Duration) -> SystemTime = |time, by| time - by;
    let early: fn(SystemTime, Duration) -> SystemTime = |time, by| time + by;
    for change in [late, early] {
        let lab = Lab::new();
        let [first, second, third] = [(); 3].map(|()| machine());
        // Files stored now are an hour old, or will be stored in an hour, for every other machine.
        lab.run(&first, &[]);
        set_times(&lab.depot(), |time| change(time, hour));
        lab.run(&second, &OTHER);
        assert_eq!(second.take_log().len(), 12 + 1);
        let n_before = lab.keys("").len();
        let collected = lab.ask(&third, "gc", &["--depot"]);
        assert_eq!(collected.status.code(), Some(0), "{}", stderr(&collected));
        assert_eq!(lab.keys("").len(), n_before, "nothing is a week old");
        lab.run(&third, &[]);
        lab.run(&third, &OTHER);
        assert_eq!(third.take_log(), []);
        lab.assert_whole(&third);
        // A changed input is no stale hit, whenever it was written.
        third.input("p000", b"another");
        lab.run(&third, &[]);
        assert!(!third.take_log().is_empty());
        lab.assert_whole(&third);
    }
}

#[test]
fn a_depot_that_is_not_one_is_an_error_with_a_hint() {
    let machine = machine();
    for (name, says) in [
        ("s4://bucket/lab", "unknown kind `s4`"),
        ("lab/depot", "relative to the working directory"),
    ] {
        let mut run = machine.command("run", &[]);
        let refused = run.env("PIPELINE_DEPOT", name).output().unwrap();
        let said = stderr(&refused);
        assert_eq!(refused.status.code(), Some(2), "{said}");
        assert!(said.contains(says) && said.contains("hint: "), "{said}");
    }
    for command in ["push", "pull"] {
        let refused = machine.bare(&machine.lake(), command).output().unwrap();
        let said = stderr(&refused);
        assert_eq!(refused.status.code(), Some(2), "{said}");
        assert!(said.contains("export PIPELINE_DEPOT="), "{said}");
    }
    assert!(!machine.lake().exists());
    // One of another version is left alone.
    let lab = Lab::new();
    put(&lab.depot().join("format"), b"depot 99\n");
    let ran = lab.run(&machine, &ALONE);
    assert_eq!(warnings(&ran), 1, "{}", stderr(&ran));
    assert_eq!(lab.keys("").len(), 1);
    // Nor is it waited for.
    let refused = lab.share(machine.command("run", &["--set", "first.add=5"]));
    let refused = { refused }.output().unwrap();
    let said = stderr(&refused);
    assert_eq!(refused.status.code(), Some(1), "{said}");
    assert!(
        said.contains("error: the depot's layout is `depot 99`"),
        "{said}"
    );
}
