//! Making one unit: its lock, its inputs, its stage, its result.

use std::{
    collections::{BTreeMap, BTreeSet},
    panic::{AssertUnwindSafe, catch_unwind},
    path::PathBuf,
    sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError},
};

use crate::{
    context::{Artifact, Context, Inputs},
    digest::Digest,
    error::Failure,
    event::{Event, Events, Fraction},
    fingerprint::Fingerprint,
    graph::Node,
    name::{NodeName, PartitionKey, UnitName},
    outcome::{Labels, Outcome},
    pipeline::{Pipeline, StageEntry},
    record::{FileRef, Record, RecordOutcome},
    remote::{Forced, Relay, RemoteWorker},
    seed::unit_seed,
    state::{Certainty, Known, Listing, State, digest_source},
    store::Store,
    unit::ListedUnit,
};

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

impl StageEntry {
    /// Returns the seed of one of its units, of the pipeline's seed.
    pub fn unit_seed(&self, seed: u64, partition: &PartitionKey) -> u64 {
        unit_seed(seed, self, partition)
    }
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

/// Makes units in this process or in others.
pub(crate) struct Maker<'a> {
    pipeline: &'a Pipeline,
    store: &'a dyn Store,
    events: &'a Events<'a>,
    /// Number of units made at once; 0 for one per core.
    jobs: usize,
    /// Threads in which stages compute; units are scheduled on separate threads.
    pool: OnceLock<rayon::ThreadPool>,
    /// Outputs of which a damaged partition was rebuilt after they were published.
    repaired: Mutex<BTreeSet<NodeName>>,
}

impl<'a> Maker<'a> {
    pub(crate) fn new(
        pipeline: &'a Pipeline,
        store: &'a dyn Store,
        jobs: usize,
        events: &'a Events<'a>,
    ) -> Self {
        Self {
            pipeline,
            store,
            events,
            jobs,
            pool: OnceLock::new(),
            repaired: Mutex::default(),
        }
    }

    /// Number of units made at once.
    pub(crate) fn worker_count(&self) -> usize {
        match self.jobs {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            jobs => jobs,
        }
    }

    /// Outputs of which a damaged partition was rebuilt.
    pub(crate) fn repaired(&self) -> MutexGuard<'_, BTreeSet<NodeName>> {
        self.repaired.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Makes a unit whose inputs are all made, and reports it.
    pub(crate) fn make(
        &self,
        known: &State,
        node: &Node,
        unit: &ListedUnit,
        forced: Forced,
    ) -> Result<UnitReport, Failure> {
        let report = self.make_here(known, node, unit, forced)?;
        (self.events)(&report.event(&node.name));
        Ok(report)
    }

    fn make_here(
        &self,
        known: &State,
        node: &Node,
        unit: &ListedUnit,
        forced: Forced,
    ) -> Result<UnitReport, Failure> {
        let stage = self.pipeline.stage(node);
        let name = UnitName::new(&node.name, &unit.partition);
        let not_made = || Failure::NotMade { unit: name.clone() };
        let fingerprint = known.fingerprint(node, unit)?;
        let (fingerprint, digest) = fingerprint.ok_or_else(not_made)?;
        let waiting = |holder: &str| {
            (self.events)(&Event::UnitWaiting {
                unit: name.clone(),
                holder: holder.to_owned(),
            });
        };
        let making = self.store.begin(&digest, &name, &waiting)?;
        // Another process may have made it while this one waited for the lock.
        if forced == Forced::No
            && let Some(outcome) = self.store.lookup(&digest)?
            && self
                .store
                .fetch_shown(&[&*outcome])?
                .into_iter()
                .all(|it| it)
        {
            return Ok(UnitReport {
                partition: unit.partition.clone(),
                fingerprint: digest,
                outcome,
                made_now: false,
            });
        }
        if forced == Forced::Yes {
            making.start_over()?;
        }
        let inputs = self.inputs(known, node, unit)?;
        let cx = Context {
            partition: unit.partition.clone(),
            seed: unit_seed(self.pipeline.seed, stage, &unit.partition),
            folder: making.folder().to_owned(),
            resume_folder: making.resume_folder().to_owned(),
            log_file: making.log_file().to_owned(),
            progress: &|fraction, message| {
                (self.events)(&Event::UnitProgress {
                    unit: name.clone(),
                    fraction: Fraction::nearest(fraction),
                    message: message.to_owned(),
                });
            },
        };
        let pool = self.pool()?;
        let compute = || pool.install(|| stage.configured.make(node.output_idx, &inputs, &cx));
        let ran = catch_unwind(AssertUnwindSafe(compute));
        let outcome = ran
            .map_err(|payload| Failure::Panic {
                unit: name.clone(),
                message: panic_message(payload.as_ref()),
            })?
            .map_err(|source| stage.failure(Some(&unit.partition), source))?;
        if let Err(err) = self.check_unchanged(unit, &fingerprint) {
            // The resume state may derive from the changed files.
            making.start_over()?;
            return Err(err);
        }
        let outcome = result(unit, outcome).ok_or(Failure::Labels { unit: name })?;
        let record = making.commit(Record {
            fingerprint,
            outcome,
        })?;
        Ok(UnitReport {
            partition: unit.partition.clone(),
            fingerprint: digest,
            outcome: Arc::new(record.outcome),
            made_now: true,
        })
    }

    /// Checks that the files have not changed since they were fingerprinted.
    fn check_unchanged(&self, unit: &ListedUnit, fingerprint: &Fingerprint) -> Result<(), Failure> {
        for file in &unit.files {
            let form = unit.forms.get(&file.name).copied();
            let now = digest_source(self.store, &file.path, form);
            let is_same = now.is_ok_and(|now| fingerprint.files.get(&file.name) == Some(&now));
            if !is_same {
                return Err(Failure::ChangedMeanwhile {
                    stage: fingerprint.stage.clone(),
                    partition: unit.partition.clone(),
                    path: file.path.clone(),
                });
            }
        }
        Ok(())
    }

    /// Has another process make a unit, looks up its result in the store and reports it.
    pub(crate) fn make_remotely(
        &self,
        state: &State,
        node: &Node,
        unit: &ListedUnit,
        forced: Forced,
        remote: &dyn RemoteWorker,
    ) -> Result<UnitReport, Failure> {
        let name = UnitName::new(&node.name, &unit.partition);
        let lost = || Failure::Lost { unit: name.clone() };
        let (_, digest) = state.fingerprint(node, unit)?.ok_or_else(lost)?;
        let upstream = self.pipeline.upstream_of(&node.name).into_iter();
        let upstream = upstream.map(|source| &source.name).collect();
        let mut relay = Relay::new(&name, upstream, self.events);
        let ended = remote.make(&name, forced, &mut relay);
        let (repaired, end) = relay.finish();
        self.repaired()
            .extend(repaired.into_iter().map(|source| source.node));
        ended?;
        let done = end.ok_or_else(lost)??;
        if done.fingerprint != digest {
            return Err(lost());
        }
        let report = UnitReport {
            partition: unit.partition.clone(),
            fingerprint: digest,
            // The record itself: this process's cache may be older.
            outcome: Arc::new(self.store.remembered(&digest)?.ok_or_else(lost)?.outcome),
            made_now: done.made_now,
        };
        (self.events)(&report.event(&node.name));
        Ok(report)
    }

    /// The threads in which stages compute, started when the first unit is made.
    fn pool(&self) -> Result<&rayon::ThreadPool, Failure> {
        if let Some(pool) = self.pool.get() {
            return Ok(pool);
        }
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(self.jobs)
            .build()
            .map_err(Failure::Threads)?;
        Ok(self.pool.get_or_init(|| pool))
    }

    /// Opens the inputs of a unit; a damaged artifact is rebuilt first.
    fn inputs(&self, state: &State, node: &Node, unit: &ListedUnit) -> Result<Inputs, Failure> {
        let mut artifacts = BTreeMap::new();
        for (input, keys) in &unit.reads {
            let parts = unit.parts.get(input.as_str());
            let mut opened = Vec::new();
            for key in keys {
                let missing = || Failure::MissingInput {
                    stage: node.name.stage.clone(),
                    input: input.clone(),
                    partition: key.clone(),
                };
                let source = node.reads.get(input).ok_or_else(missing)?;
                let Some(Known::Made(outcome)) = state.known(source, key) else {
                    return Err(missing());
                };
                let files = outcome.parts(parts).ok_or_else(missing)?;
                let paths = match self.store.open(&files)? {
                    Some(paths) => paths,
                    None => self.rebuild(state, source, key, &files)?,
                };
                // Labels are not part of the fingerprint where only some files are read.
                let labels = match parts {
                    None => outcome.labels().clone(),
                    Some(_) => Labels::new(),
                };
                opened.push(Artifact {
                    key: key.clone(),
                    labels,
                    files: paths,
                });
            }
            artifacts.insert(input.to_string(), opened);
        }
        Ok(Inputs::new(artifacts, unit.files.clone()).with_facts(unit.facts.clone()))
    }

    /// Rebuilds a damaged artifact from its inputs; equal fingerprints give equal bytes.
    fn rebuild(
        &self,
        state: &State,
        source: &NodeName,
        partition: &PartitionKey,
        files: &BTreeMap<String, FileRef>,
    ) -> Result<BTreeMap<String, PathBuf>, Failure> {
        let name = UnitName::new(source, partition);
        let lost = || Failure::Damaged { unit: name.clone() };
        let mut nodes = self.pipeline.nodes.iter();
        let node = nodes.find(|node| node.name == *source).ok_or_else(lost)?;
        (self.events)(&Event::UnitDamaged { unit: name.clone() });
        self.repaired().insert(node.name.clone());
        let units = state.units(node)?;
        let mut units = units.iter();
        let unit = units
            .find(|unit| unit.partition == *partition)
            .ok_or_else(lost)?;
        self.make(state, node, unit, Forced::No)?;
        self.store.open(files)?.ok_or_else(lost)
    }
}

/// Makes one unit of a pipeline whose inputs are all in the store, in a process that shares only
/// the store and the pipeline file with the run.
///
/// # Errors
///
/// Fails if there is no such unit, if one of its inputs is not made yet, or if its stage fails.
pub fn make_one(
    pipeline: &Pipeline,
    store: &dyn Store,
    unit: &UnitName,
    forced: Forced,
    events: &Events,
) -> Result<UnitReport, Failure> {
    let mut state = State::new(pipeline, store);
    store.enter(&pipeline.name)?;
    for node in pipeline.upstream_of(&unit.node) {
        state.recall_some(node, Certainty::Whole, |digest| store.recall(digest))?;
    }
    let mut nodes = pipeline.nodes.iter();
    let no_node = || Failure::NoNode {
        name: unit.node.to_string(),
        known: pipeline
            .nodes
            .iter()
            .map(|node| node.name.to_string())
            .collect(),
    };
    let node = nodes
        .find(|node| node.name == unit.node)
        .ok_or_else(no_node)?;
    let not_made = |unit| Failure::NotMade { unit };
    let Some(Listing { units, sure, .. }) = state.listing(node)? else {
        let nothing = || Failure::Nothing {
            node: node.name.clone(),
            left_out: None,
        };
        return Err(state.first_open(node).map_or_else(nothing, not_made));
    };
    let mut found = units.iter().zip(sure);
    let no_partition = || Failure::NoPartition {
        unit: unit.clone(),
        known: units
            .iter()
            .map(|unit| unit.partition.to_string())
            .collect(),
    };
    let (unit, sure) = found
        .find(|(listed, _)| listed.partition == unit.partition)
        .ok_or_else(no_partition)?;
    // Inputs that are not made yet may change what the unit reads.
    if sure != Certainty::Whole
        && let Some(open) = state.first_open(node)
    {
        return Err(not_made(open));
    }
    Maker::new(pipeline, store, 0, events).make(&state, node, unit, forced)
}

/// Returns the result of a unit, without its files; `None` if not exactly one of unit and outcome
/// says which labels a made artifact has.
fn result(unit: &ListedUnit, outcome: Outcome) -> Option<RecordOutcome> {
    let (metrics, labels) = match (outcome, &unit.labels) {
        (Outcome::Skipped { reason }, _) => return Some(RecordOutcome::Skipped { reason }),
        (Outcome::Filtered { reason }, _) => return Some(RecordOutcome::Filtered { reason }),
        (Outcome::Made(metrics), Some(labels)) => (metrics, labels.clone()),
        (Outcome::Labeled(metrics, labels), None) => (metrics, labels),
        (Outcome::Made(_), None) | (Outcome::Labeled(..), Some(_)) => return None,
    };
    Some(RecordOutcome::Made {
        files: BTreeMap::new(),
        labels,
        metrics,
    })
}

fn panic_message(payload: &(dyn std::any::Any + Send)) -> String {
    let text = payload
        .downcast_ref::<&str>()
        .map(|text| (*text).to_owned());
    text.or_else(|| payload.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "no message".to_owned())
}
