//! Running a pipeline: units that are not in the store are made, on several threads.

use std::{
    collections::{BTreeMap, BTreeSet},
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{Mutex, PoisonError},
    time::Instant,
};

use crate::{
    context::{Artifact, Context, Inputs},
    digest::Digest,
    error::Failure,
    graph::{Node, NodeName},
    observer::Observer,
    pipeline::{Pipeline, StageEntry},
    state::{Known, State},
    store::{Record, RecordOutcome, RunRecord, Store, UnitRef, Unkept},
    unit::{Summary, Unit},
    workers,
};

/// What to run and how.
#[derive(Debug, Clone, Default)]
pub struct RunOptions {
    /// Stop after this stage.
    pub until: Option<String>,
    /// Make the units of these stages again, even if their results are in the store.
    pub fresh: Vec<String>,
    /// Make every unit again.
    pub fresh_all: FreshAll,
    /// Number of worker threads; 0 for one per core.
    pub jobs: usize,
}

/// Whether results that are in the store count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FreshAll {
    /// They are used.
    #[default]
    UseStore,
    /// Everything is made again.
    MakeAgain,
}

impl RunOptions {
    /// Returns the outputs to go through.
    pub(crate) fn nodes<'p>(&self, pipeline: &'p Pipeline) -> Result<Vec<&'p Node>, Failure> {
        for name in self.until.iter().chain(&self.fresh) {
            if pipeline.find(name).is_none() {
                return Err(Failure::NoStage {
                    name: name.clone(),
                    known: pipeline
                        .stages
                        .iter()
                        .map(|stage| stage.name.clone())
                        .collect(),
                });
            }
        }
        let last = match &self.until {
            Some(stage) => pipeline
                .nodes
                .iter()
                .rposition(|node| &node.name.stage == stage),
            None => None,
        };
        let count = last.map_or(pipeline.nodes.len(), |last| last + 1);
        Ok(pipeline.nodes.iter().take(count).collect())
    }

    pub(crate) fn is_forced(&self, stage: &str) -> bool {
        self.fresh_all == FreshAll::MakeAgain || self.fresh.iter().any(|fresh| fresh == stage)
    }
}

/// What a run did.
#[derive(Debug, Clone)]
pub struct RunReport {
    /// The run's name in the store.
    pub run: String,
    /// Every output.
    pub nodes: Vec<NodeReport>,
    /// Seconds it took.
    pub seconds: f64,
}

impl RunReport {
    /// Number of units that this run made.
    pub fn n_made_now(&self) -> usize {
        self.nodes.iter().map(|node| node.n_made_now).sum()
    }

    /// Number of items skipped.
    pub fn n_skipped(&self) -> usize {
        self.nodes.iter().map(|node| node.summary.n_skipped).sum()
    }
}

/// What became of one output.
#[derive(Debug, Clone)]
pub struct NodeReport {
    /// The output.
    pub node: NodeName,
    /// Counts and metrics.
    pub summary: Summary,
    /// The stage's own line about it.
    pub description: String,
    /// Units that this run made.
    pub n_made_now: usize,
    /// Every unit.
    pub units: Vec<UnitReport>,
    /// Seconds it took.
    pub seconds: f64,
}

/// What became of one unit.
#[derive(Debug, Clone)]
pub struct UnitReport {
    /// The partition's key.
    pub partition: String,
    /// Digest of its fingerprint.
    pub fingerprint: Digest,
    /// Its result.
    pub outcome: RecordOutcome,
    /// Whether this run made it.
    pub made_now: bool,
}

/// Runs a pipeline.
///
/// # Errors
///
/// Fails if a stage fails or the store cannot be used; what was made before stays in the store.
pub fn run(
    pipeline: &Pipeline,
    store: &dyn Store,
    options: &RunOptions,
    observer: &dyn Observer,
) -> Result<RunReport, Failure> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(options.jobs)
        .build()
        .map_err(Failure::Threads)?;
    let started = Instant::now();
    let nodes = options.nodes(pipeline)?;
    observer.planned(&nodes);
    let mut runner = Runner {
        pipeline,
        store,
        options,
        observer,
        pool,
        state: State::new(pipeline, store),
        reports: Vec::new(),
        mended: Mutex::default(),
    };
    let outcome = runner.go_through(&nodes).and_then(|()| runner.tidy());
    let seconds = started.elapsed().as_secs_f64();
    let recorded = store.record_run(&RunRecord {
        pipeline: pipeline.name.clone(),
        seed: pipeline.seed,
        stages: pipeline
            .stages
            .iter()
            .map(|stage| (stage.name.clone(), stage.config()))
            .collect(),
        units: runner
            .reports
            .iter()
            .flat_map(|report| {
                report.units.iter().map(|unit| UnitRef {
                    node: report.node.clone(),
                    partition: unit.partition.clone(),
                    fingerprint: unit.fingerprint.clone(),
                    made_now: unit.made_now,
                })
            })
            .collect(),
        finished: outcome.is_ok(),
        seconds,
    });
    // Why the run failed says more than why it could not be recorded.
    outcome?;
    Ok(RunReport {
        run: recorded?,
        nodes: runner.reports,
        seconds,
    })
}

struct Runner<'a> {
    pipeline: &'a Pipeline,
    store: &'a dyn Store,
    options: &'a RunOptions,
    observer: &'a dyn Observer,
    /// Where stages compute; the units themselves are gone through by threads of their own.
    pool: rayon::ThreadPool,
    state: State<'a>,
    reports: Vec<NodeReport>,
    /// Outputs of which a damaged partition was made again after they were shown.
    mended: Mutex<BTreeSet<NodeName>>,
}

impl Runner<'_> {
    fn go_through(&mut self, nodes: &[&Node]) -> Result<(), Failure> {
        let mut prepared: Option<&str> = None;
        for node in nodes {
            let stage = self.pipeline.stage(node);
            if prepared != Some(&stage.name) {
                stage.prepare()?;
                prepared = Some(&stage.name);
            }
            self.make_node(node, stage)?;
        }
        Ok(())
    }

    /// Shows what was mended, and stops showing what the pipeline no longer makes.
    fn tidy(&self) -> Result<(), Failure> {
        let mended = self.mended.lock().unwrap_or_else(PoisonError::into_inner);
        for report in &self.reports {
            let node = self
                .pipeline
                .nodes
                .iter()
                .find(|node| node.name == report.node);
            if let Some(node) = node.filter(|node| mended.contains(&node.name)) {
                self.publish(node, report)?;
            }
        }
        let kept = &self.pipeline.nodes;
        Ok(self.store.retire(&self.pipeline.name, kept)?)
    }

    fn publish(&self, node: &Node, report: &NodeReport) -> Result<(), Failure> {
        let made: Vec<(String, RecordOutcome)> = report
            .units
            .iter()
            .filter(|unit| matches!(unit.outcome, RecordOutcome::Made { .. }))
            .map(|unit| (unit.partition.clone(), unit.outcome.clone()))
            .collect();
        Ok(self.store.publish(&self.pipeline.name, node, &made)?)
    }

    fn make_node(&mut self, node: &Node, stage: &StageEntry) -> Result<(), Failure> {
        let started = Instant::now();
        let units = self.state.units(node)?;
        if units.is_empty() {
            return Err(Failure::Nothing(node.name.clone()));
        }
        self.observer.node_started(node, units.len());
        let finish = |unit: &Unit| {
            let made = self.make_unit(node, stage, unit)?;
            self.observer.unit_done(node, &unit.partition, &made.record);
            Ok(made)
        };
        // What moves a robot is done one after the other, and does not go on after a failure.
        let n_workers = if node.output.parallel {
            self.pool.current_num_threads()
        } else {
            1
        };
        let results = workers::in_order(&units, n_workers, finish);
        let mut failure = None;
        let mut made = Vec::new();
        for result in results {
            match result {
                Ok(unit) => made.push(unit),
                Err(err) => failure = failure.or(Some(err)),
            }
        }
        let report = report(node, stage, &made, started);
        let failure = failure.or_else(|| too_many_skipped(node, stage, &report));
        if failure.is_none() {
            self.publish(node, &report)?;
            self.observer.node_done(&report);
        }
        self.reports.push(report);
        if let Some(failure) = failure {
            return Err(failure);
        }
        let known = made.into_iter().filter_map(MadeUnit::into_known).collect();
        self.state.insert(&node.name, known);
        Ok(())
    }

    fn make_unit(&self, node: &Node, stage: &StageEntry, unit: &Unit) -> Result<MadeUnit, Failure> {
        let fingerprint =
            self.state
                .fingerprint(node, unit)?
                .ok_or_else(|| Failure::MissingInput {
                    stage: stage.name.clone(),
                    input: "inputs".to_owned(),
                    partition: unit.partition.clone(),
                })?;
        let digest = fingerprint.digest();
        let found = |record| MadeUnit {
            partition: unit.partition.clone(),
            digest: digest.clone(),
            record,
            made_now: false,
        };
        let forced = self.options.is_forced(&stage.name);
        if !forced && let Some(record) = self.store.lookup(&digest)? {
            return Ok(found(record));
        }
        let making = self.store.begin(&digest)?;
        // Another process may have made it while this one waited for its turn.
        if !forced && let Some(record) = self.store.lookup(&digest)? {
            return Ok(found(record));
        }
        let inputs = self.inputs(node, unit)?;
        let observer = self.observer;
        let (of_node, of_partition) = (node.clone(), unit.partition.clone());
        let cx = Context {
            output: node.output.artifact.to_owned(),
            partition: unit.partition.clone(),
            seed: fingerprint.seed,
            folder: making.folder().to_owned(),
            progress: &|fraction, message| {
                observer.unit_progress(&of_node, &of_partition, fraction, message);
            },
        };
        let compute = || self.pool.install(|| stage.configured.run(&inputs, &cx));
        let ran = catch_unwind(AssertUnwindSafe(compute));
        let outcome = ran
            .map_err(|payload| Failure::Panic {
                stage: stage.name.clone(),
                partition: unit.partition.clone(),
                message: panic_message(payload.as_ref()),
            })?
            .map_err(|source| Failure::Stage {
                stage: stage.name.clone(),
                partition: Some(unit.partition.clone()),
                source,
            })?;
        let record = making.commit(Unkept {
            fingerprint,
            outcome,
        })?;
        Ok(MadeUnit {
            partition: unit.partition.clone(),
            digest,
            record,
            made_now: true,
        })
    }

    /// Opens what a unit reads; a damaged artifact is made again first.
    fn inputs(&self, node: &Node, unit: &Unit) -> Result<Inputs, Failure> {
        let mut artifacts = BTreeMap::new();
        for (input, keys) in &unit.reads {
            let mut opened = Vec::new();
            for key in keys {
                let source = node.reads.get(input);
                let known = source.and_then(|source| self.state.known(source, key));
                let files = known
                    .and_then(|known| known.outcome.as_ref()?.files(unit.parts.get(input)))
                    .ok_or_else(|| Failure::MissingInput {
                        stage: node.name.stage.clone(),
                        input: input.clone(),
                        partition: key.clone(),
                    })?;
                let paths = match self.store.open(&files)? {
                    Some(paths) => paths,
                    None => self.make_again(source, key, &files)?,
                };
                opened.push(Artifact {
                    key: key.clone(),
                    // Labels are not part of the fingerprint where only some files are read.
                    labels: known
                        .filter(|_| !unit.parts.contains_key(input))
                        .map(|known| known.labels.clone())
                        .unwrap_or_default(),
                    files: paths,
                });
            }
            artifacts.insert(input.clone(), opened);
        }
        Ok(Inputs::new(artifacts, unit.files.clone()))
    }

    /// Makes a damaged artifact again from what it was made of; equal fingerprints give equal bytes.
    fn make_again(
        &self,
        source: Option<&NodeName>,
        partition: &str,
        files: &BTreeMap<String, crate::store::FileRef>,
    ) -> Result<BTreeMap<String, std::path::PathBuf>, Failure> {
        let lost = || Failure::Damaged {
            node: source.map_or_else(String::new, ToString::to_string),
            partition: partition.to_owned(),
        };
        let node = self
            .pipeline
            .nodes
            .iter()
            .find(|node| Some(&node.name) == source)
            .ok_or_else(lost)?;
        self.observer.damaged(node, partition);
        let mut mended = self.mended.lock().unwrap_or_else(PoisonError::into_inner);
        mended.insert(node.name.clone());
        drop(mended);
        let unit = self
            .state
            .units(node)?
            .into_iter()
            .find(|unit| unit.partition == partition)
            .ok_or_else(lost)?;
        self.make_unit(node, self.pipeline.stage(node), &unit)?;
        self.store.open(files)?.ok_or_else(lost)
    }
}

struct MadeUnit {
    partition: String,
    digest: Digest,
    record: Record,
    made_now: bool,
}

impl MadeUnit {
    fn into_known(self) -> Option<(String, Known)> {
        match &self.record.outcome {
            RecordOutcome::Made { labels, .. } => Some((
                self.partition,
                Known {
                    labels: labels.clone(),
                    outcome: Some(self.record.outcome),
                },
            )),
            RecordOutcome::Skipped { .. } | RecordOutcome::Filtered { .. } => None,
        }
    }
}

/// Says what became of an output.
fn report(node: &Node, stage: &StageEntry, made: &[MadeUnit], started: Instant) -> NodeReport {
    let mut summary = Summary::default();
    for unit in made {
        match &unit.record.outcome {
            RecordOutcome::Made { metrics, .. } => {
                summary.n_made += 1;
                for (metric, value) in metrics {
                    *summary.totals.entry(metric.clone()).or_default() += value;
                }
            }
            RecordOutcome::Skipped { .. } => summary.n_skipped += 1,
            RecordOutcome::Filtered { .. } => summary.n_filtered += 1,
        }
    }
    NodeReport {
        node: node.name.clone(),
        description: stage.configured.describe(node.output.artifact, &summary),
        summary,
        n_made_now: made.iter().filter(|unit| unit.made_now).count(),
        units: made
            .iter()
            .map(|unit| UnitReport {
                partition: unit.partition.clone(),
                fingerprint: unit.digest.clone(),
                outcome: unit.record.outcome.clone(),
                made_now: unit.made_now,
            })
            .collect(),
        seconds: started.elapsed().as_secs_f64(),
    }
}

fn too_many_skipped(node: &Node, stage: &StageEntry, report: &NodeReport) -> Option<Failure> {
    let n_skipped = report.summary.n_skipped;
    let n_items = report.summary.n_made + n_skipped;
    let first = report.units.iter().find_map(|unit| match &unit.outcome {
        RecordOutcome::Skipped { reason } => Some(format!("`{}`: {reason}", unit.partition)),
        RecordOutcome::Made { .. } | RecordOutcome::Filtered { .. } => None,
    })?;
    let exceeded = n_skipped as f64 > stage.max_skipped_fraction * n_items as f64;
    exceeded.then(|| Failure::TooManySkipped {
        node: node.name.clone(),
        n_skipped,
        n_items,
        allowed: stage.max_skipped_fraction,
        first,
    })
}

fn panic_message(payload: &(dyn std::any::Any + Send)) -> String {
    let text = payload
        .downcast_ref::<&str>()
        .map(|text| (*text).to_owned());
    text.or_else(|| payload.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "no message".to_owned())
}
