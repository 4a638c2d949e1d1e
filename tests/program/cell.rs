//! Dispatcher and cell as two programs over a real socket, of which each may die at any moment: no
//! motion is executed twice, and none is said to be done that is not.

use std::{
    collections::BTreeMap,
    fs,
    io::{BufRead, BufReader, Read},
    net::TcpListener,
    path::PathBuf,
    process::{Child, ChildStderr, Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use serde_json::Value;

use crate::bench::{Bench, stderr, stdout};

/// A lake in which everything is made but what a cell does.
struct Lab {
    bench: Bench,
    /// Where the cell listens, now and after it was started again.
    endpoint: String,
    /// What cells said of goals that are over.
    over: Vec<String>,
}

/// A cell's process.
struct Cell {
    process: Child,
    said: Option<BufReader<ChildStderr>>,
}

impl Lab {
    fn new() -> Self {
        let bench = Bench::new();
        bench.run_well(&["--until", "screen"]);
        let port = TcpListener::bind("127.0.0.1:0")
            .unwrap()
            .local_addr()
            .unwrap();
        Self {
            bench,
            endpoint: format!("tcp/{port}"),
            over: Vec::new(),
        }
    }

    fn journal(&self) -> PathBuf {
        self.bench.lake().join("cells/simulated")
    }

    /// Starts the cell and waits until it serves.
    fn cell(&self, arguments: &[&str]) -> Cell {
        self.cell_of(Command::new(env!("CARGO_BIN_EXE_pipeline")), arguments)
    }

    /// As [`Lab::cell`], by a program that runs what it is given.
    fn cell_of(&self, mut program: Command, arguments: &[&str]) -> Cell {
        let mut process = program
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .args(["cell", "--lake"])
            .arg(self.bench.lake())
            .args(["--listen", &self.endpoint])
            .args(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(process.stdout.take().unwrap())
            .read_line(&mut line)
            .unwrap();
        let said = process.stderr.take().map(BufReader::new);
        let cell = Cell { process, said };
        if line.trim() == self.endpoint {
            return cell;
        }
        panic!("{}", cell.end());
    }

    /// `pipeline run` of the last stage alone, at this cell.
    fn dispatch(&self) -> Command {
        let cell = format!("dispatch.cell={}", self.endpoint);
        self.bench.command(
            "run",
            &[
                "--only",
                "dispatch",
                "--set",
                &cell,
                "--set",
                "dispatch.answer_timeout_s=5.0",
            ],
        )
    }

    /// Runs the last stage, and expects that the cell has done everything that it took once, and that
    /// all of it is told.
    fn dispatch_to_the_end(&mut self, cell: Cell) {
        let ran = self.dispatch().output().unwrap();
        assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
        let taken = self.taken();
        self.end(cell);
        let outcomes = self.outcomes();
        assert!(!outcomes.contains_key("unknown"), "{outcomes:?}");
        assert_eq!(all_of(&outcomes), taken as u64, "{outcomes:?}");
        assert_eq!(self.over.len(), taken);
    }

    /// Ends a cell and keeps what it said.
    fn end(&mut self, cell: Cell) {
        let said = cell.end();
        let over = said.lines().filter(|line| line.starts_with("goal"));
        self.over.extend(over.map(str::to_owned));
    }

    /// Makes sure that no goal was over twice, and returns how many motions came out in which way.
    fn outcomes(&self) -> BTreeMap<String, u64> {
        let mut ids: Vec<&str> = self
            .over
            .iter()
            .filter_map(|line| {
                line.split([' ', ':'])
                    .filter(|word| !word.is_empty())
                    .nth(1)
            })
            .collect();
        ids.sort_unstable();
        let n = ids.len();
        ids.dedup();
        assert_eq!(ids.len(), n, "{:#?}", self.over);
        let sql = "select outcome, count(*) as n from executions group by outcome";
        let asked = self.bench.ask(&["query", "--format", "json", sql]);
        stdout(&asked)
            .lines()
            .map(|line| {
                let row: Value = serde_json::from_str(line).unwrap();
                let outcome = row["outcome"].as_str().unwrap().to_owned();
                (outcome, row["n"].as_u64().unwrap())
            })
            .collect()
    }

    /// How many goals the cell has taken.
    fn taken(&self) -> usize {
        let files = fs::read_dir(self.journal()).unwrap().flatten();
        files
            .filter(|file| {
                file.path()
                    .extension()
                    .is_some_and(|ending| ending == "goal")
            })
            .count()
    }
}

impl Cell {
    fn kill(&mut self) {
        let _gone = self.process.kill();
        let _gone = self.process.wait();
    }

    /// Ends the process and returns what it said.
    fn end(mut self) -> String {
        // What it says about the last goal may be under way.
        thread::sleep(Duration::from_millis(200));
        self.kill();
        let mut said = String::new();
        if let Some(mut reader) = self.said.take() {
            reader.read_to_string(&mut said).unwrap();
        }
        said
    }
}

impl Drop for Cell {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Motions of the small job that are sent when nothing goes wrong.
fn all_of(outcomes: &BTreeMap<String, u64>) -> u64 {
    outcomes.values().sum()
}

#[test]
fn a_cell_elsewhere_executes_what_was_accepted_and_knows_it_when_it_is_asked_again() {
    let mut lab = Lab::new();
    let cell = lab.cell(&["--fast"]);
    let ran = lab.dispatch().output().unwrap();
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    let taken = lab.taken();
    // Asked anew, the cell tells what it did, and does nothing.
    let again = lab
        .dispatch()
        .args(["--fresh", "dispatch"])
        .output()
        .unwrap();
    assert_eq!(again.status.code(), Some(0), "{}", stderr(&again));
    assert_eq!(lab.taken(), taken);
    lab.end(cell);
    let outcomes = lab.outcomes();
    assert_eq!(all_of(&outcomes), taken as u64, "{outcomes:?}");
    assert_eq!(lab.over.len(), taken);
}

#[test]
fn a_cell_that_dies_with_a_goal_leaves_it_unknown_and_the_next_run_goes_on() {
    for fault in [
        "die_before_answer@2",
        "die_after_answer@2",
        "die_in_motion@2",
    ] {
        let mut lab = Lab::new();
        let cell = lab.cell(&["--fast", "--fault", fault]);
        let ran = lab.dispatch().output().unwrap();
        let said = stderr(&ran);
        assert_eq!(ran.status.code(), Some(1), "{fault}: {said}");
        assert!(
            said.contains("is unknown, the robot may have moved"),
            "{said}"
        );
        assert!(said.contains("look at the robot"), "{said}");
        lab.end(cell);
        let cell = lab.cell(&["--fast"]);
        let ran = lab.dispatch().output().unwrap();
        assert_eq!(ran.status.code(), Some(0), "{fault}: {}", stderr(&ran));
        let taken = lab.taken();
        lab.end(cell);
        let outcomes = lab.outcomes();
        assert_eq!(outcomes.get("unknown"), Some(&1), "{fault}: {outcomes:?}");
        assert_eq!(all_of(&outcomes), taken as u64, "{fault}: {outcomes:?}");
        // Of all but the unknown one the cell has seen the end.
        assert_eq!(lab.over.len() + 1, taken, "{fault}");
    }
}

#[test]
fn answers_that_are_lost_late_or_doubled_change_nothing() {
    let mut lab = Lab::new();
    let faults = [
        "lose_answer@1",
        "double_answer@3",
        "lose_result@4",
        "late_answer@5",
    ];
    let mut arguments = vec!["--fast"];
    for fault in faults {
        arguments.extend(["--fault", fault]);
    }
    let cell = lab.cell(&arguments);
    lab.dispatch_to_the_end(cell);
}

#[test]
fn a_dispatcher_killed_at_fifty_moments_sends_nothing_twice() {
    let mut lab = Lab::new();
    let cell = lab.cell(&["--fast"]);
    for number in 0..50 {
        // Another moment each time, over the second in which it starts and sends.
        let pause = Duration::from_millis(20 + number * 389 % 900);
        let mut run = lab.dispatch().stderr(Stdio::null()).spawn().unwrap();
        let started = Instant::now();
        while started.elapsed() < pause && run.try_wait().unwrap().is_none() {
            thread::sleep(Duration::from_millis(1));
        }
        let _gone = run.kill();
        run.wait().unwrap();
    }
    lab.dispatch_to_the_end(cell);
}

#[test]
fn a_cell_that_hangs_is_unknown_and_tells_when_it_goes_on() {
    let mut lab = Lab::new();
    let cell = lab.cell(&["--fast", "--fault", "late_answer@2"]);
    let mut run = lab.dispatch().stderr(Stdio::piped()).spawn().unwrap();
    // Stopped while it is late with the answer to its second goal.
    let deadline = Instant::now() + Duration::from_mins(1);
    while lab.taken() < 2 && Instant::now() < deadline {
        thread::sleep(Duration::from_millis(5));
    }
    signal(&cell, "-STOP");
    let ended = run.wait().unwrap();
    assert_eq!(ended.code(), Some(1));
    signal(&cell, "-CONT");
    lab.dispatch_to_the_end(cell);
}

#[test]
fn a_cell_whose_disk_is_full_takes_nothing_more_and_says_why() {
    let allowed = Command::new("unshare").args(["-rm", "true"]).status();
    if !allowed.is_ok_and(|status| status.success()) {
        println!("skipped: no user namespaces here");
        return;
    }
    let mut lab = Lab::new();
    let journal = lab.bench.lake().join("small");
    fs::create_dir(&journal).unwrap();
    let mut shell = Command::new("unshare");
    let script = "mount -t tmpfs -o size=64k none \"$JOURNAL\"; exec \"$@\"";
    shell
        .args(["-rm", "sh", "-euc", script, "sh"])
        .arg(env!("CARGO_BIN_EXE_pipeline"))
        .env("JOURNAL", &journal);
    let arguments = ["--fast", "--journal", journal.to_str().unwrap()];
    let cell = lab.cell_of(shell, &arguments);
    let ran = lab.dispatch().output().unwrap();
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    lab.end(cell);
    let outcomes = lab.outcomes();
    let refused = outcomes.get("rejected").copied().unwrap_or_default();
    assert!(
        refused > 0 && !outcomes.contains_key("unknown"),
        "{outcomes:?}"
    );
    // What was taken was carried out and told, though its report could not be kept.
    assert_eq!(all_of(&outcomes) - refused, lab.over.len() as u64);
    assert!(!lab.over.is_empty());
    let sql = "select message from executions where outcome = 'rejected'";
    let asked = lab.bench.ask(&["query", "--format", "csv", sql]);
    assert!(
        stdout(&asked).contains("cannot write down"),
        "{}",
        stdout(&asked)
    );
}

fn signal(cell: &Cell, name: &str) {
    let id = cell.process.id().to_string();
    let sent = Command::new("kill").args([name, &id]).status().unwrap();
    assert!(sent.success());
}

#[test]
fn two_cells_do_not_share_a_journal() {
    let lab = Lab::new();
    let cell = lab.cell(&["--fast"]);
    let refused = Command::new(env!("CARGO_BIN_EXE_pipeline"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["cell", "--fast", "--listen", "tcp/127.0.0.1:0", "--lake"])
        .arg(lab.bench.lake())
        .output()
        .unwrap();
    assert_eq!(refused.status.code(), Some(1), "{}", stderr(&refused));
    assert!(
        stderr(&refused).contains("cell's journal"),
        "{}",
        stderr(&refused)
    );
    drop(cell);
}
