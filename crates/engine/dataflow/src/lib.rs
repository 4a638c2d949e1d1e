//! Pipeline files, stages, units, fingerprints, plans and their execution.
//!
//! A pipeline file wires stages and overrides their default options, or those of the file that it
//! extends. A stage makes its outputs one partition at a time; each partition is a *unit* with a
//! [`Fingerprint`] that holds everything its bytes depend on. A unit whose fingerprint is in the
//! [`Store`] is cached; `plan` compares fingerprints field by field and so names the cause of every
//! rerun.
//!
//! A [`Stage`] is a list of [`Output`]s, each a type that declares its inputs, the options it
//! depends on, how it is made and how it is summarized. The metrics of its partitions are a type
//! too, whose fields say how they aggregate ([`metrics!`]). A stage makes results; its [`Report`],
//! in a module of its own, has outputs that show them and lines that summarize them, so that
//! presentation is not part of a result's fingerprint. Neither is what generates the files that a
//! stage reads ([`Kind::generated`]).
//!
//! A [`StageName`], an [`ArtifactName`] and a [`PartitionKey`] are parsed once, where a file, a
//! command line or a stage names them.
//!
//! Invariants: equal fingerprints give equal bytes on any number of threads; an artifact appears
//! whole or not at all; the inputs of a unit are checked against their digests before it starts.
//!
//! What this crate deliberately does not know: hands, robots, Arrow, MCAP, terminals. It defines the
//! [`Store`] that `lake` implements and the stream of [`Event`]s that the command line shows.

mod advice;
mod canonical_form;
mod code;
mod context;
mod digest;
mod elementary_functions;
mod error;
mod event;
mod executor;
mod field_names;
mod file_fault;
mod fingerprint;
mod graph;
mod inheritance;
mod input_error;
mod kind;
mod metrics;
mod name;
mod options;
mod outcome;
mod output;
mod overrides;
mod pipeline;
mod plan;
mod reachable;
mod readiness;
mod record;
mod relay;
mod report;
mod resources;
mod retry_scheduler;
mod run;
mod scope;
mod seed;
mod shared;
mod single_unit;
mod source;
mod source_file;
mod source_map;
mod stage;
mod stamp;
mod state;
mod store;
mod suggestions;
mod summary;
mod sweep;
mod tables;
mod unit;
mod unit_runner;
mod work_item;
mod workers;

pub use ::options::{OptionFault, OptionFaults, Options};
pub use advice::{BoxedDiagnostic, Diagnostic, with_causes};
pub use canonical_form::Form;
pub use code::Code;
pub use context::{Artifact, Context, Inputs, UnitInputs};
pub use digest::{Digest, InvalidDigest};
pub use error::{Failure, FileError, NamedItems, Problem, ProtocolViolation, SkippedItemsHint};
pub use event::{Event, Events, Fraction};
pub use executor::{Executor, OnOutcome, UnitOutcome, Wave};
pub use file_fault::FileFault;
pub use fingerprint::{Cause, Change, Fingerprint, OutputFingerprint};
pub use graph::Node;
pub use input_error::InputError;
pub use kind::{Kind, OptionCompletion, OptionInfo};
pub use metrics::{
    Aggregate, Max, Mean, MetricValues, Metrics, MissingMetric, ScalarAggregate, Sum, With,
};
pub use name::{
    ArtifactName, ColumnName, FileName, InvalidName, NodeName, PartitionKey, PipelineName,
    StageName, UnitName, text_of,
};
pub use options::{RunOptions, StoreUse};
pub use outcome::{Labels, Outcome};
pub use output::{Execution, OptionsUsed, OutputInfo};
pub use overrides::{Override, OverrideError};
pub use pipeline::{Pipeline, StageEntry};
pub use plan::{Plan, PlannedNode, PlannedUnit, UnitState, plan};
pub use reachable::reachable_fingerprints;
pub use readiness::{Readiness, outside};
pub use record::{FileRef, Record, RecordOutcome};
pub use relay::Relay;
pub use report::Report;
pub use resources::Resources;
pub use retry_scheduler::UnitReport;
pub use run::{NodeReport, RunReport, run};
pub use scope::{Partition, RunFacts, Scope, SkippedItem};
pub use seed::unit_seed;
pub use single_unit::{WorkItemRunner, make_one};
pub use source::{Location, Source};
pub use source_file::SourceFile;
pub use stage::{ConfigOf, Lines, Output, OutputNames, OutputOf, Outputs, Stage, Wiring};
pub use stamp::Stamp;
pub use store::{
    NewestUnit, NodeRecord, Origin, OutputRecord, PublishedUnit, RunRecord, RunStatus, StageRecord,
    Store, Turn, UnitRef, UnitTransaction,
};
pub use suggestions::{did_you_mean, missing, nearest};
pub use summary::{Line, Summary, counted};
pub use sweep::{Sweep, Variant};
pub use unit::Unit;
pub use work_item::{Recompute, WorkItem};
