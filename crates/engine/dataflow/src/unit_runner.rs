//! Making one unit: its lock, its inputs, its stage, its result.

use std::{
    collections::BTreeMap,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::OnceLock,
};

use crate::{
    context::{Artifact, Context, Inputs},
    error::Failure,
    event::{Event, Events, Fraction},
    name::{PartitionKey, UnitName},
    outcome::{Labels, Outcome},
    output::Execution,
    pipeline::StageEntry,
    record::{Record, RecordOutcome},
    seed::unit_seed,
    source_file::SourceFile,
    store::Store,
    work_item::{Recompute, WorkItem},
};

impl StageEntry {
    /// Returns the seed of one of its units, of the pipeline's seed.
    pub fn unit_seed(&self, seed: u64, partition: &PartitionKey) -> u64 {
        unit_seed(seed, &self.name, partition)
    }
}

/// Outcome of a work item.
pub(crate) enum WorkItemOutcome {
    /// The result is in the store; `made_now` if it was not there before.
    Made { made_now: bool },
    /// The artifacts of these units, which it reads, are missing or damaged.
    InputsMissing(Vec<UnitName>),
}

/// Makes units in this process.
pub(crate) struct UnitRunner<'a> {
    store: &'a dyn Store,
    /// Number of units made at once; 0 for one per core.
    jobs: usize,
    /// Threads in which stages compute; units are scheduled on separate threads.
    pool: OnceLock<rayon::ThreadPool>,
}

impl<'a> UnitRunner<'a> {
    pub(crate) fn new(store: &'a dyn Store, jobs: usize) -> Self {
        Self {
            store,
            jobs,
            pool: OnceLock::new(),
        }
    }

    /// Number of units made at once.
    pub(crate) fn worker_count(&self) -> usize {
        match self.jobs {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            jobs => jobs,
        }
    }

    /// Makes the unit of a work item, an output of this stage.
    pub(crate) fn make(
        &self,
        stage: &StageEntry,
        output_idx: usize,
        item: &WorkItem,
        events: &Events,
    ) -> Result<WorkItemOutcome, Failure> {
        let name = &item.unit;
        let waiting = |holder: &str| {
            events(&Event::UnitWaiting {
                unit: name.clone(),
                holder: holder.to_owned(),
            });
        };
        let making = self.store.begin(&item.fingerprint, name, &waiting)?;
        // Another process may have made it while this one waited for the lock.
        if item.forced == Recompute::No
            && let Some(outcome) = self.store.lookup(&item.fingerprint)?
            && !outcome.is_provisional()
            && self
                .store
                .fetch_published(&[&*outcome])?
                .into_iter()
                .all(|it| it)
        {
            return Ok(WorkItemOutcome::Made { made_now: false });
        }
        if item.forced == Recompute::Yes {
            making.start_over()?;
        }
        let inputs = match self.inputs(item)? {
            Ok(inputs) => inputs,
            Err(missing) => return Ok(WorkItemOutcome::InputsMissing(missing)),
        };
        let output = stage.kind.outputs.get(output_idx);
        if output.is_some_and(|output| output.execution == Execution::Physical) {
            self.store.claim(&item.fingerprint, name)?;
        }
        let cx = Context {
            partition: name.partition.clone(),
            seed: stage.unit_seed(item.seed, &name.partition),
            folder: making.folder().to_owned(),
            resume_folder: making.resume_folder().to_owned(),
            effects_folder: making.effects_folder().join(stage.kind.name),
            log_file: making.log_file().to_owned(),
            progress: &|fraction, message| {
                events(&Event::UnitProgress {
                    unit: name.clone(),
                    fraction: Fraction::nearest(fraction),
                    message: message.to_owned(),
                });
            },
        };
        let pool = self.pool()?;
        let make = || stage.configured.make(output_idx, &inputs, &cx);
        let compute = || pool.install(clock::carry(make));
        let ran = catch_unwind(AssertUnwindSafe(compute));
        let outcome = ran
            .map_err(|payload| Failure::Panic {
                unit: name.clone(),
                message: panic_message(payload.as_ref()),
            })?
            .map_err(|source| stage.failure(Some(&name.partition), source))?;
        if let Err(err) = self.check_files(item) {
            // The resume state may derive from the changed files.
            making.start_over()?;
            return Err(err);
        }
        let unlabeled = || Failure::Labels { unit: name.clone() };
        let outcome = result(item, outcome).ok_or_else(unlabeled)?;
        making.commit(Record {
            fingerprint: item.whole_fingerprint(),
            outcome,
        })?;
        Ok(WorkItemOutcome::Made { made_now: true })
    }

    /// Checks that the files outside the lake are those of the item.
    pub(crate) fn check_files(&self, item: &WorkItem) -> Result<(), Failure> {
        let is_other = |bytes: std::io::Result<_>, expected| !bytes.is_ok_and(|it| it == expected);
        let mut files = item.files.iter();
        let other =
            files.find(|file| is_other(self.store.source_digest(&file.path, None), file.bytes));
        other.map_or(Ok(()), |file| {
            Err(Failure::ChangedMeanwhile {
                stage: item.unit.node.stage.clone(),
                partition: item.unit.partition.clone(),
                path: file.path.clone(),
            })
        })
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

    /// Opens the inputs of a unit; of damaged ones, names the units.
    fn inputs(&self, item: &WorkItem) -> Result<Result<Inputs, Vec<UnitName>>, Failure> {
        let mut artifacts = BTreeMap::new();
        let mut missing = Vec::new();
        for (input, read) in &item.inputs {
            let mut opened = Vec::with_capacity(read.len());
            for partition in read {
                match (self.store.open(&partition.files)?, item.wires.get(input)) {
                    (Some(files), _) => opened.push(Artifact {
                        key: partition.key.clone(),
                        labels: partition.labels.clone(),
                        files,
                    }),
                    (None, node) => {
                        missing.extend(node.map(|node| UnitName::new(node, &partition.key)));
                    }
                }
            }
            artifacts.insert(input.to_string(), opened);
        }
        if !missing.is_empty() {
            return Ok(Err(missing));
        }
        let files = item.files.iter();
        let files = files.map(|file| SourceFile::new(file.name.clone(), file.path.clone()));
        let inputs = Inputs::new(artifacts, files.collect());
        Ok(Ok(inputs.with_facts(item.facts.clone())))
    }
}

/// Returns the result of a unit, without its files; `None` if not exactly one of item and outcome
/// says which labels a made artifact has.
fn result(item: &WorkItem, outcome: Outcome) -> Option<RecordOutcome> {
    let provisional = matches!(outcome, Outcome::Provisional(_));
    let (metrics, labels): (_, Labels) = match (outcome, &item.labels) {
        (Outcome::Skipped { reason }, _) => return Some(RecordOutcome::Skipped { reason }),
        (Outcome::Filtered { reason }, _) => return Some(RecordOutcome::Filtered { reason }),
        (Outcome::Made(metrics) | Outcome::Provisional(metrics), Some(labels)) => {
            (metrics, labels.clone())
        }
        (Outcome::Labeled(metrics, labels), None) => (metrics, labels),
        (Outcome::Made(_) | Outcome::Provisional(_), None) | (Outcome::Labeled(..), Some(_)) => {
            return None;
        }
    };
    Some(RecordOutcome::Made {
        files: BTreeMap::new(),
        labels,
        metrics,
        provisional,
    })
}

fn panic_message(payload: &(dyn std::any::Any + Send)) -> String {
    let text = payload
        .downcast_ref::<&str>()
        .map(|text| (*text).to_owned());
    text.or_else(|| payload.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "no message".to_owned())
}
