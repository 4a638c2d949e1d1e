//! What a run needs of the place where artifacts are kept; `lake` implements it.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use serde::{Deserialize, Serialize};

use crate::{
    digest::Digest,
    fingerprint::Fingerprint,
    graph::{Node, NodeName},
    stage::Advised,
};

/// One file of an artifact: its bytes are found by their digest.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileRef {
    /// Digest of the bytes.
    pub digest: Digest,
    /// Number of bytes.
    pub size: u64,
}

/// What became of a unit, kept under its fingerprint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Everything that the result depends on.
    pub fingerprint: Fingerprint,
    /// The result.
    pub outcome: RecordOutcome,
}

/// The result of a unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "result", rename_all = "snake_case")]
pub enum RecordOutcome {
    /// Files that are the artifact.
    Made {
        /// The files by name.
        files: BTreeMap<String, FileRef>,
        /// Facts by which later stages choose partitions.
        labels: BTreeMap<String, String>,
        /// Counts and figures.
        metrics: BTreeMap<String, f64>,
    },
    /// The item could not be used.
    Skipped {
        /// Why.
        reason: String,
    },
    /// The configuration leaves the item out.
    Filtered {
        /// Why.
        reason: String,
    },
}

impl RecordOutcome {
    /// Returns the digest of a made artifact: of its files' names and bytes and its labels.
    pub fn artifact_digest(&self) -> Option<Digest> {
        match self {
            Self::Made { files, labels, .. } => {
                let content: BTreeMap<_, _> = files
                    .iter()
                    .map(|(name, file)| (name, &file.digest))
                    .collect();
                Some(Digest::of_json(&serde_json::json!([content, labels])))
            }
            Self::Skipped { .. } | Self::Filtered { .. } => None,
        }
    }

    /// Returns the files of a made artifact, only the named ones if `parts` names any.
    pub(crate) fn files(&self, parts: Option<&Vec<String>>) -> Option<BTreeMap<String, FileRef>> {
        match self {
            Self::Made { files, .. } => Some(
                files
                    .iter()
                    .filter(|(name, _)| parts.is_none_or(|parts| parts.contains(name)))
                    .map(|(name, file)| (name.clone(), file.clone()))
                    .collect(),
            ),
            Self::Skipped { .. } | Self::Filtered { .. } => None,
        }
    }
}

/// A unit that is being made: nobody else makes it, and its folder is empty.
pub trait Making {
    /// Where the unit's files go.
    fn folder(&self) -> &Path;

    /// Keeps the files of the folder and the result, whole or not at all.
    ///
    /// # Errors
    ///
    /// Fails if the result cannot be kept; then nothing of it can be seen.
    fn commit(self: Box<Self>, result: Unkept) -> Result<Record, Advised>;
}

/// A result that is not kept yet.
#[derive(Debug, Clone, PartialEq)]
pub struct Unkept {
    /// Everything that it depends on.
    pub fingerprint: Fingerprint,
    /// What the stage said.
    pub outcome: crate::stage::Outcome,
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

/// What a run did.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunRecord {
    /// The pipeline's name.
    pub pipeline: String,
    /// Its seed.
    pub seed: u64,
    /// Configuration of each stage.
    pub stages: BTreeMap<String, serde_json::Value>,
    /// Every unit, in the order of the graph.
    pub units: Vec<UnitRef>,
    /// Whether every stage came to its end.
    pub finished: bool,
    /// Seconds it took.
    pub seconds: f64,
}

/// Where artifacts are kept.
///
/// Every method may be called from several threads at once.
pub trait Store: Sync {
    /// Returns the record of a fingerprint if its artifact is whole.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be read.
    fn lookup(&self, fingerprint: &Digest) -> Result<Option<Record>, Advised>;

    /// Returns the record of a fingerprint whether or not its files are still there.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be read.
    fn remembered(&self, fingerprint: &Digest) -> Result<Option<Record>, Advised>;

    /// Returns the units of a pipeline's runs, each as the newest run that came to it left it.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be read.
    fn newest_units(&self, pipeline: &str) -> Result<Vec<UnitRef>, Advised>;

    /// Returns the digest of a file outside the store.
    ///
    /// # Errors
    ///
    /// Fails if the file cannot be read.
    fn source_digest(&self, path: &Path) -> Result<Digest, std::io::Error>;

    /// Starts to make a unit, waiting while another process makes it.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be written.
    fn begin(&self, fingerprint: &Digest) -> Result<Box<dyn Making + '_>, Advised>;

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
    fn publish(
        &self,
        pipeline: &str,
        node: &Node,
        made: &[(String, RecordOutcome)],
    ) -> Result<(), Advised>;

    /// Stops showing what stages made that the pipeline no longer has.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be written.
    fn retire(&self, pipeline: &str, kept: &[Node]) -> Result<(), Advised>;

    /// Keeps what a run did and returns the run's name.
    ///
    /// # Errors
    ///
    /// Fails if the store cannot be written.
    fn record_run(&self, run: &RunRecord) -> Result<String, Advised>;
}
