//! The contract of a stage and of its outputs.

use std::{
    any::TypeId,
    collections::{BTreeMap, HashMap},
    marker::PhantomData,
};

use options::{OptionFault, Options};
use schemars::JsonSchema;
use serde::{Serialize, de::DeserializeOwned};

use crate::{
    advice::BoxedDiagnostic,
    code::Code,
    context::{Context, Inputs, UnitInputs},
    file_fault::FileFault,
    metrics::{Metrics, MissingMetric},
    name::NodeName,
    outcome::Outcome,
    output::{Execution, OptionsUsed, OutputInfo},
    record::RecordOutcome,
    scope::Scope,
    summary::{Line, Summary},
    unit::Unit,
};

/// One kind of step of a pipeline: artifacts in, artifacts out, and nothing else.
///
/// It is a list of [`Output`]s and their shared configuration.
pub trait Stage: Sized + 'static {
    /// The stage's table in the pipeline file.
    ///
    /// Its serialized form is part of the fingerprint. A path to a file or folder whose content is
    /// among the unit's [`Unit::files`] is left out of it with
    /// `#[option(path)]`.
    type Config: Options + DeserializeOwned + Serialize + JsonSchema + Send + Sync;

    /// The value of `kind` in the pipeline file.
    const KIND: &'static str;
    /// Description in one sentence, for the list of stages.
    const ABOUT: &'static str;
    /// The artifacts it reads: keys under `inputs`, at each of which an artifact of this name must be
    /// wired.
    const INPUTS: &'static [&'static str];
    /// Further artifacts that it reads where they are wired. One that is wired to a stage that the pipeline
    /// file leaves out (`without`) counts as not wired.
    const OPTIONAL_INPUTS: &'static [&'static str] = &[];
    /// The options that name files or folders outside the lake and are checked by [`Stage::check_files`].
    const FILES: &'static [&'static str] = &[];
    /// Whether its inputs are those of [`Stage::INPUTS`], or those that the pipeline file names.
    const WIRING: Wiring = Wiring::Declared;
    /// Text at the end of its page of options, e.g. a whole example.
    const EXAMPLE: Option<&'static str> = None;
    /// The artifacts it makes, in the order in which they are made: each may read those before it.
    const OUTPUTS: Outputs<Self>;

    /// Returns the faults of the options beyond their types, from the options alone; called
    /// whenever a pipeline file is read.
    ///
    /// An option that determines memory or time has a range, with its reason.
    fn check(config: &Self::Config) -> Vec<OptionFault> {
        config.faults()
    }

    /// As [`Stage::check`], of options that name inputs, with the inputs and the source of each;
    /// for [`Wiring::Free`].
    fn check_wired(
        _config: &Self::Config,
        _inputs: &BTreeMap<String, NodeName>,
    ) -> Vec<OptionFault> {
        Vec::new()
    }

    /// Returns every file that an option of [`Stage::FILES`] names and that cannot be used; called after all
    /// stages are prepared, before anything is planned.
    fn check_files(_config: &Self::Config) -> Vec<FileFault> {
        Vec::new()
    }

    /// Prepares resources outside the lake, before anything is planned.
    ///
    /// # Errors
    ///
    /// Fails if those resources cannot be used at all.
    fn prepare(_config: &Self::Config) -> Result<(), BoxedDiagnostic> {
        Ok(())
    }
}

/// Declaration of a stage's inputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wiring {
    /// Those that its kind declares, each with an artifact of the input's name.
    Declared,
    /// Those that the pipeline file names, each with any artifact.
    Free,
}

/// The names of an output: its artifact, its schema, and the kind of item that one partition holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OutputNames {
    /// As [`Output::ARTIFACT`].
    pub artifact: &'static str,
    /// As [`Output::SCHEMA`].
    pub schema: &'static str,
    /// As [`Output::PARTITION`].
    pub partition: &'static str,
}

/// One artifact that a stage, or its report, makes: one partition at a time.
///
/// A partition is a pure function of the configuration, its inputs and [`Context::seed`]. Equal
/// arguments must give equal bytes, on any number of threads.
pub trait Output: Sync + 'static {
    /// The stage of which it is an output.
    type Stage: Stage;
    /// Metrics of a partition; `()` for none.
    type Metrics: Metrics;
    /// What a unit reads: a type that declares it, or `&'a Inputs` for an output that reads its inputs itself.
    type Inputs<'a>: UnitInputs<'a>;

    /// The artifact's name, e.g. `demonstrations`: also the name of its table.
    const ARTIFACT: &'static str;
    /// Name and version of its schema, e.g. `demonstrations/1`.
    const SCHEMA: &'static str;
    /// Kind of item in one partition, e.g. `sequence`: the name of the Hive partition column.
    const PARTITION: &'static str;
    /// Whether units of this output may run concurrently.
    const EXECUTION: Execution = Execution::Parallel;
    /// The options that [`Output::make`] depends on: a change of any other reruns no unit.
    ///
    /// Options that only select units or files, or reach the unit as one of its [`Unit::facts`],
    /// are not among them.
    const OPTIONS: OptionsUsed = OptionsUsed::All;
    /// Its line, if it has its own.
    ///
    /// The line's source counts in the output's code digest: for costly results, the stage's
    /// [`Report`](crate::Report) has the line instead.
    const LINE: Option<Line<Self::Metrics>> = None;

    /// Returns whether its units may run concurrently, which the options of some kinds decide.
    fn execution(_config: &ConfigOf<Self>) -> Execution {
        Self::EXECUTION
    }

    /// Returns its names, which the options of some kinds decide.
    fn names(_config: &ConfigOf<Self>) -> OutputNames {
        OutputNames {
            artifact: Self::ARTIFACT,
            schema: Self::SCHEMA,
            partition: Self::PARTITION,
        }
    }

    /// Lists the partitions and the inputs of each.
    ///
    /// # Errors
    ///
    /// Fails if there is nothing to work on.
    fn units(config: &ConfigOf<Self>, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic>;

    /// Makes one partition: writes its files into [`Context::folder`].
    ///
    /// # Errors
    ///
    /// Fails if the whole stage cannot continue. One bad item is [`Outcome::Skipped`] instead.
    fn make(
        config: &ConfigOf<Self>,
        inputs: Self::Inputs<'_>,
        cx: &Context,
    ) -> Result<Outcome<Self::Metrics>, BoxedDiagnostic>;

    /// Reads the inputs of a partition and makes it, as a run does.
    ///
    /// # Errors
    ///
    /// Fails if an input cannot be read, and as [`Output::make`] does.
    fn read_and_make(
        config: &ConfigOf<Self>,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<Self::Metrics>, BoxedDiagnostic> {
        match Self::Inputs::read(inputs, cx.partition())? {
            Ok(inputs) => Self::make(config, inputs, cx),
            Err(reason) => Ok(Outcome::skipped(reason)),
        }
    }
}

/// The configuration of an output's stage.
pub type ConfigOf<O> = <<O as Output>::Stage as Stage>::Config;

/// The outputs of a stage, or of its report, in the order in which they are made.
pub type Outputs<S> = &'static [&'static dyn OutputOf<S>];

/// The lines of the outputs of a stage and of its report, one each.
pub struct Lines<S> {
    lines: HashMap<TypeId, ErasedLine>,
    stage: PhantomData<S>,
}

/// Summarizes the stored results of an output, in the order of their partitions, with its line.
pub(crate) type ErasedLine =
    Box<dyn Fn(&[&RecordOutcome]) -> Result<(Summary, String), MissingMetric> + Send + Sync>;

impl<S: Stage> Lines<S> {
    pub(crate) fn new() -> Self {
        Self {
            lines: HashMap::new(),
            stage: PhantomData,
        }
    }

    /// Adds the line of an output.
    ///
    /// # Panics
    ///
    /// Panics if the output has one already.
    pub fn add<O: Output<Stage = S>>(&mut self, line: Line<O::Metrics>) {
        let erased: ErasedLine = Box::new(move |outcomes| {
            let summary = Summary::of(outcomes)?;
            Ok((summary.stored(), line(&summary)))
        });
        let other = self.lines.insert(TypeId::of::<O>(), erased);
        assert!(
            other.is_none(),
            "the output `{}` has two lines",
            O::ARTIFACT
        );
    }

    /// Takes the line of an output.
    pub(crate) fn take(&mut self, output: &dyn OutputOf<S>) -> Option<ErasedLine> {
        self.lines.remove(&output.id())
    }
}

/// An [`Output`] of a stage without its type; every output is one.
pub trait OutputOf<S: Stage>: Sync {
    /// Identifies the output.
    fn id(&self) -> TypeId;
    /// Returns its metadata; the code is that of its stage or report.
    fn info(&self, code: Code) -> OutputInfo;
    /// As [`Output::execution`].
    fn execution(&self, config: &S::Config) -> Execution;
    /// As [`Output::names`].
    fn names(&self, config: &S::Config) -> OutputNames;
    /// Adds [`Output::LINE`].
    fn add_line(&self, lines: &mut Lines<S>);
    /// As [`Output::units`].
    ///
    /// # Errors
    ///
    /// Fails as [`Output::units`] does.
    fn units(&self, config: &S::Config, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic>;
    /// As [`Output::make`].
    ///
    /// # Errors
    ///
    /// Fails as [`Output::make`] does.
    fn make(
        &self,
        config: &S::Config,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome, BoxedDiagnostic>;
}

impl<O: Output> OutputOf<O::Stage> for O {
    fn id(&self) -> TypeId {
        TypeId::of::<O>()
    }

    fn info(&self, code: Code) -> OutputInfo {
        OutputInfo {
            artifact: O::ARTIFACT,
            schema: O::SCHEMA,
            partition: O::PARTITION,
            execution: O::EXECUTION,
            code,
            options: O::OPTIONS,
        }
    }

    fn execution(&self, config: &ConfigOf<O>) -> Execution {
        O::execution(config)
    }

    fn names(&self, config: &ConfigOf<O>) -> OutputNames {
        O::names(config)
    }

    fn add_line(&self, lines: &mut Lines<O::Stage>) {
        if let Some(line) = O::LINE {
            lines.add::<O>(line);
        }
    }

    fn units(&self, config: &ConfigOf<O>, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        O::units(config, scope)
    }

    fn make(
        &self,
        config: &ConfigOf<O>,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome, BoxedDiagnostic> {
        Ok(O::read_and_make(config, inputs, cx)?.stored())
    }
}
