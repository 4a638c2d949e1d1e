//! Making the units of an output: waves of work items, until each is made, has failed, or was lost too often.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use crate::{
    digest::Digest,
    error::Failure,
    event::{Event, Events},
    executor::{Executor, Threads, UnitOutcome, Wave},
    graph::Node,
    name::{NodeName, PartitionKey, UnitName},
    output::Execution,
    record::RecordOutcome,
    state::{PartitionState, State},
    store::Store,
    unit::ListedUnit,
    unit_runner::UnitRunner,
    work_item::Recompute,
};

/// Maximum number of attempts at a unit whose worker is lost.
const TRIES: usize = 3;

/// The same of one that is displaced again and again.
const DISPLACED: usize = 50;

/// Number of an output's units from which the median time is taken.
const TIMED: usize = 9;

/// The outcome of one unit.
#[derive(Debug, Clone)]
pub struct UnitReport {
    /// The partition's key.
    pub partition: PartitionKey,
    /// Digest of its fingerprint.
    pub fingerprint: Digest,
    /// Its result.
    pub outcome: Arc<RecordOutcome>,
    /// Whether this run made it.
    pub made_now: bool,
}

impl UnitReport {
    /// Returns the event that reports it.
    pub(crate) fn event(&self, node: &NodeName) -> Event {
        Event::UnitDone {
            unit: UnitName::new(node, &self.partition),
            fingerprint: self.fingerprint,
            made_now: self.made_now,
            skipped: match &*self.outcome {
                RecordOutcome::Skipped { reason } => Some(reason.clone()),
                RecordOutcome::Made { .. } | RecordOutcome::Filtered { .. } => None,
            },
        }
    }
}

/// Makes units in this process or elsewhere, again where they are lost.
pub(crate) struct RetryScheduler<'a> {
    store: &'a dyn Store,
    runner: UnitRunner<'a>,
    executor: Option<&'a dyn Executor>,
    events: &'a Events<'a>,
    /// Outputs of which a damaged partition was rebuilt after they were published.
    repaired: Mutex<BTreeSet<NodeName>>,
}

/// Why a unit was lost, the units that it lacked, and whether it counts as a try.
type Loss = (String, Vec<UnitName>, bool);

/// Outcomes of the units of a wave.
#[derive(Default)]
struct WaveOutcomes {
    /// Those that are made or have failed.
    settled: Vec<Result<UnitReport, Failure>>,
    /// Positions of those that were lost, with the reasons, and whether that counts as a try.
    lost: Vec<(usize, String, bool)>,
    /// Units whose artifacts could not be read.
    missing: BTreeSet<UnitName>,
    /// Whether the executor can make no more of them.
    is_over: bool,
}

impl<'a> RetryScheduler<'a> {
    /// Makes units by `executor`, or in this many threads; 0 for one per core.
    pub(crate) fn new(
        store: &'a dyn Store,
        jobs: usize,
        executor: Option<&'a dyn Executor>,
        events: &'a Events<'a>,
    ) -> Self {
        Self {
            store,
            runner: UnitRunner::new(store, jobs),
            executor,
            events,
            repaired: Mutex::default(),
        }
    }

    /// Whether units are begun after another has failed.
    pub(crate) fn keeps_going(&self) -> bool {
        self.executor.is_some_and(Executor::keeps_going)
    }

    /// Outputs of which a damaged partition was rebuilt.
    pub(crate) fn repaired(&self) -> MutexGuard<'_, BTreeSet<NodeName>> {
        self.repaired.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Makes units whose inputs are all made; begins none after a failure, unless the executor keeps going.
    pub(crate) fn make(
        &self,
        state: &State,
        node: &Node,
        units: &[&ListedUnit],
        forced: Recompute,
    ) -> Vec<Result<UnitReport, Failure>> {
        let mut settled = Vec::with_capacity(units.len());
        let took_s = self.executor.and_then(|_| self.took_s(state, node));
        let keeps_going = self.keeps_going();
        let mut open = units.to_vec();
        // Tries of each unit, and all its losses.
        let mut losses: BTreeMap<&PartitionKey, (usize, usize)> = BTreeMap::new();
        while !open.is_empty() {
            let wave = Wave {
                state,
                node,
                units: &open,
                forced,
                took_s,
            };
            let ends = self.execute(&wave);
            settled.extend(ends.settled);
            if !keeps_going && settled.iter().any(Result::is_err) || ends.is_over {
                return settled;
            }
            let mut again = Vec::with_capacity(ends.lost.len());
            for (idx, why, counts) in ends.lost {
                let listed = open[idx];
                let (n_tries, n_losses) = losses.entry(&listed.partition).or_default();
                *n_tries += usize::from(counts);
                *n_losses += 1;
                if *n_tries < TRIES && *n_losses < DISPLACED {
                    again.push(listed);
                    continue;
                }
                let unit = UnitName::new(&node.name, &listed.partition);
                let n_tries = *n_losses;
                settled.push(Err(Failure::LostOften { unit, n_tries, why }));
            }
            if !again.is_empty() {
                for missing in &ends.missing {
                    if let Err(err) = self.repair(state, missing) {
                        settled.push(Err(err));
                        return settled;
                    }
                }
            }
            open = again;
        }
        settled
    }

    /// Has one wave made.
    fn execute(&self, wave: &Wave) -> WaveOutcomes {
        let one_by_one = Threads {
            runner: &self.runner,
            n_workers: 1,
        };
        let threads = Threads {
            runner: &self.runner,
            n_workers: self.runner.worker_count(),
        };
        let executor: &dyn Executor = match (wave.node.output.execution, self.executor) {
            // Units that move a robot stay in the run's own process.
            (Execution::OneByOne | Execution::Physical, _) => &one_by_one,
            (Execution::Parallel, Some(executor)) if executor.takes(wave) => executor,
            (Execution::Parallel, _) => &threads,
        };
        let ends = Mutex::new(WaveOutcomes::default());
        let executed = executor.execute(wave, self.events, &|idx, end| {
            let end = self.settle(wave, idx, end);
            let mut ends = ends.lock().unwrap_or_else(PoisonError::into_inner);
            match end {
                Ok(Ok(report)) => ends.settled.push(Ok(report)),
                Ok(Err((why, missing, counts))) => {
                    let unit = UnitName::new(&wave.node.name, &wave.units[idx].partition);
                    if missing.is_empty() {
                        let why = why.clone();
                        (self.events)(&Event::UnitLost { unit, why });
                    }
                    ends.missing.extend(missing);
                    ends.lost.push((idx, why, counts));
                }
                Err(err) => {
                    if executor.keeps_going() {
                        let unit = UnitName::new(&wave.node.name, &wave.units[idx].partition);
                        (self.events)(&err.event(unit));
                    }
                    ends.settled.push(Err(err));
                }
            }
        });
        let mut ends = ends.into_inner().unwrap_or_else(PoisonError::into_inner);
        ends.is_over = executed.is_err();
        ends.settled.extend(executed.err().map(Err));
        ends
    }

    /// Reports a made unit; of a lost one, returns the reason and the units that it lacked.
    fn settle(
        &self,
        wave: &Wave,
        idx: usize,
        end: UnitOutcome,
    ) -> Result<Result<UnitReport, Loss>, Failure> {
        let made_now = match end {
            UnitOutcome::Done { made_now } => made_now,
            UnitOutcome::Failed(err) => return Err(err),
            UnitOutcome::Lost {
                why,
                missing,
                counts,
            } => return Ok(Err((why, missing, counts))),
        };
        let unit = wave.units[idx];
        let found = wave.state.fingerprint(wave.node, unit)?;
        let arrived = match &found {
            Some((_, digest)) => self.store.arrived(digest)?.map(|outcome| (digest, outcome)),
            None => None,
        };
        let is_here = match &arrived {
            Some((_, outcome)) => self
                .store
                .fetch_published(&[&**outcome])?
                .into_iter()
                .all(|it| it),
            None => false,
        };
        let Some((digest, outcome)) = arrived.filter(|_| is_here) else {
            let why = "its result is not in the lake".to_owned();
            return Ok(Err((why, Vec::new(), true)));
        };
        let report = UnitReport {
            partition: unit.partition.clone(),
            fingerprint: *digest,
            outcome,
            made_now,
        };
        (self.events)(&report.event(&wave.node.name));
        Ok(Ok(report))
    }

    /// Makes a damaged artifact again from its inputs; equal fingerprints give equal bytes.
    fn repair(&self, state: &State, name: &UnitName) -> Result<(), Failure> {
        let lost = || Failure::Damaged { unit: name.clone() };
        let Some(PartitionState::Made(outcome)) = state.known(&name.node, &name.partition) else {
            return Err(lost());
        };
        let files = outcome.files().ok_or_else(lost)?;
        self.store.mark_suspect(files)?;
        if self.store.open(files)?.is_some() {
            return Ok(());
        }
        (self.events)(&Event::UnitDamaged { unit: name.clone() });
        self.repaired().insert(name.node.clone());
        let mut nodes = state.pipeline().nodes.iter();
        let node = nodes.find(|node| node.name == name.node).ok_or_else(lost)?;
        let units = state.units(node)?;
        let mut units = units.iter();
        let unit = units
            .find(|unit| unit.partition == name.partition)
            .ok_or_else(lost)?;
        let made = self.make(state, node, &[unit], Recompute::No);
        made.into_iter().collect::<Result<Vec<_>, _>>()?;
        self.store.open(files)?.map(drop).ok_or_else(lost)
    }

    /// Seconds that a unit of an output took before: the median of a few.
    fn took_s(&self, state: &State, node: &Node) -> Option<f64> {
        let newest = self.store.newest_units(&state.pipeline().name).ok()?;
        let of_node = newest.iter().filter(|unit| unit.node == node.name);
        let times = of_node.take(TIMED);
        let times = times.filter_map(|unit| self.store.took_s(&unit.fingerprint).ok()?);
        let mut times: Vec<f64> = times.collect();
        times.sort_by(f64::total_cmp);
        times.get(times.len() / 2).copied()
    }
}
