//! Executors: a wave of work items goes out, and `Done`, `Failed` or `Lost` comes back for each.

use std::{
    collections::BTreeMap,
    ops::ControlFlow,
    path::Path,
    sync::{Mutex, PoisonError},
};

use crate::{
    digest::Digest,
    error::Failure,
    event::{Event, Events},
    graph::Node,
    name::{NodeName, UnitName},
    output::Execution,
    resources::Resources,
    state::State,
    store::Turn,
    unit::ListedUnit,
    unit_runner::{UnitRunner, WorkItemOutcome},
    work_item::{Recompute, WorkItem},
    workers,
};

/// Makes units: in threads or processes, on this machine or on others.
pub trait Executor: Sync {
    /// Whether it makes this wave; otherwise the threads of this process do.
    fn takes(&self, _wave: &Wave) -> bool {
        true
    }

    /// Whether units are begun after another has failed.
    fn keeps_going(&self) -> bool {
        false
    }

    /// Makes the units of a wave, and reports the outcome of each, by its position. A unit without
    /// a report was not begun, because another has failed.
    ///
    /// # Errors
    ///
    /// Fails if it can make none of them.
    fn execute(&self, wave: &Wave, events: &Events, on_outcome: &OnOutcome) -> Result<(), Failure>;
}

/// Receives the outcome of the unit at a position of its wave, from any thread.
pub type OnOutcome<'a> = dyn Fn(usize, UnitOutcome) + Sync + 'a;

/// Outcome of an attempt to make a unit.
#[derive(Debug)]
pub enum UnitOutcome {
    /// Its result is in the store.
    Done {
        /// Whether it was made now, and not before.
        made_now: bool,
    },
    /// It cannot be made: another try would fail as well.
    Failed(Failure),
    /// Its worker was lost, or lacked something that it needs: another try may succeed.
    Lost {
        /// Why, as a sentence without a final period.
        why: String,
        /// Units whose artifacts it reads and could not get.
        missing: Vec<UnitName>,
        /// Whether it counts as a try: not where it was preempted, or its machine was lost.
        counts: bool,
    },
}

impl UnitOutcome {
    /// Returns the outcome of a unit that was lost.
    pub fn lost(why: impl Into<String>) -> Self {
        Self::Lost {
            why: why.into(),
            missing: Vec::new(),
            counts: true,
        }
    }

    /// Returns the outcome of a unit that was lost by no fault of its own, and is tried again as if it had not begun.
    pub fn preempted(why: impl Into<String>) -> Self {
        Self::Lost {
            why: why.into(),
            missing: Vec::new(),
            counts: false,
        }
    }

    /// Returns the outcome of a unit that could not read the artifacts of others.
    pub fn missing_artifacts(missing: Vec<UnitName>) -> Self {
        Self::Lost {
            why: "an artifact that it reads is damaged or missing".to_owned(),
            missing,
            counts: true,
        }
    }
}

/// Units of one output that are to be made, all inputs of which are made.
pub struct Wave<'a> {
    pub(crate) state: &'a State<'a>,
    pub(crate) node: &'a Node,
    pub(crate) units: &'a [&'a ListedUnit],
    pub(crate) forced: Recompute,
    /// Seconds that a unit of the output took before, the median, if any is known.
    pub took_s: Option<f64>,
}

impl Wave<'_> {
    /// Number of units.
    pub fn len(&self) -> usize {
        self.units.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.units.is_empty()
    }

    /// Returns the name of the unit at a position.
    pub fn unit(&self, idx: usize) -> UnitName {
        UnitName::new(&self.node.name, &self.units[idx].partition)
    }

    /// The output.
    pub fn output(&self) -> &NodeName {
        &self.node.name
    }

    /// The pipeline file.
    pub fn file(&self) -> &Path {
        &self.state.pipeline().origin.file
    }

    /// The pipeline's name.
    pub fn pipeline(&self) -> &str {
        &self.state.pipeline().name
    }

    /// Resources that a unit needs (cores, memory, GPUs, time).
    pub fn resources(&self) -> &Resources {
        &self.state.pipeline().stage(self.node).resources
    }

    /// Returns the work item of the unit at a position.
    ///
    /// # Errors
    ///
    /// Fails if a file that it reads has changed.
    pub fn work_item(&self, idx: usize) -> Result<WorkItem, Failure> {
        WorkItem::new(self.state, self.node, self.units[idx], self.forced)
    }

    /// Makes each unit with `make` in up to `n_workers` threads, and begins none after a failure, unless it
    /// `keeps_going`.
    pub fn each(
        &self,
        n_workers: usize,
        keeps_going: bool,
        (events, on_outcome): (&Events, &OnOutcome),
        make: impl Fn(&WorkItem) -> UnitOutcome + Sync,
    ) {
        let make = |idx| {
            let end = match self.work_item(idx) {
                Ok(item) => make(&item),
                Err(err) => UnitOutcome::Failed(err),
            };
            if !matches!(end, UnitOutcome::Done { .. }) {
                self.end_turn(idx);
            }
            tell(idx, end, keeps_going, on_outcome)
        };
        // Units that move a robot keep their order, and have claims.
        let takes_turns = self.node.output.execution == Execution::Parallel
            && self.forced == Recompute::No
            && self.state.store().takes_turns();
        if !takes_turns {
            return workers::each(self.len(), n_workers, make);
        }
        let waited_for = Mutex::new(BTreeMap::new());
        workers::each_by_turns(self.len(), n_workers, |idx| match self.turn(idx) {
            Turn::Own => Some(make(idx)),
            Turn::Made => Some(tell(
                idx,
                UnitOutcome::Done { made_now: false },
                keeps_going,
                on_outcome,
            )),
            Turn::Others(machine) => {
                // The first time others are left to make here.
                let mut looks = waited_for.lock().unwrap_or_else(PoisonError::into_inner);
                let n_looks = looks.entry(idx).or_insert(0);
                *n_looks += 1;
                if *n_looks == 2 {
                    events(&Event::UnitWaiting {
                        unit: self.unit(idx),
                        holder: format!("`{machine}`, which makes it now"),
                    });
                }
                None
            }
        });
    }

    /// Whose turn it is to make the unit at a position.
    fn turn(&self, idx: usize) -> Turn {
        // What is wrong with it comes out where its item is made.
        let digest = self.digest(idx);
        digest.map_or(Turn::Own, |digest| self.state.store().turn(&digest))
    }

    fn end_turn(&self, idx: usize) {
        if let Some(digest) = self.digest(idx) {
            self.state.store().end_turn(&digest);
        }
    }

    fn digest(&self, idx: usize) -> Option<Digest> {
        let found = self.state.fingerprint(self.node, self.units[idx]);
        found.ok().flatten().map(|(_, digest)| digest)
    }
}

/// Reports an end, and says whether others follow.
fn tell(
    idx: usize,
    end: UnitOutcome,
    keeps_going: bool,
    on_outcome: &OnOutcome,
) -> ControlFlow<()> {
    let is_last = matches!(end, UnitOutcome::Failed(_)) && !keeps_going;
    on_outcome(idx, end);
    if is_last {
        ControlFlow::Break(())
    } else {
        ControlFlow::Continue(())
    }
}

/// Makes units in threads of this process.
pub(crate) struct Threads<'a> {
    pub(crate) runner: &'a UnitRunner<'a>,
    /// Units made at once.
    pub(crate) n_workers: usize,
}

impl Executor for Threads<'_> {
    fn execute(&self, wave: &Wave, events: &Events, on_outcome: &OnOutcome) -> Result<(), Failure> {
        let stage = wave.state.pipeline().stage(wave.node);
        wave.each(self.n_workers, false, (events, on_outcome), |item| {
            let made = self.runner.make(stage, wave.node.output_idx, item, events);
            made.map_or_else(UnitOutcome::Failed, UnitOutcome::from)
        });
        Ok(())
    }
}

impl From<WorkItemOutcome> for UnitOutcome {
    fn from(outcome: WorkItemOutcome) -> Self {
        match outcome {
            WorkItemOutcome::Made { made_now } => Self::Done { made_now },
            WorkItemOutcome::InputsMissing(units) => Self::missing_artifacts(units),
        }
    }
}
