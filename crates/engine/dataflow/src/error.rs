//! Errors of a pipeline file, a plan or a run.

use std::{collections::BTreeMap, error::Error, fmt, io, path::PathBuf};

use crate::{
    advice::{BoxedDiagnostic, Diagnostic, with_causes},
    event::Event,
    metrics::MissingMetric,
    name::{ArtifactName, InvalidName, NodeName, PartitionKey, StageName, UnitName},
    scope::SkippedItem,
    source::Location,
    suggestions::{did_you_mean, missing},
};

/// Everything that is wrong with a pipeline file.
#[derive(Debug)]
pub struct FileError {
    /// The faults, in file order; at least one.
    pub problems: Vec<Problem>,
}

/// One fault of a pipeline file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Description of the fault.
    pub message: String,
    /// Where, if it has one location.
    pub location: Option<Location>,
    /// Suggested fix.
    pub hint: Option<String>,
}

impl Problem {
    pub(crate) fn new(message: impl Into<String>) -> Self {
        Self {
            message: shortened(&message.into()),
            location: None,
            hint: None,
        }
    }

    pub(crate) fn at(mut self, location: Option<Location>) -> Self {
        self.location = location;
        self
    }

    pub(crate) fn hint(mut self, hint: impl Into<Option<String>>) -> Self {
        self.hint = hint.into().map(|hint| shortened(&hint));
        self
    }
}

/// Cuts what a message quotes from the file where it is too long to be read.
fn shortened(message: &str) -> String {
    const LONGEST: usize = 300;
    const KEPT: usize = 280;
    let parts = message.split_inclusive(['`', '"']).map(|part| {
        if part.chars().count() <= LONGEST {
            return part.to_owned();
        }
        let end = part.chars().last().filter(|c| matches!(c, '`' | '"'));
        let start: String = part.chars().take(KEPT).collect();
        format!("{start}…{}", end.map_or_else(String::new, String::from))
    });
    parts.collect()
}

impl From<Problem> for FileError {
    fn from(problem: Problem) -> Self {
        Self {
            problems: vec![problem],
        }
    }
}

impl fmt::Display for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (number, problem) in self.problems.iter().enumerate() {
            if number > 0 {
                f.write_str("; ")?;
            }
            f.write_str(&problem.message)?;
        }
        Ok(())
    }
}

impl Error for FileError {}

/// Why a plan could not be made or a run could not go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Failure {
    /// A stage failed.
    #[error("stage `{stage}` failed{}", Partition(partition.as_ref()))]
    Stage {
        /// The stage's name.
        stage: StageName,
        /// The partition being made, if there was one.
        partition: Option<PartitionKey>,
        /// The upstream output that left out too many items, if that is why.
        left_out: Option<Box<SkippedItemsHint>>,
        /// The stage's own error.
        source: BoxedDiagnostic,
    },
    /// Files that options name cannot be used.
    #[error(transparent)]
    Files(FileError),
    /// A stage panicked.
    #[error("stage `{}` panicked while making `{}`: {message}", unit.node.stage, unit.partition)]
    Panic {
        /// The unit being made.
        unit: UnitName,
        /// The panic message.
        message: String,
    },
    /// A stage listed a partition that does not exist among its inputs.
    #[error("stage `{stage}` reads `{input}` partition `{partition}`, which does not exist")]
    MissingInput {
        /// The stage's name.
        stage: StageName,
        /// The input's name.
        input: ArtifactName,
        /// The partition's key.
        partition: PartitionKey,
    },
    /// Too many items had to be skipped.
    #[error(
        "stage `{}` skipped {n_skipped} of {n_items} items, more than `max_skipped_fraction` = \
         {allowed}; the first: `{}`: {}",
        skipped.node.stage,
        first.key,
        first.reason
    )]
    TooManySkipped {
        /// The stage and output.
        skipped: Box<SkippedItemsHint>,
        /// Items skipped.
        n_skipped: usize,
        /// Items in all.
        n_items: usize,
        /// The stage's limit.
        allowed: f64,
        /// The first item and its reason.
        first: Box<SkippedItem>,
    },
    /// A damaged artifact could not be rebuilt.
    #[error("`{}` partition `{}` is damaged and cannot be rebuilt identically", unit.node, unit.partition)]
    Damaged {
        /// The unit that made it.
        unit: UnitName,
    },
    /// An input of the unit is not made yet.
    #[error("`{}` partition `{}` is not made yet", unit.node, unit.partition)]
    NotMade {
        /// The unit that would make it.
        unit: UnitName,
    },
    /// A unit was made by another process, and its result is not in the store.
    #[error(
        "`{}` partition `{}` was made by another process, but its result is not in the lake",
        unit.node,
        unit.partition
    )]
    Lost {
        /// The unit.
        unit: UnitName,
    },
    /// The worker that made a unit was lost, several times.
    #[error("`{}` partition `{}` was lost {n_tries} times, at last because {why}", unit.node, unit.partition)]
    LostOften {
        /// The unit.
        unit: UnitName,
        /// Number of attempts.
        n_tries: usize,
        /// Reason of the last loss.
        why: String,
    },
    /// Several units of an output failed.
    #[error("{} of {n_units} units of `{node}` failed:{}", failures.len(), Failures(failures))]
    Several {
        /// The output.
        node: NodeName,
        /// Number of units that were to be made.
        n_units: usize,
        /// Their failures, at least two.
        failures: Vec<Self>,
    },
    /// A worker is built of other code than the run that sent it a work item.
    #[error(
        "`{}` partition `{}` is not made by this build, whose code differs in: {}",
        unit.node,
        unit.partition,
        parts.join(", ")
    )]
    OtherBuild {
        /// The unit.
        unit: UnitName,
        /// The crates whose sources differ.
        parts: Vec<String>,
    },
    /// A file outside the store is not the one that the work item names.
    #[error("`{}` for `{}` partition `{}` is missing here, or is another", path.display(), unit.node, unit.partition)]
    OtherFile {
        /// The unit.
        unit: UnitName,
        /// The file.
        path: PathBuf,
    },
    /// A worker was sent a unit that moves a robot.
    #[error("`{}` partition `{}` moves a robot, which only the run itself may", unit.node, unit.partition)]
    Physical {
        /// The unit.
        unit: UnitName,
    },
    /// The executor cannot make units.
    #[error("{message}")]
    Executor {
        /// Description of the fault.
        message: String,
        /// Suggested fix.
        hint: Option<String>,
    },
    /// A unit failed in another process.
    #[error("{message}")]
    Remote {
        /// The error that the process reported.
        message: String,
        /// The hint that it reported.
        hint: Option<String>,
        /// The upstream output that left out too many items, if that is why.
        left_out: Option<Box<SkippedItemsHint>>,
    },
    /// The process that made a unit broke the protocol.
    #[error("the process that made `{}` at `{}` broke the protocol: `{line}` {violation}", unit.node, unit.partition)]
    Protocol {
        /// The unit.
        unit: UnitName,
        /// Start of the line that it wrote.
        line: String,
        /// What is wrong with the line.
        violation: ProtocolViolation,
    },
    /// The pipeline has no output of this name.
    #[error("no output `{name}` in the pipeline")]
    NoNode {
        /// The name asked for.
        name: String,
        /// The outputs there are.
        known: Vec<String>,
    },
    /// An output has no partition of this key.
    #[error("`{}` has no partition `{}`", unit.node, unit.partition)]
    NoPartition {
        /// The unit asked for.
        unit: UnitName,
        /// The partitions there are.
        known: Vec<String>,
    },
    /// A stage gave a partition a key that cannot name a folder.
    #[error("`{}` cannot name a partition of `{node}`: {}", fault.text, fault.rule)]
    NotAKey {
        /// The output.
        node: NodeName,
        /// The key, and what is wrong with it.
        fault: InvalidName,
    },
    /// There is nothing to work on.
    #[error("stage `{}` has nothing to do: no `{}` to make", node.stage, node.artifact)]
    Nothing {
        /// The stage and output.
        node: NodeName,
        /// The nearest upstream output that left items out, if any.
        left_out: Option<Box<SkippedItemsHint>>,
    },
    /// A file outside the lake was written to while a unit read it.
    #[error("stage `{stage}` read `{}` for `{partition}` while it changed; nothing of it is kept", path.display())]
    ChangedMeanwhile {
        /// The stage's name.
        stage: StageName,
        /// The partition being made.
        partition: PartitionKey,
        /// The file.
        path: PathBuf,
    },
    /// A stored result lacks a metric that its output declares.
    #[error("a result of `{node}` in the lake cannot be summed up")]
    MetricValues {
        /// The output.
        node: NodeName,
        /// The missing metric.
        source: MissingMetric,
    },
    /// Two units of an output have the same key, or two files of a unit the same name.
    #[error("stage `{stage}` names `{name}` twice among {what}")]
    DuplicateName {
        /// The stage's name.
        stage: StageName,
        /// The key or name.
        name: String,
        /// Set of items that has the name twice.
        what: NamedItems,
    },
    /// A unit and its outcome both say which labels its artifact has, or neither does.
    #[error("stage `{}` must label `{}` exactly once", unit.node.stage, unit.partition)]
    Labels {
        /// The unit.
        unit: UnitName,
    },
    /// No stage of this name is in the file.
    #[error("no stage `{name}` in the pipeline")]
    NoStage {
        /// The name asked for.
        name: String,
        /// The stages there are.
        known: Vec<String>,
    },
    /// A file that a unit reads cannot be read.
    #[error("cannot read `{}`", path.display())]
    SourceFile {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: io::Error,
    },
    /// The lake failed.
    #[error(transparent)]
    Store(#[from] BoxedDiagnostic),
    /// The worker threads could not be started.
    #[error("cannot start the worker threads")]
    Threads(#[source] rayon::ThreadPoolBuildError),
}

/// Why a line is no event that a unit may send.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProtocolViolation {
    /// It is not an event.
    #[error("is not an event: {0}")]
    NoEvent(serde_json::Error),
    /// The unit has sent its last event already.
    #[error("follows the last event")]
    AfterTheLast,
    /// It is an event of the run, or of another unit.
    #[error("is not an event of this unit")]
    OtherUnit,
}

/// Items of a stage that have names.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum NamedItems {
    /// The partitions of an output.
    Partitions(ArtifactName),
    /// The files that a partition reads.
    Files(PartitionKey),
}

impl fmt::Display for NamedItems {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Partitions(artifact) => write!(f, "the partitions of `{artifact}`"),
            Self::Files(partition) => write!(f, "the files that `{partition}` reads"),
        }
    }
}

/// Suggests the nearest known name, or lists the first known ones.
fn offer(what: &str, name: &str, known: &[String]) -> String {
    const NAMED: usize = 12;
    did_you_mean(name, known.iter().map(String::as_str)).unwrap_or_else(|| {
        let more = if known.len() > NAMED { ", …" } else { "" };
        let named = known.get(..NAMED).unwrap_or(known).join(", ");
        format!("its {what} are: {named}{more}")
    })
}

/// Joins the hint with the advice to look at the skipped items.
fn join(hint: Option<String>, left_out: Option<&SkippedItemsHint>) -> Option<String> {
    let Some(left_out) = left_out else {
        return hint;
    };
    Some(hint.map_or_else(
        || left_out.to_string(),
        |hint| format!("{hint}; {left_out}"),
    ))
}

/// An output that left items out; displayed as the advice to inspect them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SkippedItemsHint {
    /// The output.
    pub node: NodeName,
    /// The run that left them out; `None` if none is recorded, as while planning.
    pub run: Option<u64>,
}

impl From<NodeName> for Box<SkippedItemsHint> {
    fn from(node: NodeName) -> Self {
        Self::new(SkippedItemsHint { node, run: None })
    }
}

impl fmt::Display for SkippedItemsHint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { node, run } = self;
        match run {
            Some(run) => write!(
                f,
                "see what was left out with `pipeline inspect {node} --skipped --run {run}`"
            ),
            None => write!(
                f,
                "see what is left out with `pipeline run FILE --until {}`, then `pipeline inspect \
                 {node} --skipped`",
                node.stage
            ),
        }
    }
}

impl Failure {
    /// Fails if there is any such problem.
    pub(crate) fn of_files(problems: Vec<Problem>) -> Result<(), Self> {
        if problems.is_empty() {
            Ok(())
        } else {
            Err(Self::Files(FileError { problems }))
        }
    }

    /// Attaches the failed run, so that hints show the items that this run left out, not a later
    /// one.
    pub(crate) fn of_run(mut self, number: u64) -> Self {
        if let Self::TooManySkipped {
            skipped: left_out, ..
        }
        | Self::Stage {
            left_out: Some(left_out),
            ..
        }
        | Self::Remote {
            left_out: Some(left_out),
            ..
        }
        | Self::Nothing {
            left_out: Some(left_out),
            ..
        } = &mut self
        {
            left_out.run = Some(number);
        }
        self
    }

    /// Returns the event that reports it as the failure of a unit.
    pub(crate) fn event(&self, unit: UnitName) -> Event {
        let (hint, left_out) = self.advice();
        Event::UnitFailed {
            unit,
            message: with_causes(self),
            hint,
            left_out: left_out.cloned(),
        }
    }

    /// Joins the failures of units of an output; `None` if there are none.
    pub(crate) fn of_units(
        node: &NodeName,
        n_units: usize,
        mut failures: Vec<Self>,
    ) -> Option<Self> {
        match failures.len() {
            0 | 1 => failures.pop(),
            _ => Some(Self::Several {
                node: node.clone(),
                n_units,
                failures,
            }),
        }
    }

    /// Splits the hint into the action and the output whose skipped items to inspect.
    pub fn advice(&self) -> (Option<String>, Option<&NodeName>) {
        if let Self::Stage {
            left_out: Some(left_out),
            source,
            ..
        } = self
        {
            (source.0.hint(), Some(&left_out.node))
        } else {
            (self.hint(), None)
        }
    }
}

/// Failures in a list; those that say the same stand once.
struct Failures<'a>(&'a [Failure]);

impl fmt::Display for Failures<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const SHOWN: usize = 20;
        let mut said: BTreeMap<String, usize> = BTreeMap::new();
        for failure in self.0 {
            let text = with_causes(&failure);
            let hint = failure.hint().map(|hint| format!(" ({hint})"));
            *said.entry(text + &hint.unwrap_or_default()).or_default() += 1;
        }
        for (text, n) in said.iter().take(SHOWN) {
            let often = if *n > 1 {
                format!("{n} times: ")
            } else {
                String::new()
            };
            write!(f, "\n  {often}{text}")?;
        }
        match said.len().saturating_sub(SHOWN) {
            0 => Ok(()),
            n => write!(f, "\n  and {n} others"),
        }
    }
}

struct Partition<'a>(Option<&'a PartitionKey>);

impl fmt::Display for Partition<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(partition) => write!(f, " at `{partition}`"),
            None => Ok(()),
        }
    }
}

impl Diagnostic for Failure {
    fn hint(&self) -> Option<String> {
        match self {
            Self::Stage {
                left_out, source, ..
            } => join(source.0.hint(), left_out.as_deref()),
            Self::TooManySkipped { skipped, .. } => Some(format!(
                "{skipped}, or raise `max_skipped_fraction` of stage `{}`",
                skipped.node.stage
            )),
            Self::NoStage { name, known } => Some(offer("stages", name, known)),
            Self::NoNode { name, known } => Some(offer("outputs", name, known)),
            Self::NoPartition { unit, known } => {
                Some(offer("partitions", unit.partition.as_str(), known))
            }
            Self::NotMade { unit } => Some(format!(
                "make it first with `pipeline run FILE --until {}`",
                unit.node.stage
            )),
            Self::Remote { hint, left_out, .. } => join(hint.clone(), left_out.as_deref()),
            Self::Store(err) => err.0.hint(),
            Self::Panic { .. } => Some(
                "this is a fault of the program: please report it with the command and the file"
                    .to_owned(),
            ),
            Self::Protocol { .. } => Some(
                "run the same command again without `--processes`: then this process makes the units"
                    .to_owned(),
            ),
            Self::Damaged { unit } => Some(format!(
                "make it and what follows again with `pipeline run FILE --fresh {}`",
                unit.node.stage
            )),
            Self::MetricValues { node, .. } => Some(format!(
                "make its results again with `pipeline run FILE --fresh {}`",
                node.stage
            )),
            Self::ChangedMeanwhile { .. } => {
                Some("run the same command again when nobody writes to it any more".to_owned())
            }
            Self::DuplicateName { .. } | Self::Labels { .. } | Self::NotAKey { .. } => Some(
                "this is a fault of the stage: please report it with the command and the file"
                    .to_owned(),
            ),
            Self::SourceFile { path, source } if source.kind() == io::ErrorKind::NotFound => {
                Some(missing(path))
            }
            Self::Nothing { left_out, .. } => left_out.as_ref().map(ToString::to_string),
            Self::Executor { hint, .. } => hint.clone(),
            Self::LostOften { .. } => Some(
                "what is made is kept: run the same command again, or without other machines"
                    .to_owned(),
            ),
            Self::Several { .. } => {
                Some("what is made is kept: the same command makes the others again".to_owned())
            }
            Self::OtherBuild { .. } => Some(
                "install the same build of the program on every machine that makes units".to_owned(),
            ),
            Self::OtherFile { .. } => Some(
                "keep the data where every machine reads them under the same path, or leave this \
                 stage to the run with `--until` and no `--on`"
                    .to_owned(),
            ),
            Self::Files(err) => err.problems.iter().find_map(|it| it.hint.clone()),
            Self::Physical { .. } => Some("run without `--on` or `--processes`".to_owned()),
            Self::Threads(_) => Some("use fewer with `--jobs 1`".to_owned()),
            Self::Lost { .. } | Self::MissingInput { .. } | Self::SourceFile { .. } => None,
        }
    }
}
