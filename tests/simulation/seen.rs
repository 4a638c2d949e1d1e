//! What happened in a history, and what must not.

use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    sync::{Arc, LazyLock, Mutex},
    time::{Duration, Instant},
};

use clock::lock;

/// Time for which a record is visible before nobody begins its unit any more.
const VISIBLE: Duration = Duration::from_secs(1);

/// Time after a fault of its depot in which a machine may not ask it yet: its longest pause, and an answer's time.
const AFTER_FAULT: Duration = Duration::from_secs(35);

/// The histories that run now: a stage knows the number of its own.
static HISTORIES: LazyLock<Mutex<HashMap<u64, Arc<Seen>>>> = LazyLock::new(Mutex::default);

/// What happened in a history.
pub(super) struct Seen {
    pub(super) seed: u64,
    began: Instant,
    facts: Mutex<Facts>,
}

#[derive(Default)]
struct Facts {
    /// Since when the record of a unit is in the depot.
    visible: BTreeMap<String, Duration>,
    /// When a machine last met a fault of the depot.
    faults: BTreeMap<String, Duration>,
    /// The processes that have finished a unit.
    finished: BTreeMap<String, Vec<String>>,
    killed: BTreeSet<String>,
    /// The jobs that have begun a unit.
    jobs: BTreeMap<String, Vec<String>>,
    n_begun: usize,
    wrong: Vec<String>,
    log: Vec<String>,
}

impl Seen {
    /// Begins a history, at its world's beginning.
    pub(super) fn begin(seed: u64) -> Arc<Self> {
        let history = Arc::new(Self {
            seed,
            began: clock::now(),
            facts: Mutex::default(),
        });
        lock(&HISTORIES).insert(seed, Arc::clone(&history));
        history
    }

    pub(super) fn of(seed: u64) -> Arc<Self> {
        Arc::clone(&lock(&HISTORIES)[&seed])
    }

    pub(super) fn time(&self) -> Duration {
        clock::since(self.began)
    }

    /// Notes an event for people.
    pub(super) fn log(&self, what: &str) {
        let line = format!("{:>9.3} {what}", self.time().as_secs_f64());
        lock(&self.facts).log.push(line);
    }

    /// Notes that something happened that must not.
    pub(super) fn wrong(&self, what: String) {
        self.log(&format!("WRONG {what}"));
        lock(&self.facts).wrong.push(what);
    }

    /// Notes that this machine met a fault.
    pub(super) fn fault(&self, what: &str) {
        let machine = clock::machine().unwrap();
        self.log(&format!("fault {machine} {what}"));
        lock(&self.facts).faults.insert(machine, self.time());
    }

    pub(super) fn killed(&self, process: &str) {
        self.log(&format!("kill {process}"));
        lock(&self.facts).killed.insert(process.to_owned());
    }

    pub(super) fn visible(&self, unit: &str) {
        self.log(&format!("visible {unit}"));
        let time = self.time();
        let mut facts = lock(&self.facts);
        facts.visible.entry(unit.to_owned()).or_insert(time);
    }

    /// Notes that this process begins a unit, which must not be there already.
    pub(super) fn begun(&self, unit: &str) {
        let (process, machine) = (clock::process().unwrap(), clock::machine().unwrap());
        self.log(&format!("begin {unit} {process}"));
        let (time, mut wrong) = (self.time(), None);
        let mut facts = lock(&self.facts);
        facts.n_begun += 1;
        let fault = facts.faults.get(&machine);
        let is_excused = fault.is_some_and(|fault| time < *fault + AFTER_FAULT);
        let visible = facts.visible.get(unit);
        if let Some(since) = visible.filter(|since| time > **since + VISIBLE && !is_excused) {
            let late_s = time.saturating_sub(*since).as_secs_f64();
            wrong = Some(format!(
                "{unit} begun by {process} {late_s:.1} s after it was there"
            ));
        }
        if machine.starts_with("node") {
            // A job that lives keeps what it makes: no run orders that again.
            let earlier = facts.jobs.entry(unit.to_owned()).or_default().clone();
            if let Some(by) = earlier.iter().find(|by| !facts.killed.contains(*by)) {
                wrong = Some(format!("{unit} begun by {process}, though {by} makes it"));
            }
            facts
                .jobs
                .entry(unit.to_owned())
                .or_default()
                .push(process.clone());
        }
        drop(facts);
        if let Some(wrong) = wrong {
            self.wrong(wrong);
        }
    }

    pub(super) fn finished(&self, unit: &str) {
        let process = clock::process().unwrap();
        self.log(&format!("finish {unit} {process}"));
        let mut facts = lock(&self.facts);
        facts
            .finished
            .entry(unit.to_owned())
            .or_default()
            .push(process);
    }

    /// Notes that this process, a worker, ends by itself: what it has finished must be in the depot.
    pub(super) fn ended(&self) {
        let process = clock::process().unwrap();
        self.log(&format!("end {process}"));
        let facts = lock(&self.facts);
        let own = facts
            .finished
            .iter()
            .filter(|(_, by)| by.contains(&process));
        let mut left = own.filter(|(unit, _)| !facts.visible.contains_key(*unit));
        let left = left
            .next()
            .map(|(unit, _)| format!("{process} ends with the only result of {unit}"));
        drop(facts);
        if let Some(left) = left {
            self.wrong(left);
        }
    }

    /// Ends the history: every result that was ever finished must be in the depot.
    pub(super) fn end(&self) -> End {
        lock(&HISTORIES).remove(&self.seed);
        let facts = lock(&self.facts);
        let lost = facts
            .finished
            .keys()
            .filter(|unit| !facts.visible.contains_key(*unit));
        let lost = lost.map(|unit| format!("the result of {unit} is lost"));
        End {
            wrong: facts.wrong.iter().cloned().chain(lost).collect(),
            log: facts.log.join("\n"),
            n_begun: facts.n_begun,
            n_units: facts.visible.len(),
            n_killed: facts.killed.len(),
            n_faults: facts
                .log
                .iter()
                .filter(|line| line.contains(" fault "))
                .count(),
        }
    }
}

/// How a history ended.
pub(super) struct End {
    /// What must not have happened.
    pub(super) wrong: Vec<String>,
    pub(super) log: String,
    pub(super) n_begun: usize,
    pub(super) n_units: usize,
    pub(super) n_killed: usize,
    pub(super) n_faults: usize,
}
