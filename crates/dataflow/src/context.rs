//! What a stage sees while it makes one partition.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use crate::stage::SourceFile;

/// Reports how far a unit is: a fraction in 0..=1 and what it is doing.
pub type Progress<'a> = dyn Fn(f64, &str) + Send + Sync + 'a;

/// The surroundings of one unit.
pub struct Context<'a> {
    /// The artifact being made.
    pub(crate) output: String,
    /// The partition being made.
    pub(crate) partition: String,
    /// Seed of this unit.
    pub(crate) seed: u64,
    /// Empty folder for this unit's files.
    pub(crate) folder: PathBuf,
    /// Where progress goes.
    pub(crate) progress: &'a Progress<'a>,
}

impl Context<'_> {
    /// Returns a context for trying a stage outside a run, as tests do.
    pub fn detached(output: &str, partition: &str, seed: u64, folder: &Path) -> Self {
        Self {
            output: output.to_owned(),
            partition: partition.to_owned(),
            seed,
            folder: folder.to_owned(),
            progress: &|_, _| {},
        }
    }

    /// The artifact being made, for stages with more than one output.
    pub fn output(&self) -> &str {
        &self.output
    }

    /// The partition being made.
    pub fn partition(&self) -> &str {
        &self.partition
    }

    /// A seed that depends on the pipeline's seed, the stage's name and the partition alone.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// An empty folder: every file that lies in it at the end belongs to the artifact.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Shows how far the unit is, as a fraction in 0..=1, and what it is doing.
    pub fn progress(&self, fraction: f64, message: &str) {
        (self.progress)(fraction, message);
    }
}

/// What one unit reads: artifacts, verified against their digests, and files outside the lake.
#[derive(Debug, Clone, Default)]
pub struct Inputs {
    artifacts: BTreeMap<String, Vec<Artifact>>,
    files: Vec<SourceFile>,
    facts: BTreeMap<String, String>,
}

impl Inputs {
    /// Gathers what a unit reads.
    pub fn new(artifacts: BTreeMap<String, Vec<Artifact>>, files: Vec<SourceFile>) -> Self {
        Self {
            artifacts,
            files,
            facts: BTreeMap::new(),
        }
    }

    /// Adds what was found out while the unit was listed.
    #[must_use]
    pub fn with_facts(self, facts: BTreeMap<String, String>) -> Self {
        Self { facts, ..self }
    }

    /// Returns what was found out under this name while the unit was listed.
    pub fn fact(&self, name: &str) -> Option<&str> {
        self.facts.get(name).map(String::as_str)
    }

    /// Returns the partitions read from an input, in the order in which the unit named them.
    pub fn artifacts(&self, input: &str) -> &[Artifact] {
        self.artifacts.get(input).map_or(&[], Vec::as_slice)
    }

    /// Returns the files outside the lake, in the order in which the unit named them.
    pub fn files(&self) -> &[SourceFile] {
        &self.files
    }
}

/// One partition of an artifact in the lake.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Artifact {
    /// The partition's key.
    pub key: String,
    /// What its maker said about it.
    pub labels: BTreeMap<String, String>,
    /// Where each of its files lies, by file name.
    pub files: BTreeMap<String, PathBuf>,
}

impl Artifact {
    /// Returns where the file of this name lies, if the artifact has it.
    pub fn file(&self, name: &str) -> Option<&Path> {
        self.files.get(name).map(PathBuf::as_path)
    }
}
