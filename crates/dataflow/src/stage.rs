//! The contract of a stage: what it reads, what it makes, one partition at a time.

use std::{
    collections::BTreeMap,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

use schemars::JsonSchema;
use serde::{Serialize, de::DeserializeOwned};

use crate::{
    advice::Advise,
    code::Code,
    context::{Context, Inputs},
    option_faults::OptionFault,
    outcome::{Labels, Outcome},
    record::RecordOutcome,
    unit::{Summary, Unit},
};

/// One kind of step of a pipeline: artifacts in, artifacts out, and nothing else.
///
/// A stage is a pure function of its configuration, its inputs and [`Context::seed`]. Equal
/// arguments must give equal bytes, on any number of threads.
pub trait Stage: 'static {
    /// The stage's table in the pipeline file.
    ///
    /// Its serialized form is part of the fingerprint. A path to a file or folder whose content is
    /// among the unit's [`Unit::files`] is left out of it with `#[serde(skip_serializing)]`.
    type Config: DeserializeOwned + Serialize + JsonSchema + Send + Sync;
    /// Why a unit could not be made.
    type Error: Advise;

    /// The value of `kind` in the pipeline file.
    const KIND: &'static str;
    /// What it does, in one sentence for the list of stages.
    const ABOUT: &'static str;
    /// The sources that decide the outputs, made at build time by `dataflow::code!()`.
    const CODE: Code;
    /// The artifacts it reads: the key under `inputs` and the artifact that must be wired there.
    const INPUTS: &'static [Input];
    /// The artifacts it makes, in the order in which they are made.
    const OUTPUTS: &'static [Output];

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

    /// Lists the partitions of one output and what each of them reads.
    ///
    /// # Errors
    ///
    /// Fails if there is nothing to work on.
    fn units(config: &Self::Config, output: &str, scope: &Scope) -> Result<Vec<Unit>, Self::Error>;

    /// Foretells the labels that a unit will have if it comes out as made.
    ///
    /// A plan asks it about units that are yet to be made, so that it need not assume that what
    /// later stages choose by may change. `None` where the labels are only known afterwards.
    fn foretell(
        _config: &Self::Config,
        _output: &str,
        _unit: &Unit,
        _scope: &Scope,
    ) -> Option<Labels> {
        None
    }

    /// Says whether an option decides what [`Stage::run`] makes of a listed unit of an output: a
    /// change of one that does not makes no unit of that output run again.
    ///
    /// An option that only chooses units or files, or is told to the unit as one of its
    /// [`Unit::facts`], decides nothing more.
    fn decides(_option: &str, _output: &str) -> bool {
        true
    }

    /// Makes one partition: writes its files into [`Context::folder`].
    ///
    /// # Errors
    ///
    /// Fails if the whole stage cannot go on. One bad item is [`Outcome::Skipped`] instead.
    fn run(config: &Self::Config, inputs: &Inputs, cx: &Context) -> Result<Outcome, Self::Error>;

    /// Sums up one output in the user's terms, e.g. `24 recordings → 23 demonstrations`.
    ///
    /// Its text is part of [`Stage::CODE`]: where results are costly, [`Report::describe`] does this
    /// instead, whose text can change without making them again.
    ///
    /// [`Report::describe`]: crate::Report::describe
    fn describe(output: &str, summary: &Summary) -> String {
        format!("{} {output}", summary.n_made)
    }
}

/// An artifact that a stage reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Input {
    /// The key under `inputs` in the pipeline file.
    pub name: &'static str,
    /// The artifact, e.g. `demonstrations`.
    pub artifact: &'static str,
}

/// An artifact that a stage makes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Output {
    /// The artifact's name, e.g. `demonstrations`: also the name of its table.
    pub artifact: &'static str,
    /// Name and version of its schema, e.g. `demonstrations/1`.
    pub schema: &'static str,
    /// What one partition stands for, e.g. `sequence`: the name of the Hive partition column.
    pub partition: &'static str,
    /// Whether a unit may run beside another of the same output. Units that move a robot may not.
    pub parallel: bool,
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
