//! Random sequences of runs and of what happens to cell, dispatcher and lake between and during them: walks
//! through the model of goals, carried out with the programs themselves.
//!
//! After each step what the lake says is compared with what the cells wrote down themselves: no goal
//! is executed twice, and every outcome and count is the cells' own. `PIPELINE_SEQUENCES=1000` draws so many
//! sequences, from seed `PIPELINE_SEED` on.

use std::{
    collections::BTreeMap,
    env, fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

use crate::program::{
    bench::{stderr, stdout},
    cell_lab::{Lab, Served},
    goal_model::{self, Action, Memory},
};

/// Sequences drawn without `PIPELINE_SEQUENCES`.
const SEQUENCES: u64 = 3;
/// Actions of the model in a sequence.
const ACTIONS: usize = 10;
/// Faults of a cell, each at one of its first goals.
const FAULTS: [&str; 11] = [
    "die_before_answer",
    "die_after_answer",
    "die_in_motion",
    "lose_answer",
    "late_answer",
    "double_answer",
    "lose_result",
    "never_answer",
    "garbled_answer",
    "garbled_report",
    "wrong_report",
];
/// What a run that ends with code 1 says of one of the goals, or of the cell.
const REASONS: [&str; 6] = [
    "is unknown; the robot may have moved",
    "nothing moved",
    "nothing was sent to the robot",
    "changed since it was asked first",
    "cannot take goals",
    "was stopped at cell",
];

/// A step of a sequence.
#[derive(Debug, Clone, Copy)]
enum Step {
    /// A run to its end.
    Run(Way),
    /// A run that is killed after some milliseconds.
    KilledRun(u64),
    /// A person has looked at the robot.
    RaiseAttempt,
    /// The cell is killed and started again, with a fault at a goal.
    Restart(Option<(&'static str, u32)>),
    /// The cell is killed and started again with an empty journal and a new key.
    LostJournal,
    /// The cell is killed and started again with its key and without its goals.
    LostGoals,
    /// Garbage collection.
    Collect,
}

/// A way to run.
#[derive(Debug, Clone, Copy)]
enum Way {
    Plain,
    Fresh,
    OtherTimeout(u32),
    Processes,
    Detached,
}

/// Ways that change no option.
const WAYS: [Way; 6] = [
    Way::Plain,
    Way::Plain,
    Way::Plain,
    Way::Fresh,
    Way::Processes,
    Way::Detached,
];

/// Draws a sequence: a walk through the model of goals, and for each run and each fault a way to have it.
fn drawn(seed: u64) -> Vec<Step> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let walk = goal_model::walk(seed, ACTIONS);
    let mut steps = Vec::new();
    let mut actions = walk.iter().copied().peekable();
    while let Some(action) = actions.next() {
        match action {
            Action::Run => {
                let mut during = Vec::new();
                while let Some(fault) = actions.next_if(|next| is_fault(*next)) {
                    during.push(fault);
                }
                if during.iter().any(|fault| *fault != Action::CrashDispatcher) {
                    let fault = FAULTS[rng.random_range(0..FAULTS.len())];
                    steps.push(Step::Restart(Some((fault, rng.random_range(1..5)))));
                }
                steps.push(if during.contains(&Action::CrashDispatcher) {
                    Step::KilledRun(rng.random_range(50..1500))
                } else {
                    Step::Run(WAYS[rng.random_range(0..WAYS.len())])
                });
            }
            Action::RaiseAttempt => steps.push(Step::RaiseAttempt),
            Action::ChangeOption => {
                let timeout_s = rng.random_range(20..60);
                steps.push(Step::Run(Way::OtherTimeout(timeout_s)));
            }
            Action::CollectGarbage => steps.push(Step::Collect),
            Action::Start(0, Memory::Journal, _) => steps.push(Step::Restart(None)),
            Action::Start(0, Memory::KeyAlone, _) => steps.push(Step::LostGoals),
            // It begins another journal, or the second cell takes its place.
            Action::Start(..) => steps.push(Step::LostJournal),
            _ => {}
        }
    }
    steps
}

/// Whether an action of the model happens during a run.
fn is_fault(action: Action) -> bool {
    matches!(
        action,
        Action::CrashDispatcher
            | Action::LoseGoal
            | Action::LoseAnswer
            | Action::DelayGoal
            | Action::DeliverLate(_)
            | Action::Refuse(_)
    )
}

/// The state of a sequence.
struct Walk {
    lab: Lab,
    cell: Option<Served>,
    attempt: u32,
    /// Journals that were lost, where the cell no longer finds them.
    lost: Vec<PathBuf>,
}

impl Walk {
    fn new() -> Self {
        let lab = Lab::of_few_objects();
        let cell = lab.cell(&["--fast"]);
        Self {
            lab,
            cell: Some(cell),
            attempt: 1,
            lost: Vec::new(),
        }
    }

    fn dispatch(&self, more: &[&str]) -> Command {
        let mut command = self.lab.dispatch();
        let attempt = format!("dispatch.attempt={}", self.attempt);
        command.args(["--set", &attempt, "--set", "dispatch.answer_timeout_s=1.5"]);
        command.args(["--set", "dispatch.per_object=2"]);
        command.args(more).stdin(Stdio::null());
        command
    }

    /// Ends the cell as a crash does, and starts it again.
    fn restart(&mut self, arguments: &[&str]) {
        drop(self.cell.take());
        let fast = ["--fast"].iter().chain(arguments).copied();
        self.cell = Some(self.lab.cell(&fast.collect::<Vec<_>>()));
    }

    /// Moves the cell's journal to where it does not find it.
    fn lose_journal(&mut self) -> PathBuf {
        drop(self.cell.take());
        let lost = self
            .lab
            .bench
            .lake()
            .join(format!("lost-{}", self.lost.len()));
        fs::rename(self.lab.journal(), &lost).unwrap();
        self.lost.push(lost.clone());
        lost
    }

    fn execute(&mut self, step: Step) {
        match step {
            Step::Run(way) => self.run(way),
            Step::KilledRun(pause_ms) => {
                let mut run = self.dispatch(&[]).stderr(Stdio::null()).spawn().unwrap();
                let started = Instant::now();
                while started.elapsed() < Duration::from_millis(pause_ms)
                    && run.try_wait().unwrap().is_none()
                {
                    thread::sleep(Duration::from_millis(2));
                }
                let _gone = run.kill();
                run.wait().unwrap();
            }
            Step::RaiseAttempt => self.attempt += 1,
            Step::Restart(fault) => match fault {
                Some((fault, at)) => self.restart(&["--fault", &format!("{fault}@{at}")]),
                None => self.restart(&[]),
            },
            Step::LostJournal => {
                self.lose_journal();
                self.restart(&[]);
            }
            Step::LostGoals => {
                let lost = self.lose_journal();
                fs::create_dir_all(self.lab.journal()).unwrap();
                fs::copy(lost.join("key"), self.lab.journal().join("key")).unwrap();
                self.restart(&[]);
            }
            Step::Collect => {
                let ran = self.lab.bench.ask(&["gc", "--keep", "1"]);
                assert!(ran.status.success(), "{}", stderr(&ran));
            }
        }
    }

    fn run(&mut self, way: Way) {
        let timeout;
        let arguments: &[&str] = match way {
            Way::Plain => &[],
            Way::Fresh => &["--fresh", "dispatch"],
            Way::OtherTimeout(timeout_s) => {
                timeout = format!("dispatch.result_timeout_s={timeout_s}");
                &["--set", &timeout]
            }
            Way::Processes => &["--processes"],
            Way::Detached => &["--detach"],
        };
        let mut ran = self.dispatch(arguments).output().unwrap();
        // One that ends at once is not detached.
        if matches!(way, Way::Detached) && stderr(&ran).contains("detach run goes on") {
            ran = self.lab.bench.ask(&["attach"]);
        }
        // What a detached run has said is data to `attach`.
        let said = stderr(&ran) + &stdout(&ran);
        match ran.status.code() {
            Some(0) => self.check_line(&said),
            Some(1) => {
                let is_told = REASONS.iter().any(|reason| said.contains(reason));
                assert!(is_told, "{said}");
            }
            other => panic!("{other:?}: {said}"),
        }
    }

    /// The rows of a query.
    fn rows(&self, sql: &str) -> Vec<Value> {
        let asked = self.lab.bench.ask(&["query", "--format", "json", sql]);
        let text = stdout(&asked);
        text.lines()
            .map(|line| serde_json::from_str(line).unwrap())
            .collect()
    }

    fn outcomes(&self) -> BTreeMap<String, u64> {
        let mut outcomes = BTreeMap::new();
        for row in self.rows("select outcome, goal_id from executions") {
            let is_sent = row["goal_id"].as_str().is_some_and(|id| !id.is_empty());
            let word = match row["outcome"].as_str().unwrap() {
                "rejected" if !is_sent => "infeasible",
                word => word,
            };
            *outcomes.entry(word.to_owned()).or_default() += 1;
        }
        outcomes
    }

    /// Compares the line of a run with the rows that it has made.
    fn check_line(&self, said: &str) {
        let Some(line) = said.lines().find(|line| line.contains("motions → ")) else {
            return;
        };
        let outcomes = self.outcomes();
        let words = [
            ("succeeded", " succeed at"),
            ("failed", " failed"),
            ("aborted", " aborted by the cell"),
            ("rejected", " refused by the cell"),
            ("infeasible", " infeasible"),
            ("stopped", " stopped by a person"),
            ("unknown", " unknown, look at"),
        ];
        for (outcome, words) in words {
            let in_line = line.split_once(words).map_or(0, |(before, _)| {
                let number = before.rsplit([' ', ',']).next().unwrap();
                number.parse::<u64>().unwrap_or_else(|_| panic!("{line}"))
            });
            let in_rows = outcomes.get(outcome).copied().unwrap_or(0);
            assert_eq!(in_line, in_rows, "{outcome}: {line}, {outcomes:?}");
        }
    }

    /// Compares the rows with what the cells have written down.
    fn check(&self) {
        let journals = self.lost.iter().cloned().chain([self.lab.journal()]);
        let mut taken: BTreeMap<String, Vec<PathBuf>> = BTreeMap::new();
        for journal in journals {
            for path in fs::read_dir(&journal).unwrap().flatten() {
                let path = path.path();
                if path.extension().is_some_and(|ending| ending == "goal") {
                    let id = path.file_stem().unwrap().to_string_lossy().into_owned();
                    taken.entry(id).or_default().push(journal.clone());
                }
            }
        }
        for (id, journals) in &taken {
            assert_eq!(journals.len(), 1, "goal {id} was taken twice: {journals:?}");
        }
        if !self.lab.bench.lake().join("tables/executions").exists() {
            return;
        }
        for row in self.rows("select goal_id, outcome, accepted, simulated from executions") {
            let id = row["goal_id"].as_str().unwrap();
            let outcome = row["outcome"].as_str().unwrap();
            if id.is_empty() {
                continue;
            }
            assert_eq!(row["simulated"], true, "{row}");
            match outcome {
                "succeeded" | "failed" | "aborted" => {
                    let journal = taken
                        .get(id)
                        .unwrap_or_else(|| panic!("{row}: never taken"));
                    let told = first_line(&journal[0].join(format!("{id}.report")));
                    assert_eq!(told["outcome"], outcome, "{row}");
                }
                "rejected" => assert!(!taken.contains_key(id), "{row}: taken"),
                "unknown" | "stopped" => {}
                other => panic!("{other}: {row}"),
            }
        }
    }

    /// Compares the page and the table of trials with the rows.
    fn check_page(&self) {
        let ran = self.dispatch(&[]).output().unwrap();
        if ran.status.code() != Some(0) {
            return;
        }
        let attempt = format!("dispatch.attempt={}", self.attempt);
        let cell = format!("dispatch.cell={}", self.lab.endpoint);
        let arguments = ["--set", &cell, "--set", &attempt];
        let answer = [
            "--set",
            "dispatch.answer_timeout_s=1.5",
            "--set",
            "dispatch.per_object=2",
        ];
        let arguments = [arguments, answer].concat();
        let ran = self.lab.bench.run(&arguments);
        assert!(matches!(ran.status.code(), Some(0 | 3)), "{}", stderr(&ran));
        let outcomes = self.outcomes();
        let n = |words: &[&str]| -> u64 {
            let numbers = words.iter().filter_map(|word| outcomes.get(*word));
            numbers.sum()
        };
        let successes = n(&["succeeded"]);
        let trials = n(&["succeeded", "failed", "aborted", "unknown"]);
        let rows = self.rows("select sum(trials_n) as t, sum(successes_n) as s from trials");
        if let Some(row) = rows.first().filter(|_| trials > 0) {
            assert_eq!(
                (row["t"].as_u64(), row["s"].as_u64()),
                (Some(trials), Some(successes))
            );
            let page = self.lab.bench.lake();
            let page = page.join("reports/cgf/report/page/all/index.html");
            let page = fs::read_to_string(page).unwrap();
            let headline = format!("executions {successes} of {trials}");
            assert!(page.contains(&headline), "{headline}");
        }
    }
}

fn first_line(path: &Path) -> Value {
    let bytes = fs::read(path).unwrap();
    let line = bytes.split(|&byte| byte == b'\n').next().unwrap();
    serde_json::from_slice(line).unwrap()
}

fn number(variable: &str, default: u64) -> u64 {
    env::var(variable).map_or(default, |number| number.parse().unwrap())
}

#[test]
fn a_cell_counts_what_the_tables_say() {
    let from = number("PIPELINE_SEED", 1);
    for seed in from..from + number("PIPELINE_SEQUENCES", SEQUENCES) {
        let steps = drawn(seed);
        println!("seed {seed}: {steps:?}");
        let mut walk = Walk::new();
        for step in steps {
            walk.execute(step);
            walk.check();
        }
        walk.restart(&[]);
        walk.check_page();
        walk.check();
    }
}
