//! What a run needs of the place where artifacts are kept; `lake` implements it.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::Arc,
};

use serde::{Deserialize, Serialize};

use crate::{
    advice::Advised,
    digest::Digest,
    fingerprint::Fingerprint,
    graph::Node,
    metrics::Figures,
    name::NodeName,
    outcome::Outcome,
    record::{FileRef, Record, RecordOutcome},
};

/// A unit that is being made: nobody else makes it, and its folder is empty.
pub trait Making {
    /// Where the unit's files go.
    fn folder(&self) -> &Path;

    /// Where the unit leaves what it goes on from if it is interrupted: kept until the unit's result
    /// is kept. Made by who writes to it.
    fn resume_folder(&self) -> &Path;

    /// Removes what an earlier attempt left to go on from.
    ///
    /// # Errors
    ///
    /// Fails if it cannot be removed.
    fn start_over(&self) -> Result<(), Advised>;

    /// Keeps the files of the folder and the result, whole or not at all.
    ///
    /// # Errors
    ///
    /// Fails if the result cannot be kept; then nothing of it can be seen.
    fn commit(self: Box<Self>, result: PendingResult) -> Result<Record, Advised>;
}

/// A result that is not kept yet.
#[derive(Debug, Clone, PartialEq)]
pub struct PendingResult {
    /// Everything that it depends on.
    pub fingerprint: Fingerprint,
    /// What the stage said.
    pub outcome: Outcome,
}

/// One unit of a run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct UnitRef {
    /// The node.
    pub node: NodeName,
    /// The partition's key.
    pub partition: String,
    /// Digest of its fingerprint.
    pub fingerprint: Digest,
    /// Whether this run made it, and not an earlier one.
    pub made_now: bool,
}

/// A made artifact to be shown to people.
#[derive(Debug, Clone, Copy)]
pub struct Showing<'a> {
    /// The partition's key.
    pub partition: &'a str,
    /// Digest of its fingerprint.
    pub fingerprint: &'a Digest,
    /// Its result.
    pub outcome: &'a RecordOutcome,
}

/// The last that is known of a unit of a pipeline.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NewestUnit {
    /// The node.
    pub node: NodeName,
    /// The partition's key.
    pub partition: String,
    /// Digest of its newest fingerprint.
    pub fingerprint: Digest,
    /// Whether the newest run that went through the node still had it.
    pub current: bool,
}

/// What a run did.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunRecord {
    /// The pipeline's name.
    pub pipeline: String,
    /// The pipeline file, the profile and the values given on the command line.
    pub origin: Origin,
    /// The pipeline's seed.
    pub seed: u64,
    /// Its stages, by name.
    pub stages: BTreeMap<String, StageRecord>,
    /// What the pipeline makes, whether the run came to it or not, in the order of the graph.
    #[serde(default)]
    pub outputs: Vec<OutputRecord>,
    /// What became of each output, in the order of the graph.
    pub nodes: Vec<NodeRecord>,
    /// Every unit, in the order of the graph.
    pub units: Vec<UnitRef>,
    /// How it ended.
    pub status: RunStatus,
    /// Seconds it took.
    pub seconds: f64,
}

/// Where a pipeline comes from: enough to say how to run it again.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Origin {
    /// The pipeline file, as the user named it.
    pub file: PathBuf,
    /// The profile chosen.
    pub profile: Option<String>,
    /// Values given beside the file, as `stage.key=value`.
    pub overrides: Vec<String>,
}

/// What a run knew of a stage.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StageRecord {
    /// Its kind.
    pub kind: String,
    /// Its configuration, as it counts for fingerprints.
    pub config: serde_json::Value,
    /// Where each input came from, by input name.
    pub inputs: BTreeMap<String, NodeName>,
}

/// An output of a pipeline.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct OutputRecord {
    /// The output.
    pub node: NodeName,
    /// What one partition of it is, e.g. `object`: the column of its key in tables.
    pub partition: String,
}

/// What became of one output in a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NodeRecord {
    /// The output.
    pub node: NodeName,
    /// The stage's own line about it.
    pub description: String,
    /// Whether the run let people see its partitions: it does not where it failed in it.
    #[serde(default)]
    pub shown: bool,
    /// Units that this run made.
    pub n_made_now: usize,
    /// Partitions there are, made now or before.
    pub n_made: usize,
    /// Items skipped as unusable.
    pub n_skipped: usize,
    /// Items left out by configuration.
    pub n_filtered: usize,
    /// The figures, gathered over the partitions.
    #[serde(rename = "totals")]
    pub metrics: Figures,
    /// Seconds it took.
    pub seconds: f64,
}

/// How a run ended.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "status", rename_all = "snake_case")]
pub enum RunStatus {
    /// It has not ended, or its process died.
    Running,
    /// Every stage came to its end.
    Finished,
    /// Something failed.
    Failed {
        /// What.
        message: String,
    },
    /// Somebody stopped it.
    Interrupted,
}

/// Where artifacts are kept.
///
/// Every method may be called from several threads at once.
pub trait Store: Sync {
    /// Gets ready to be asked about a pipeline.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be read.
    fn enter(&self, pipeline: &str) -> Result<(), Advised>;

    /// Returns the result kept under a fingerprint's digest if its artifact is whole.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be read.
    fn lookup(&self, fingerprint: &Digest) -> Result<Option<Arc<RecordOutcome>>, Advised>;

    /// Returns the result kept under a fingerprint's digest without a look at its files.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be read.
    fn recall(&self, fingerprint: &Digest) -> Result<Option<Arc<RecordOutcome>>, Advised>;

    /// Returns the whole record of a fingerprint, to say what differs from it.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be read.
    fn remembered(&self, fingerprint: &Digest) -> Result<Option<Record>, Advised>;

    /// Whether the store may hold a unit that differs from this one by nothing but what it reads of
    /// other stages.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be read.
    fn may_hold(&self, unit: &Fingerprint) -> Result<bool, Advised>;

    /// Returns the units of a pipeline's runs, each as the newest run that came to it left it.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be read.
    fn newest_units(&self, pipeline: &str) -> Result<Vec<NewestUnit>, Advised>;

    /// Returns the digest of a file outside the store.
    ///
    /// # Errors
    ///
    /// Fails if the file cannot be read.
    fn source_digest(&self, path: &Path) -> Result<Digest, std::io::Error>;

    /// Starts to make a unit. While another process makes it, `waiting` is told once who that is,
    /// and this call waits.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be written.
    fn begin(
        &self,
        fingerprint: &Digest,
        unit: &str,
        waiting: &dyn Fn(&str),
    ) -> Result<Box<dyn Making + '_>, Advised>;

    /// Returns where the files of an artifact lie after checking their bytes, or `None` if a file is
    /// missing or damaged; a damaged file is dropped, so that its unit is made again.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be read.
    fn open(
        &self,
        files: &BTreeMap<String, FileRef>,
    ) -> Result<Option<BTreeMap<String, PathBuf>>, Advised>;

    /// Lets people see the artifacts of a node: exactly these partitions.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be written.
    fn publish(&self, pipeline: &str, node: &Node, made: &[Showing]) -> Result<(), Advised>;

    /// Stops showing what stages made that the pipeline no longer has.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be written.
    fn retire(&self, pipeline: &str, kept: &[Node]) -> Result<(), Advised>;

    /// Notes that a run makes something, and returns the run's number.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be written.
    fn begin_run(&self, run: &RunRecord) -> Result<u64, Advised>;

    /// Keeps what a run has shown so far, for whoever asks before its end.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be written.
    fn keep_progress(&self, number: u64, run: &RunRecord) -> Result<(), Advised>;

    /// Keeps what a run did, with the results of its units.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be written.
    fn end_run(
        &self,
        number: u64,
        run: &RunRecord,
        units: &[(UnitRef, Arc<RecordOutcome>)],
    ) -> Result<(), Advised>;

    /// Returns the number of a finished run that found exactly what this one found, which made
    /// nothing; that run counts as the newest from now on.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be read or written.
    fn find_run(&self, run: &RunRecord) -> Result<Option<u64>, Advised>;

    /// Keeps what was learned about the pipeline: the newest state of the units of the nodes that
    /// were gone through, or nothing new about them.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be written.
    fn settle(
        &self,
        pipeline: &str,
        units: Option<&[(UnitRef, Arc<RecordOutcome>)]>,
    ) -> Result<(), Advised>;
}
