//! The contract of a stage: its configuration, what it reads, and what it makes.

use std::{
    collections::BTreeMap,
    error::Error,
    fmt,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

use schemars::JsonSchema;
use serde::{Serialize, de::DeserializeOwned};

use crate::{
    code::Code, option_faults::OptionFault, outcome::Labels, output::Outputs, store::RecordOutcome,
};

/// An error that can say what to do next.
pub trait Advise: Error + Send + Sync + 'static {
    /// The next action: an edit or a command that can be pasted.
    fn hint(&self) -> Option<String>;

    /// The stage's input of which too little is there, if that is what is wrong: the hint then goes
    /// on with the command that lists what was left out of it.
    fn lacks(&self) -> Option<&'static str> {
        None
    }
}

/// An error of any kind that can say what to do next.
#[derive(Debug)]
pub struct Advised(pub Box<dyn Advise>);

impl<E: Advise> From<E> for Advised {
    fn from(err: E) -> Self {
        Self(Box::new(err))
    }
}

impl fmt::Display for Advised {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl Error for Advised {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        self.0.source()
    }
}

/// One kind of step of a pipeline: artifacts in, artifacts out, and nothing else.
///
/// It is a list of [`Output`](crate::Output)s, with what they have in common.
pub trait Stage: Sized + 'static {
    /// The stage's table in the pipeline file.
    ///
    /// Its serialized form is part of the fingerprint. A path to a file or folder whose content is
    /// among the unit's [`Unit::files`](crate::Unit::files) is left out of it with
    /// `#[serde(skip_serializing)]`.
    type Config: DeserializeOwned + Serialize + JsonSchema + Send + Sync;
    /// Why the stage could not be made ready.
    type Error: Advise;

    /// The value of `kind` in the pipeline file.
    const KIND: &'static str;
    /// What it does, in one sentence for the list of stages.
    const ABOUT: &'static str;
    /// The sources that decide the outputs, made at build time by `dataflow::code!()`.
    const CODE: Code;
    /// The artifacts it reads: keys under `inputs`, at each of which an artifact of this name must be
    /// wired.
    const INPUTS: &'static [&'static str];
    /// The artifacts it makes, in the order in which they are made: each may read those before it.
    const OUTPUTS: Outputs<Self>;

    /// Says what is wrong with the options beyond their types, by the options alone: it is asked
    /// whenever a pipeline file is read.
    ///
    /// An option that decides how much memory or time something takes has bounds here, each with
    /// the reason why it is where it is.
    fn check(_config: &Self::Config) -> Vec<OptionFault> {
        Vec::new()
    }

    /// Makes ready what lies outside the lake, before anything is planned.
    ///
    /// # Errors
    ///
    /// Fails if the outside cannot be used at all.
    fn prepare(_config: &Self::Config) -> Result<(), Self::Error> {
        Ok(())
    }
}

/// What a stage may look at to list its units: the partitions that its inputs have.
#[derive(Debug, Clone, Default)]
pub struct Scope {
    partitions: BTreeMap<String, Vec<Partition>>,
}

impl Scope {
    /// Returns the scope that holds these partitions by input name or own output's artifact.
    pub fn new(partitions: BTreeMap<String, Vec<Partition>>) -> Self {
        Self { partitions }
    }

    /// Returns the partitions of an input, or of an output of this stage that is made earlier,
    /// ordered by key.
    pub fn partitions(&self, name: &str) -> &[Partition] {
        self.partitions.get(name).map_or(&[], Vec::as_slice)
    }
}

/// One partition of an artifact, as far as planning needs it.
#[derive(Debug, Clone)]
pub struct Partition {
    /// The partition's key, e.g. the sequence's name.
    pub key: String,
    labels: LabelsOf,
    /// Set as soon as somebody asks for a label that may still change.
    asked: Option<Arc<AtomicBool>>,
}

/// Where a partition's labels are.
#[derive(Debug, Clone)]
enum LabelsOf {
    Own(Labels),
    /// In the result that has them, of which there may be many.
    Made(Arc<RecordOutcome>),
}

impl Partition {
    /// Returns the partition of this key, about which its maker said this.
    pub fn new(key: impl Into<String>, labels: Labels) -> Self {
        Self {
            key: key.into(),
            labels: LabelsOf::Own(labels),
            asked: None,
        }
    }

    /// Returns a partition that is made.
    pub(crate) fn made(key: &str, outcome: &Arc<RecordOutcome>) -> Self {
        Self {
            key: key.to_owned(),
            labels: LabelsOf::Made(Arc::clone(outcome)),
            asked: None,
        }
    }

    /// Returns a partition whose labels may come out differently; `asked` is set if one is read.
    pub(crate) fn uncertain(key: &str, labels: Labels, asked: &Arc<AtomicBool>) -> Self {
        Self {
            key: key.to_owned(),
            labels: LabelsOf::Own(labels),
            asked: Some(Arc::clone(asked)),
        }
    }

    /// Returns a label, e.g. `object`.
    pub fn label(&self, name: &str) -> Option<&str> {
        if let Some(asked) = &self.asked {
            asked.store(true, Ordering::Relaxed);
        }
        let labels = match &self.labels {
            LabelsOf::Own(labels) => labels,
            LabelsOf::Made(outcome) => match outcome.as_ref() {
                RecordOutcome::Made { labels, .. } => labels,
                RecordOutcome::Skipped { .. } | RecordOutcome::Filtered { .. } => return None,
            },
        };
        labels.get(name).map(String::as_str)
    }
}

/// A file outside the lake that a unit reads.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct SourceFile {
    /// Its name in the fingerprint: relative to the dataset, never a path of this machine.
    pub name: String,
    /// Where it lies.
    pub path: PathBuf,
}

impl SourceFile {
    /// Names `path` by its last component.
    pub fn named_by_file(path: &Path) -> Self {
        Self {
            name: path.file_name().map_or_else(
                || path.display().to_string(),
                |name| name.to_string_lossy().into_owned(),
            ),
            path: path.to_owned(),
        }
    }

    /// Names `path` by what it is to the stage, e.g. by the option that says where it lies: then its
    /// own name makes no difference.
    pub fn named(name: &str, path: &Path) -> Self {
        Self {
            name: name.to_owned(),
            path: path.to_owned(),
        }
    }
}
