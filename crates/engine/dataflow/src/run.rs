//! Running a pipeline: makes the units that are not in the store.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
    time::Instant,
};

use crate::{
    advice::BoxedDiagnostic,
    digest::Digest,
    error::Failure,
    event::{Event, Events},
    executor::Executor,
    graph::Node,
    name::{NodeName, PartitionKey},
    options::RunOptions,
    pipeline::{Pipeline, StageEntry},
    record::RecordOutcome,
    retry_scheduler::{RetryScheduler, UnitReport},
    scope::SkippedItem,
    state::State,
    store::{
        NewestUnit, NodeRecord, OutputRecord, PublishedUnit, RunRecord, RunStatus, StageRecord,
        Store, UnitRef,
    },
    unit::ListedUnit,
    work_item::Recompute,
};

/// Report of a run.
#[derive(Debug, Clone)]
pub struct RunReport {
    /// The run's number in the store; `None` if everything was cached and unchanged since an
    /// earlier run.
    pub run: Option<u64>,
    /// Every output.
    pub nodes: Vec<NodeReport>,
    /// Seconds it took.
    pub seconds: f64,
}

impl RunReport {
    /// Number of units that this run made.
    pub fn made_now_count(&self) -> usize {
        self.nodes.iter().map(|node| node.record.n_made_now).sum()
    }

    /// Number of items skipped.
    pub fn skipped_count(&self) -> usize {
        self.nodes.iter().map(|node| node.record.n_skipped).sum()
    }
}

/// The outcome of one output.
#[derive(Debug, Clone)]
pub struct NodeReport {
    /// The outcome as it is stored.
    pub record: NodeRecord,
    /// Every unit.
    pub units: Vec<UnitReport>,
}

/// Runs a pipeline; `executor` makes the units that it takes, the threads of this process the others.
///
/// # Errors
///
/// Fails if a stage fails or the store cannot be used; results stored before the failure stay.
pub fn run(
    pipeline: &Pipeline,
    store: &dyn Store,
    options: &RunOptions,
    executor: Option<&dyn Executor>,
    events: &Events,
) -> Result<RunReport, Failure> {
    let started = Instant::now();
    let nodes = options.nodes(pipeline)?;
    events(&Event::RunStarted {
        n_outputs: nodes.len(),
    });
    store.enter(&pipeline.name)?;
    let mut runner = Runner {
        scheduler: RetryScheduler::new(store, options.jobs, executor, events),
        pipeline,
        store,
        options,
        events,
        started,
        state: State::new(pipeline, store),
        reports: Vec::new(),
        number: None,
    };
    let outcome = runner.go_through(&nodes).and_then(|()| runner.tidy());
    runner.finish(outcome)
}

struct Runner<'a> {
    pipeline: &'a Pipeline,
    store: &'a dyn Store,
    options: &'a RunOptions,
    events: &'a Events<'a>,
    started: Instant,
    scheduler: RetryScheduler<'a>,
    state: State<'a>,
    reports: Vec<NodeReport>,
    /// The run's number, assigned when it first makes something.
    number: Option<u64>,
}

impl Runner<'_> {
    fn go_through(&mut self, nodes: &[&Node]) -> Result<(), Failure> {
        // A fault of the last stage is reported before the first one works for an hour.
        self.pipeline.prepare(nodes)?;
        for node in nodes {
            let stage = self.pipeline.stage(node);
            if self.options.only_recalls(&node.name.stage) {
                let store = self.store;
                self.state.recall(node, |digest| store.lookup(digest))?;
            } else {
                self.make_node(node, stage)?;
            }
        }
        Ok(())
    }

    /// Publishes rebuilt outputs, and unpublishes those no longer in the pipeline.
    fn tidy(&self) -> Result<(), Failure> {
        let repaired = self.scheduler.repaired().clone();
        for report in &self.reports {
            let mut nodes = self.pipeline.nodes.iter();
            let node = nodes.find(|node| node.name == report.record.node);
            if let Some(node) = node.filter(|node| repaired.contains(&node.name)) {
                self.publish(node, report)?;
            }
        }
        let kept = &self.pipeline.nodes;
        Ok(self.store.retire(&self.pipeline.name, kept)?)
    }

    fn publish(&self, node: &Node, report: &NodeReport) -> Result<(), Failure> {
        let made: Vec<PublishedUnit> = report
            .units
            .iter()
            .filter(|unit| unit.outcome.is_made())
            .map(|unit| PublishedUnit {
                partition: &unit.partition,
                fingerprint: &unit.fingerprint,
                outcome: &unit.outcome,
            })
            .collect();
        Ok(self.store.publish(&self.pipeline.name, node, &made)?)
    }

    fn make_node(&mut self, node: &Node, stage: &StageEntry) -> Result<(), Failure> {
        let started = Instant::now();
        let units = self.state.units(node)?;
        if units.is_empty() {
            let mut before = self.reports.iter().rev();
            let leaving = before
                .find(|report| report.record.n_skipped + report.record.n_filtered > 0)
                .map(|report| report.record.node.clone().into());
            return Err(Failure::Nothing {
                node: node.name.clone(),
                left_out: leaving,
            });
        }
        let (mut made, missing) = self.found_and_missing(node, &units)?;
        let mut failure = None;
        if !missing.is_empty() {
            self.begin()?;
            (self.events)(&Event::OutputStarted {
                output: node.name.clone(),
                n_units: units.len(),
            });
            for unit in &made {
                (self.events)(&unit.event(&node.name));
            }
            let mut failures = Vec::new();
            for result in self.make(node, stage, &missing) {
                match result {
                    Ok(unit) => made.push(unit),
                    Err(err) => failures.push(err),
                }
            }
            if !self.scheduler.keeps_going() {
                // Those that were in flight beside the first say the same.
                failures.truncate(1);
            }
            failure = Failure::of_units(&node.name, missing.len(), failures);
            made.sort_by(|a, b| a.partition.cmp(&b.partition));
        }
        let mut report = report(node, stage, made, started)?;
        let failure = failure.or_else(|| too_many_skipped(node, stage, &report));
        if failure.is_none() {
            self.publish(node, &report)?;
            report.record.published = true;
            (self.events)(&Event::OutputDone {
                output: node.name.clone(),
                description: report.record.description.clone(),
                n_made_now: report.record.n_made_now,
                seconds: report.record.seconds,
            });
        }
        let mut known = BTreeMap::new();
        for unit in &report.units {
            let outcome = Arc::clone(&unit.outcome);
            let made = self.state.learn(&node.name, &unit.partition, outcome);
            known.extend(made.map(|made| (unit.partition.clone(), made)));
        }
        self.state.insert(&node.name, known);
        self.reports.push(report);
        if let Some(failure) = failure {
            return Err(failure);
        }
        if let Some(number) = self.number {
            let progress = self.record(RunStatus::Running);
            self.store.keep_progress(number, &progress)?;
        }
        Ok(())
    }

    /// Returns the units that are stored, and those that are to be made.
    fn found_and_missing<'u>(
        &self,
        node: &Node,
        units: &'u [ListedUnit],
    ) -> Result<(Vec<UnitReport>, Vec<&'u ListedUnit>), Failure> {
        let (mut found, mut missing) = (Vec::with_capacity(units.len()), Vec::new());
        let mut digests = Vec::with_capacity(units.len());
        for unit in units {
            let fingerprint = self.state.fingerprint(node, unit)?;
            digests.push(fingerprint.map(|(_, digest)| digest));
        }
        let known = digests.iter().flatten().copied();
        self.store.look_ahead(&node.name, known.collect());
        for (unit, digest) in units.iter().zip(digests) {
            match self.found(node, unit, digest)? {
                Some(report) => found.push((unit, report)),
                None => missing.push(unit),
            }
        }
        self.store.look_ahead(&node.name, Vec::new());
        let outcomes: Vec<&RecordOutcome> = found.iter().map(|(_, it)| &*it.outcome).collect();
        let mut is_complete = self.store.fetch_published(&outcomes)?.into_iter();
        let mut made = Vec::with_capacity(units.len());
        for (unit, report) in found {
            match is_complete.next() {
                Some(true) => made.push(report),
                Some(false) | None => missing.push(unit),
            }
        }
        Ok((made, missing))
    }

    /// Returns a unit's stored result, unless a rerun is forced.
    fn found(
        &self,
        node: &Node,
        unit: &ListedUnit,
        digest: Option<Digest>,
    ) -> Result<Option<UnitReport>, Failure> {
        if self.options.is_forced(&node.name.stage) {
            return Ok(None);
        }
        let Some(digest) = digest else {
            return Ok(None);
        };
        let outcome = self.store.lookup(&digest)?;
        let lasting = outcome.filter(|outcome| !outcome.is_provisional());
        Ok(lasting.map(|outcome| UnitReport {
            partition: unit.partition.clone(),
            fingerprint: digest,
            outcome,
            made_now: false,
        }))
    }

    /// Makes units.
    fn make(
        &self,
        node: &Node,
        stage: &StageEntry,
        units: &[&ListedUnit],
    ) -> Vec<Result<UnitReport, Failure>> {
        let forced = if self.options.is_forced(&stage.name) {
            Recompute::Yes
        } else {
            Recompute::No
        };
        self.scheduler.make(&self.state, node, units, forced)
    }

    /// Registers the run in the store, once, when it first makes something.
    fn begin(&mut self) -> Result<(), Failure> {
        if self.number.is_none() {
            self.number = Some(self.store.begin_run(&self.record(RunStatus::Running))?);
        }
        Ok(())
    }

    /// Records the run, unless everything was cached and unchanged since an earlier run.
    fn finish(self, outcome: Result<(), Failure>) -> Result<RunReport, Failure> {
        let name = &self.pipeline.name;
        let is_unchanged = outcome.is_ok()
            && self.number.is_none()
            && is_unchanged(&self.reports, &self.store.newest_units(name)?);
        let recorded = if is_unchanged {
            self.store.settle(name, None).map(|()| None)
        } else {
            match &outcome {
                Ok(()) => self.keep_or_find(),
                Err(err) => {
                    let message = err.to_string();
                    self.keep(RunStatus::Failed { message }).map(Some)
                }
            }
        };
        // The failure of the run matters more than a failure to record it.
        outcome.map_err(|err| match recorded {
            Ok(Some(number)) => err.of_run(number),
            Ok(None) | Err(_) => err,
        })?;
        Ok(RunReport {
            run: recorded?,
            seconds: self.started.elapsed().as_secs_f64(),
            nodes: self.reports,
        })
    }

    /// Records the run, unless it made nothing and an earlier run found the same.
    fn keep_or_find(&self) -> Result<Option<u64>, BoxedDiagnostic> {
        let record = self.record(RunStatus::Finished);
        if self.number.is_none() && self.store.find_run(&record)?.is_some() {
            let units = self.units_of(&record);
            self.store.settle(&self.pipeline.name, Some(&units))?;
            return Ok(None);
        }
        self.keep(RunStatus::Finished).map(Some)
    }

    /// The units of a record of this run, with their results.
    fn units_of(&self, record: &RunRecord) -> Vec<(UnitRef, Arc<RecordOutcome>)> {
        let outcomes = self.reports.iter().flat_map(|report| &report.units);
        let outcomes = outcomes.map(|unit| Arc::clone(&unit.outcome));
        record.units.iter().cloned().zip(outcomes).collect()
    }

    fn keep(&self, status: RunStatus) -> Result<u64, BoxedDiagnostic> {
        let record = self.record(status);
        let number = match self.number {
            Some(number) => number,
            None => self.store.begin_run(&record)?,
        };
        let units = self.units_of(&record);
        self.store.settle(&self.pipeline.name, Some(&units))?;
        self.store.end_run(number, &record, &units)?;
        Ok(number)
    }

    fn record(&self, status: RunStatus) -> RunRecord {
        let stages = self.pipeline.stages.iter().map(|stage| {
            let record = StageRecord {
                kind: stage.kind.name.to_owned(),
                config: stage.config(),
                inputs: stage.inputs.clone(),
            };
            (stage.name.clone(), record)
        });
        let units = self.reports.iter().flat_map(|report| {
            report.units.iter().map(|unit| UnitRef {
                node: report.record.node.clone(),
                partition: unit.partition.clone(),
                fingerprint: unit.fingerprint,
                made_now: unit.made_now,
            })
        });
        let outputs = self.pipeline.nodes.iter().map(|node| OutputRecord {
            node: node.name.clone(),
            partition: node.output.partition.to_owned(),
        });
        RunRecord {
            pipeline: self.pipeline.name.clone(),
            origin: self.pipeline.origin.clone(),
            seed: self.pipeline.seed,
            stages: stages.collect(),
            outputs: outputs.collect(),
            nodes: self
                .reports
                .iter()
                .map(|report| report.record.clone())
                .collect(),
            units: units.collect(),
            status,
            seconds: self.started.elapsed().as_secs_f64(),
        }
    }
}

/// Whether a run that made nothing found exactly the units of the newest runs.
fn is_unchanged(reports: &[NodeReport], newest: &[NewestUnit]) -> bool {
    let nodes: BTreeSet<&NodeName> = reports.iter().map(|report| &report.record.node).collect();
    let mut left: BTreeMap<(&NodeName, &PartitionKey), &Digest> = newest
        .iter()
        .filter(|unit| unit.current && nodes.contains(&unit.node))
        .map(|unit| ((&unit.node, &unit.partition), &unit.fingerprint))
        .collect();
    let mut found = reports.iter().flat_map(|report| {
        report
            .units
            .iter()
            .map(|unit| ((&report.record.node, &unit.partition), &unit.fingerprint))
    });
    found.all(|(unit, fingerprint)| left.remove(&unit) == Some(fingerprint)) && left.is_empty()
}

/// Returns the report of an output.
fn report(
    node: &Node,
    stage: &StageEntry,
    mut units: Vec<UnitReport>,
    started: Instant,
) -> Result<NodeReport, Failure> {
    // Units end in any order, and floating-point sums depend on it.
    units.sort_by(|a, b| a.partition.cmp(&b.partition));
    let outcomes: Vec<&RecordOutcome> = units.iter().map(|unit| &*unit.outcome).collect();
    let summarized = stage.configured.summarize(node.output_idx, &outcomes);
    let (summary, description) = summarized.map_err(|source| Failure::MetricValues {
        node: node.name.clone(),
        source,
    })?;
    let record = NodeRecord {
        node: node.name.clone(),
        description,
        published: false,
        n_made_now: units.iter().filter(|unit| unit.made_now).count(),
        n_made: summary.n_made,
        n_skipped: summary.n_skipped,
        n_filtered: summary.n_filtered,
        metrics: summary.metrics,
        seconds: started.elapsed().as_secs_f64(),
    };
    Ok(NodeReport { record, units })
}

fn too_many_skipped(node: &Node, stage: &StageEntry, report: &NodeReport) -> Option<Failure> {
    let n_skipped = report.record.n_skipped;
    let n_items = report.record.n_made + n_skipped;
    let first = report.units.iter().find_map(|unit| match &*unit.outcome {
        RecordOutcome::Skipped { reason } => Some(SkippedItem {
            key: unit.partition.to_string(),
            is_fault: true,
            reason: reason.clone(),
        }),
        RecordOutcome::Made { .. } | RecordOutcome::Filtered { .. } => None,
    })?;
    let exceeded = n_skipped as f64 > stage.max_skipped_fraction * n_items as f64;
    exceeded.then(|| Failure::TooManySkipped {
        skipped: node.name.clone().into(),
        n_skipped,
        n_items,
        allowed: stage.max_skipped_fraction,
        first: Box::new(first),
    })
}
