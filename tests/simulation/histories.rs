//! Random histories of machines, runs by a scheduler, their workers and their depot, on a simulated clock.
//!
//! Everything that decides is the program itself: requests that are made again, records that are looked up, notes with
//! heartbeats, orders, jobs and their outcomes, results that are kept. Only the depot's files, the scheduler's commands
//! and the time are simulated. While faults last, requests fail, hang, are cut or slow, processes are killed and started
//! again, and jobs are lost. In every history no result is lost, no unit is begun when its record has been visible for a
//! second (to a machine that met no fault lately), none is ordered again while a job lives that makes it, no run fails,
//! and everything ends when the faults end.
//!
//! `PIPELINE_HISTORIES=10000` runs that many, from the seed `PIPELINE_SEED` on. A history that fails is printed, and
//! fails again from its seed alone.

mod depot;
mod seen;
mod slurm;
mod stages;

use std::{
    collections::BTreeMap,
    env, fs,
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex,
        atomic::{AtomicU64, Ordering},
    },
    thread,
    time::Duration,
};

use ::depot::Depot;
use clock::{Process, World, lock, random};
use dataflow::{Digest, Event, Executor, Pipeline, RunOptions};
use lake::{Lake, OutagePolicy, Sharing};
use tempfile::TempDir;

use self::{
    depot::{Fault, SimulatedDepot, Trouble},
    seen::{End, Seen},
    slurm::Slurm,
};
use crate::{
    batch::{Batch, Scheduler},
    outages,
    progress::Quiet,
    report,
};

/// Histories of a plain test, and most of one in which a fault of the code of old is to be found.
const N_HISTORIES: u64 = 1000;

/// The first of their seeds; the others have smaller ones.
const FIRST_SEED: u64 = 1_000_000;
const N_OLD: u64 = 300;

/// Longest time for which faults last, in seconds.
const FAULTS_S: u64 = 240;

/// Longest time that anything takes after the faults: a scheduler's jobs are watched with patience.
const ENDS_AFTER: Duration = Duration::from_mins(30);

/// Time between looks at the processes.
const LOOK_EVERY: Duration = Duration::from_millis(500);

/// A fault of the code of old that a history is to find.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Old {
    /// None: the code of now.
    No,
    /// A worker's link is offline for good after one request that fails.
    LinkOffline,
    /// After one bad answer everything counts as absent, and is made again.
    MakesAgain,
    /// Units are looked up when a stage begins, and not before each.
    LooksUpOnce,
    /// A run by a scheduler fails after one bad answer.
    RunFails,
}

/// A number below another.
fn below(n: u64) -> u64 {
    random() % n.max(1)
}

/// Whether something happens that does so in this many of a hundred cases.
fn chance(percent: u64) -> bool {
    below(100) < percent
}

fn seconds(n: u64) -> Duration {
    Duration::from_secs(n)
}

/// A run, again and again until it has gone through.
struct Role {
    /// The machine, and whether jobs of the scheduler make its units.
    machine: String,
    is_on_slurm: bool,
    jobs: usize,
    lake: PathBuf,
    /// When it is started, for the first time or after it was killed.
    from: Duration,
    process: Option<Process>,
    result: Arc<Mutex<Option<Result<(), String>>>>,
}

/// A history.
struct History {
    seen: Arc<Seen>,
    depot: Arc<SimulatedDepot>,
    slurm: Arc<Slurm>,
    folder: PathBuf,
    n_units: u64,
    faults_end: Duration,
    roles: Vec<Role>,
    old: Old,
}

/// Runs the history of a seed in a folder.
fn run(seed: u64, old: Old, folder: &Path) -> End {
    World::simulate(seed, |world| {
        History::new(seed, old, folder).go_through(world)
    })
}

impl History {
    fn new(seed: u64, old: Old, folder: &Path) -> Self {
        let history = Seen::begin(seed);
        let roles = Role::all(folder, old);
        let faults_end = seconds(30 + below(FAULTS_S - 30));
        let machines: Vec<String> = roles.iter().map(|role| role.machine.clone()).collect();
        let troubles = (0..below(5))
            .map(|_| trouble(faults_end, &machines))
            .collect();
        let depot = Arc::new(SimulatedDepot {
            seen: Arc::clone(&history),
            troubles,
            old,
            files: Mutex::default(),
        });
        for trouble in &depot.troubles {
            history.log(&format!("{trouble:?}"));
        }
        Self {
            slurm: Arc::new(Slurm {
                seen: Arc::clone(&history),
                depot: Arc::clone(&depot) as Arc<dyn Depot>,
                folder: folder.to_owned(),
                old,
                faults_end,
                jobs: Mutex::default(),
                lakes: Mutex::default(),
            }),
            seen: history,
            depot,
            folder: folder.to_owned(),
            n_units: 2 + below(5),
            faults_end,
            roles,
            old,
        }
    }

    fn go_through(mut self, world: &World) -> End {
        while self.roles.iter().any(|role| lock(&role.result).is_none()) {
            if self.seen.time() > self.faults_end + ENDS_AFTER {
                self.seen.wrong("a run does not end".to_owned());
                return self.seen.end();
            }
            self.slurm.go_on(world);
            for idx in 0..self.roles.len() {
                self.go_on_with(idx, world);
            }
            clock::sleep(LOOK_EVERY);
        }
        for role in &self.roles {
            if let Some(Err(why)) = &*lock(&role.result) {
                self.seen
                    .wrong(format!("a run on {} failed: {why}", role.machine));
            }
        }
        self.push_all(world);
        self.check_depot();
        self.seen.end()
    }

    /// Starts a run when it is time, and kills it now and then while there are faults.
    fn go_on_with(&mut self, idx: usize, world: &World) {
        let now = self.seen.time();
        if self.roles[idx].process.is_none() && self.roles[idx].from <= now {
            let process = self.start(idx, world);
            self.roles[idx].process = Some(process);
        }
        let role = &mut self.roles[idx];
        let is_running = lock(&role.result).is_none();
        if let Some(process) = role
            .process
            .take_if(|_| is_running && now < self.faults_end && below(400) == 0)
        {
            self.seen.killed(process.name());
            process.kill();
            role.from = now + seconds(below(60));
        }
    }

    /// Starts a run in a process of its own.
    fn start(&self, idx: usize, world: &World) -> Process {
        let role = &self.roles[idx];
        let (lake, jobs, is_on_slurm) = (role.lake.clone(), role.jobs, role.is_on_slurm);
        let result = Arc::clone(&role.result);
        let depot: Arc<dyn Depot> = Arc::clone(&self.depot) as _;
        let (slurm, old) = (Arc::clone(&self.slurm), self.old);
        let (seed, n_units) = (self.seen.seed, self.n_units);
        let file = self.folder.join("history.toml");
        self.seen.log(&format!("start {}", role.machine));
        world.start(&role.machine, move || {
            let lake = Lake::open(&lake).with_depot(&depot, &sharing_of_run(old));
            let text = format!(
                "seed = {seed}\n[stages.first]\nkind = \"first\"\nseed = {seed}\nn_units = {n_units}\n\
                 [stages.second]\nkind = \"second\"\nseed = {seed}\ninputs.parts = \"first.parts\"\n"
            );
            let pipeline = Pipeline::parse(&file, &text, &stages::kinds(), None, &[]).unwrap();
            let ask = |words: &[String], stdin: &str| slurm.ask(words, stdin);
            let commands = include_str!("../../src/executors/slurm.toml");
            let scheduler: Scheduler = toml_edit::de::from_str(commands).unwrap();
            let batch = Batch {
                name: "slurm".to_owned(),
                scheduler,
                lake: &lake,
                depot: "simulated".to_owned(),
                logs: std::env::temp_dir(),
                ask: &ask,
            };
            let options = RunOptions {
                jobs,
                ..RunOptions::default()
            };
            let executor = is_on_slurm.then_some(&batch as &dyn Executor);
            let ran = dataflow::run(&pipeline, &lake, &options, executor, &|_: &Event| {});
            let tidied = ran.and_then(|_| if is_on_slurm { batch.tidy(&pipeline.name) } else { Ok(()) });
            lake.finish_sending(seconds(10)).unwrap();
            lake.leave();
            // Not where it was killed.
            clock::sleep(Duration::ZERO);
            *lock(&result) = Some(tidied.map_err(|err| report::sources(&err)));
        })
    }

    /// Sends what lies in any lake, as `pipeline push` does.
    fn push_all(&self, world: &World) {
        let lakes = self.roles.iter().map(|role| role.lake.clone());
        for folder in lakes.chain(lock(&self.slurm.lakes).clone()) {
            let depot: Arc<dyn Depot> = Arc::clone(&self.depot) as _;
            let seen = Arc::clone(&self.seen);
            let push = world.start("push", move || {
                let lake =
                    Lake::open(&folder).with_depot(&depot, &outages::required_sharing(Quiet::Yes));
                lake.send_all(seconds(600)).unwrap();
                let shared = lake.sharing().unwrap().unwrap();
                if shared.n_units_waiting > 0 {
                    seen.wrong(format!("{} results cannot be sent", shared.n_units_waiting));
                }
                lake.leave();
            });
            while !push.is_over() {
                clock::sleep(LOOK_EVERY);
            }
        }
    }

    /// Checks that every blob has the bytes of its digest.
    fn check_depot(&self) {
        let files = lock(&self.depot.files);
        for (key, (bytes, _)) in &*files {
            if let Some(digits) = key.strip_prefix("blobs/").and_then(|rest| rest.get(3..))
                && Digest::of_bytes(bytes).to_hex() != digits
            {
                self.seen.wrong(format!("`{key}` has other bytes"));
            }
        }
    }
}

/// How a run uses its depot.
fn sharing_of_run(old: Old) -> Sharing {
    let (patience, outage_policy) = match old {
        Old::MakesAgain => (0, OutagePolicy::Alone),
        Old::RunFails => (0, OutagePolicy::Fail),
        Old::No | Old::LinkOffline | Old::LooksUpOnce => (8 * 3600, OutagePolicy::Fail),
    };
    Sharing {
        patience: seconds(patience),
        outage_policy,
        on_outage: None,
    }
}

impl Role {
    /// One to three runs of the same pipeline, on machines of their own; what is made again is so by machines.
    fn all(folder: &Path, old: Old) -> Vec<Self> {
        let n_on_slurm = if old == Old::MakesAgain { 0 } else { below(3) };
        let n_plain = (1 - n_on_slurm.min(1)) + below(3 - n_on_slurm);
        (0..n_on_slurm + n_plain)
            .map(|number| Self {
                machine: format!("machine{number}"),
                is_on_slurm: number < n_on_slurm,
                jobs: 1 + usize::from(chance(30)),
                lake: folder.join(format!("lake{number}")),
                from: seconds(below(40)),
                process: None,
                result: Arc::default(),
            })
            .collect()
    }
}

/// A fault that is over before all faults end: of all machines, or of one, or of a node.
fn trouble(faults_end: Duration, machines: &[String]) -> Trouble {
    let faults = [
        Fault::Fails,
        Fault::Hangs,
        Fault::Lost,
        Fault::Cut,
        Fault::Slow,
        Fault::Full,
    ];
    let from = seconds(below(faults_end.as_secs()));
    let machine = match below(4) {
        0 => machines.get(below(machines.len() as u64) as usize).cloned(),
        1 => Some(format!("node{}", 1 + below(2))),
        _ => None,
    };
    Trouble {
        fault: faults[below(6) as usize],
        from,
        to: (from + seconds(1 + below(120))).min(faults_end),
        machine,
        percent: [5, 30, 100][below(3) as usize],
    }
}

/// A number in an environment variable.
fn number(variable: &str, otherwise: u64) -> u64 {
    env::var(variable).map_or(otherwise, |number| number.parse().unwrap())
}

/// A folder in memory, where there is one.
fn folder() -> TempDir {
    let memory = Path::new("/dev/shm");
    let made = memory.is_dir().then(|| TempDir::new_in(memory));
    made.and_then(Result::ok)
        .unwrap_or_else(|| TempDir::new().unwrap())
}

/// Runs the histories of these seeds, two at a time, until `each` has seen enough.
fn go_through(seeds: std::ops::Range<u64>, old: Old, each: impl Fn(u64, End) -> bool + Sync) {
    let next = AtomicU64::new(seeds.start);
    let folder = folder();
    let work = || loop {
        let seed = next.fetch_add(1, Ordering::Relaxed);
        if seed >= seeds.end {
            return;
        }
        let own = folder.path().join(seed.to_string());
        fs::create_dir(&own).unwrap();
        let is_enough = each(seed, run(seed, old, &own));
        fs::remove_dir_all(&own).unwrap();
        if is_enough {
            next.store(seeds.end, Ordering::Relaxed);
        }
    };
    thread::scope(|scope| {
        for _ in 0..thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(work);
        }
    });
}

#[test]
fn no_history_loses_a_result_begins_a_unit_too_late_or_does_not_end() {
    let first = number("PIPELINE_SEED", FIRST_SEED);
    let seeds = first..first + number("PIPELINE_HISTORIES", N_HISTORIES);
    let (failed, sums) = (Mutex::new(BTreeMap::new()), Mutex::new([0; 4]));
    go_through(seeds.clone(), Old::No, |seed, end| {
        let counts = [end.n_units, end.n_begun, end.n_killed, end.n_faults];
        lock(&sums)
            .iter_mut()
            .zip(counts)
            .for_each(|(sum, count)| *sum += count);
        if !end.wrong.is_empty() {
            lock(&failed).insert(seed, end);
        }
        lock(&failed).len() >= 10
    });
    let [n_units, n_begun, n_killed, n_faults] = *lock(&sums);
    println!(
        "{} histories: {n_units} units begun {n_begun} times, {n_faults} requests with a fault, {n_killed} processes killed",
        seeds.end - seeds.start
    );
    let failed = lock(&failed);
    for (seed, end) in &*failed {
        println!("history {seed}: {}", end.wrong.join("; "));
    }
    if let Some((seed, end)) = failed.first_key_value() {
        println!("{}", end.log);
        panic!(
            "{} histories fail, the first is {seed}: {:?}",
            failed.len(),
            end.wrong
        );
    }
    assert!(n_begun >= n_units && n_killed > 0 && n_faults > 0);
}

/// What goes wrong in histories with a fault of the code of old, with the history.
fn found(old: Old) -> Option<String> {
    let found = Mutex::new(None);
    go_through(0..N_OLD, old, |seed, end| {
        let wrong = end
            .wrong
            .first()
            .map(|wrong| format!("history {seed}: {wrong}"));
        let mut found = lock(&found);
        *found = found.take().or(wrong);
        found.is_some()
    });
    found.into_inner().unwrap()
}

#[test]
fn faults_of_the_old_code_are_found() {
    for (old, what) in [
        (Old::LinkOffline, "ends with the only result of"),
        (Old::MakesAgain, "after it was there"),
        (Old::LooksUpOnce, "after it was there"),
        (Old::RunFails, "failed"),
    ] {
        let found = found(old);
        println!("{old:?}: {found:?}");
        assert!(
            found.as_ref().is_some_and(|found| found.contains(what)),
            "{old:?}: {found:?}"
        );
    }
}

#[test]
fn the_history_of_a_seed_is_always_the_same() {
    let histories = [folder(), folder()].map(|folder| run(4711, Old::No, folder.path()).log);
    assert_eq!(histories[0], histories[1]);
}
