//! Execution context and inputs of one unit.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use crate::{advice::BoxedDiagnostic, name::PartitionKey, source_file::SourceFile};

/// Reports a unit's progress: a fraction in 0..=1 and a message.
pub(crate) type Progress<'a> = dyn Fn(f64, &str) + Send + Sync + 'a;

/// The execution context of one unit.
pub struct Context<'a> {
    /// The partition being made.
    pub(crate) partition: PartitionKey,
    /// Seed of this unit.
    pub(crate) seed: u64,
    /// Empty folder for this unit's files.
    pub(crate) folder: PathBuf,
    /// Folder for the resume state of an interrupted unit.
    pub(crate) resume_folder: PathBuf,
    /// Folder for the records of what the stage's kind has done in the world.
    pub(crate) effects_folder: PathBuf,
    /// File for the unit's log.
    pub(crate) log_file: PathBuf,
    /// Receiver of progress reports.
    pub(crate) progress: &'a Progress<'a>,
}

impl Context<'_> {
    /// Returns a context for making an output outside a run, as tests do. Its resume folder is
    /// `resume` in `folder`, that of effects is `effects`, its log beside it: a second context of the same folder
    /// continues where the first one stopped.
    pub fn detached(partition: &PartitionKey, seed: u64, folder: &Path) -> Self {
        Self {
            partition: partition.clone(),
            seed,
            folder: folder.to_owned(),
            resume_folder: folder.join("resume"),
            effects_folder: folder.join("effects"),
            log_file: folder.with_extension("log"),
            progress: &|_, _| {},
        }
    }

    /// The partition being made.
    pub fn partition(&self) -> &PartitionKey {
        &self.partition
    }

    /// A seed that depends only on the pipeline's seed, the stage's name and the partition.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// An empty folder: every file in it at the end belongs to the artifact.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// A folder that outlives this attempt: it is kept for the next attempt at the same unit, with
    /// the same fingerprint, after a failure, an interrupt or a kill.
    ///
    /// It does not exist before the first attempt writes to it (`lake::write_atomic` makes it), is
    /// not shared, and is not part of the artifact. It is removed
    /// when the unit's result is stored or a rerun is requested (`--fresh`). The process may be
    /// killed between any two writes: write files whole (`lake::write_atomic`), and check what is
    /// read back. The result must not depend on how often the unit was interrupted.
    pub fn resume_folder(&self) -> &Path {
        &self.resume_folder
    }

    /// A folder for the records of what stages of this kind have done in the world, such as moving a robot.
    ///
    /// It is shared by all units, options, pipelines and runs, and nothing removes it: neither a rerun
    /// (`--fresh`) nor garbage collection. It does not exist before the first record is written
    /// (`lake::write_atomic` makes it).
    pub fn effects_folder(&self) -> &Path {
        &self.effects_folder
    }

    /// A file for the unit's log, which is not part of the artifact: it may differ between attempts, and is kept
    /// after a failure too. Its folder does not exist before the first log is written (`lake::write_atomic` makes
    /// it); the next attempt finds that of the last one.
    pub fn log_file(&self) -> &Path {
        &self.log_file
    }

    /// Reports the unit's progress: a fraction in 0..=1 and a message.
    pub fn progress(&self, fraction: f64, message: &str) {
        (self.progress)(fraction, message);
    }
}

/// Inputs of one unit: artifacts, verified against their digests, and files outside the lake.
#[derive(Debug, Clone, Default)]
pub struct Inputs {
    artifacts: BTreeMap<String, Vec<Artifact>>,
    files: Vec<SourceFile>,
    facts: BTreeMap<String, String>,
}

impl Inputs {
    /// Collects the inputs of a unit.
    pub fn new(artifacts: BTreeMap<String, Vec<Artifact>>, files: Vec<SourceFile>) -> Self {
        Self {
            artifacts,
            files,
            facts: BTreeMap::new(),
        }
    }

    /// Adds the facts found while the unit was listed.
    #[must_use]
    pub fn with_facts(self, facts: BTreeMap<String, String>) -> Self {
        Self { facts, ..self }
    }

    /// Returns the fact of this name, found while the unit was listed.
    pub fn fact(&self, name: &str) -> Option<&str> {
        self.facts.get(name).map(String::as_str)
    }

    /// Returns the names of the inputs of which partitions are read.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.artifacts.keys().map(String::as_str)
    }

    /// Iterates over the facts found while the unit was listed, by name.
    pub fn facts(&self) -> impl Iterator<Item = (&str, &str)> {
        let facts = self.facts.iter();
        facts.map(|(name, value)| (name.as_str(), value.as_str()))
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

/// What a unit reads, as [`Output::make`](crate::Output::make) takes it.
pub trait UnitInputs<'a>: Sized {
    /// Reads the inputs of the unit that makes a partition; the inner error is the reason for which it is skipped.
    ///
    /// # Errors
    ///
    /// Fails if an input cannot be read.
    fn read(
        inputs: &'a Inputs,
        partition: &PartitionKey,
    ) -> Result<Result<Self, String>, BoxedDiagnostic>;
}

/// Inputs that the output reads itself.
impl<'a> UnitInputs<'a> for &'a Inputs {
    fn read(
        inputs: &'a Inputs,
        _partition: &PartitionKey,
    ) -> Result<Result<Self, String>, BoxedDiagnostic> {
        Ok(Ok(inputs))
    }
}

/// One partition of an artifact in the lake.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Artifact {
    /// The partition's key.
    pub key: PartitionKey,
    /// Labels that its stage gave it.
    pub labels: BTreeMap<String, String>,
    /// Paths of its files, by file name.
    pub files: BTreeMap<String, PathBuf>,
}

impl Artifact {
    /// Returns the path of the file of this name, if the artifact has it.
    pub fn file(&self, name: &str) -> Option<&Path> {
        self.files.get(name).map(PathBuf::as_path)
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn resume_state_survives_and_queries_create_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let first = Context::detached(&"all".parse().unwrap(), 7, folder.path());
        let left = first.resume_folder().join("left");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        fs::create_dir_all(&left).unwrap();
        let second = Context::detached(&"all".parse().unwrap(), 7, folder.path());
        assert!(second.resume_folder().join("left").is_dir());
    }
}
