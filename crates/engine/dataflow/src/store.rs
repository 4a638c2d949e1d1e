//! The store interface that a run needs; `lake` implements it.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::Arc,
};

use serde::{Deserialize, Serialize};

use crate::{
    advice::BoxedDiagnostic,
    digest::Digest,
    fingerprint::Fingerprint,
    graph::Node,
    metrics::MetricValues,
    name::{
        self, ArtifactName, ColumnName, FileName, NodeName, PartitionKey, PipelineName, StageName,
        UnitName,
    },
    record::{FileRef, Record, RecordOutcome},
    stamp::Stamp,
};

/// A unit in progress: locked, with an empty folder.
pub trait UnitTransaction {
    /// Folder for the unit's files.
    fn folder(&self) -> &Path;

    /// Folder for the unit's resume state: kept until the unit's result is stored. Created by the
    /// first writer.
    fn resume_folder(&self) -> &Path;

    /// Folder for the records of what stages have done in the world, apart from units and runs: never
    /// collected. Created by the first writer.
    fn effects_folder(&self) -> &Path;

    /// File for the unit's log. Its folder is created by the first writer.
    fn log_file(&self) -> &Path;

    /// Removes the resume state of earlier attempts.
    ///
    /// # Errors
    ///
    /// Fails if it cannot be removed.
    fn start_over(&self) -> Result<(), BoxedDiagnostic>;

    /// Stores the files of the folder and the result, whole or not at all, and returns it with
    /// these files.
    ///
    /// # Errors
    ///
    /// Fails if the result cannot be stored; then nothing of it is visible.
    fn commit(self: Box<Self>, result: Record) -> Result<Record, BoxedDiagnostic>;
}

/// One unit of a run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct UnitRef {
    /// The node.
    pub node: NodeName,
    /// The partition's key.
    pub partition: PartitionKey,
    /// Digest of its fingerprint.
    pub fingerprint: Digest,
    /// Whether this run made it, and not an earlier one.
    pub made_now: bool,
}

/// A made artifact to publish.
#[derive(Debug, Clone, Copy)]
pub struct PublishedUnit<'a> {
    /// The partition's key.
    pub partition: &'a PartitionKey,
    /// Digest of its fingerprint.
    pub fingerprint: &'a Digest,
    /// Its result.
    pub outcome: &'a RecordOutcome,
}

/// The newest state of a unit of a pipeline.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NewestUnit {
    /// The node.
    pub node: NodeName,
    /// The partition's key.
    pub partition: PartitionKey,
    /// Digest of its newest fingerprint.
    pub fingerprint: Digest,
    /// Whether the newest run of the node still had it.
    pub current: bool,
}

/// The record of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunRecord {
    /// The pipeline's name.
    #[serde(deserialize_with = "name::text_of::<PipelineName, _>")]
    pub pipeline: String,
    /// The pipeline file, the profile and the values given on the command line.
    pub origin: Origin,
    /// The pipeline's seed.
    pub seed: u64,
    /// Its stages, by name.
    pub stages: BTreeMap<StageName, StageRecord>,
    /// The pipeline's outputs, reached by the run or not, in the order of the graph.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub outputs: Vec<OutputRecord>,
    /// The outcome of each output, in the order of the graph.
    pub nodes: Vec<NodeRecord>,
    /// Every unit, in the order of the graph.
    pub units: Vec<UnitRef>,
    /// Its status.
    pub status: RunStatus,
    /// Seconds it took.
    pub seconds: f64,
}

/// The origin of a pipeline: enough to run it again.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Origin {
    /// The pipeline file, as the user named it.
    pub file: PathBuf,
    /// The profile chosen.
    pub profile: Option<String>,
    /// Values given beside the file, as `stage.key=value`.
    pub overrides: Vec<String>,
}

/// A stage as a run recorded it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StageRecord {
    /// Its kind.
    pub kind: String,
    /// Its configuration, as fingerprints hold it.
    pub config: serde_json::Value,
    /// Source of each input, by input name.
    pub inputs: BTreeMap<ArtifactName, NodeName>,
}

/// An output of a pipeline.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct OutputRecord {
    /// The output.
    pub node: NodeName,
    /// Kind of item that one partition holds, e.g. `object`: the column of its key in tables.
    #[serde(deserialize_with = "name::text_of::<ColumnName, _>")]
    pub partition: String,
}

/// The outcome of one output in a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NodeRecord {
    /// The output.
    pub node: NodeName,
    /// The stage's own line about it.
    pub description: String,
    /// Whether the run published its partitions: not if it failed in it.
    #[serde(default, alias = "shown")]
    pub published: bool,
    /// Units that this run made.
    pub n_made_now: usize,
    /// Number of partitions, made now or before.
    pub n_made: usize,
    /// Items skipped as unusable.
    pub n_skipped: usize,
    /// Items left out by configuration.
    pub n_filtered: usize,
    /// The metrics, aggregated over the partitions.
    #[serde(rename = "totals")]
    pub metrics: MetricValues,
    /// Seconds it took.
    pub seconds: f64,
}

/// Status of a run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "status", rename_all = "snake_case")]
pub enum RunStatus {
    /// It has not ended, or its process died.
    Running,
    /// Every stage finished.
    Finished,
    /// Something failed.
    Failed {
        /// The error.
        message: String,
    },
    /// It was interrupted.
    Interrupted,
}

/// Whose turn it is to make a unit that machines want at once.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Turn {
    /// This process's.
    Own,
    /// Nobody's: its result has come.
    Made,
    /// That of another machine, named here, which makes it now.
    Others(String),
}

/// A store of artifacts.
///
/// Every method may be called from several threads at once.
pub trait Store: Sync {
    /// Loads the state of a pipeline.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be read.
    fn enter(&self, pipeline: &str) -> Result<(), BoxedDiagnostic>;

    /// Whether other machines may want the same units at the same time.
    fn takes_turns(&self) -> bool {
        false
    }

    /// Asks for the turn to make a unit.
    fn turn(&self, _fingerprint: &Digest) -> Turn {
        Turn::Own
    }

    /// Gives back the turn of a unit that was not made.
    fn end_turn(&self, _fingerprint: &Digest) {}

    /// Notes which units of an output are looked up next.
    fn look_ahead(&self, _node: &NodeName, _fingerprints: Vec<Digest>) {}

    /// Returns the result stored under a fingerprint's digest if its artifact is whole.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be read.
    fn lookup(&self, fingerprint: &Digest) -> Result<Option<Arc<RecordOutcome>>, BoxedDiagnostic>;

    /// Returns the result stored under a fingerprint's digest without checking its files.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be read.
    fn recall(&self, fingerprint: &Digest) -> Result<Option<Arc<RecordOutcome>>, BoxedDiagnostic>;

    /// Fetches those files of these results that a run publishes and that are not here. Returns whether each is
    /// complete; one that is not is made again.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be written.
    fn fetch_published(&self, outcomes: &[&RecordOutcome]) -> Result<Vec<bool>, BoxedDiagnostic>;

    /// Returns the number of bytes of a result that are not here, but would be fetched when they
    /// are needed.
    fn bytes_elsewhere(&self, outcome: &RecordOutcome) -> u64;

    /// Returns a result that another process has just stored, here or where this store shares its results.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be read.
    fn arrived(&self, fingerprint: &Digest) -> Result<Option<Arc<RecordOutcome>>, BoxedDiagnostic>;

    /// Returns the seconds that a unit took to make, if its result is stored.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be read.
    fn took_s(&self, fingerprint: &Digest) -> Result<Option<f64>, BoxedDiagnostic>;

    /// Claims a unit whose making cannot be undone, for all time, where results are shared: no store of
    /// another machine makes it then.
    ///
    /// # Errors
    ///
    /// Fails if another has claimed it, or if that cannot be known.
    fn claim(&self, fingerprint: &Digest, unit: &UnitName) -> Result<(), BoxedDiagnostic>;

    /// Shares files anew that another machine could not read where results are shared.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be used.
    fn mark_suspect(&self, files: &BTreeMap<FileName, FileRef>) -> Result<(), BoxedDiagnostic>;

    /// Returns the whole record of a fingerprint, to list differences from it.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be read.
    fn remembered(&self, fingerprint: &Digest) -> Result<Option<Record>, BoxedDiagnostic>;

    /// Whether the store may hold a unit that differs from this one only by its inputs from other
    /// stages.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be read.
    fn may_hold(&self, unit: &Fingerprint) -> Result<bool, BoxedDiagnostic>;

    /// Returns the units of a pipeline's runs, each as of the newest run that reached it.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be read.
    fn newest_units(&self, pipeline: &str) -> Result<Vec<NewestUnit>, BoxedDiagnostic>;

    /// Returns the digest of a file outside the store, with its stamp where that was just read.
    ///
    /// # Errors
    ///
    /// Fails if the file cannot be read.
    fn source_digest(&self, path: &Path, stamp: Option<Stamp>) -> Result<Digest, std::io::Error>;

    /// Starts to make a unit. If another process is making it, calls `waiting` once with the lock's
    /// holder, then waits.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be written.
    fn begin(
        &self,
        fingerprint: &Digest,
        unit: &UnitName,
        waiting: &dyn Fn(&str),
    ) -> Result<Box<dyn UnitTransaction + '_>, BoxedDiagnostic>;

    /// Returns the paths of an artifact's files after checking their bytes, or `None` if a file is
    /// missing or damaged; a damaged file is dropped, so that its unit is rebuilt.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be read.
    fn open(
        &self,
        files: &BTreeMap<FileName, FileRef>,
    ) -> Result<Option<BTreeMap<String, PathBuf>>, BoxedDiagnostic>;

    /// Publishes the artifacts of a node: exactly these partitions.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be written.
    fn publish(
        &self,
        pipeline: &str,
        node: &Node,
        made: &[PublishedUnit],
    ) -> Result<(), BoxedDiagnostic>;

    /// Unpublishes the artifacts of stages no longer in the pipeline.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be written.
    fn retire(&self, pipeline: &str, kept: &[Node]) -> Result<(), BoxedDiagnostic>;

    /// Registers a run that makes something, and returns its number.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be written.
    fn begin_run(&self, run: &RunRecord) -> Result<u64, BoxedDiagnostic>;

    /// Records the outputs that a run has published so far, for readers before its end.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be written.
    fn keep_progress(&self, number: u64, run: &RunRecord) -> Result<(), BoxedDiagnostic>;

    /// Records a finished run, with the results of its units.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be written.
    fn end_run(
        &self,
        number: u64,
        run: &RunRecord,
        units: &[(UnitRef, Arc<RecordOutcome>)],
    ) -> Result<(), BoxedDiagnostic>;

    /// Returns the number of a finished run with exactly the units of this one, which made nothing;
    /// that run counts as the newest from now on.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be read or written.
    fn find_run(&self, run: &RunRecord) -> Result<Option<u64>, BoxedDiagnostic>;

    /// Saves what was learned about the pipeline: the newest state of the units of the visited
    /// nodes, if it changed.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be written.
    fn settle(
        &self,
        pipeline: &str,
        units: Option<&[(UnitRef, Arc<RecordOutcome>)]>,
    ) -> Result<(), BoxedDiagnostic>;
}
