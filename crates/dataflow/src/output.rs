//! The contract of an output: one artifact that a stage or its report makes.

use std::any::TypeId;

use crate::{
    code::Code,
    context::{Context, Inputs},
    line::{Telling, telling},
    metrics::Metrics,
    outcome::{Labels, Outcome, Summary},
    stage::{Advise, Advised, Scope, Stage},
    unit::Unit,
};

/// One artifact that a stage, or its report, makes: one partition at a time.
///
/// A partition is a pure function of the configuration, what it reads and [`Context::seed`]. Equal
/// arguments must give equal bytes, on any number of threads.
pub trait Output: Sync + 'static {
    /// The stage of which it is an output.
    type Stage: Stage;
    /// Figures about a partition; `()` for none.
    type Metrics: Metrics;
    /// Why a unit could not be made.
    type Error: Advise;

    /// The artifact's name, e.g. `demonstrations`: also the name of its table.
    const ARTIFACT: &'static str;
    /// Name and version of its schema, e.g. `demonstrations/1`.
    const SCHEMA: &'static str;
    /// What one partition stands for, e.g. `sequence`: the name of the Hive partition column.
    const PARTITION: &'static str;
    /// Whether a unit may be made beside another of the same output.
    const EXECUTION: Execution = Execution::Parallel;
    /// The options that decide what [`Output::make`] makes of a listed unit: a change of another makes
    /// no unit run again.
    ///
    /// An option that only chooses units or files, or is told to the unit as one of its
    /// [`Unit::facts`], decides nothing more.
    const OPTIONS: Options = Options::All;
    /// Sums up all partitions in the user's terms, e.g. `24 recordings → 23 demonstrations`.
    ///
    /// Its text is in the code part of the output: where results are costly, a
    /// [`Line`](crate::Line) of the stage's report does this instead.
    const LINE: OwnLine<Self::Metrics> = None;

    /// Lists the partitions and what each of them reads.
    ///
    /// # Errors
    ///
    /// Fails if there is nothing to work on.
    fn units(config: &ConfigOf<Self>, scope: &Scope) -> Result<Vec<Unit>, Self::Error>;

    /// Foretells the labels that a unit will have if it comes out as made.
    ///
    /// A plan asks it about units that are yet to be made, so that it need not assume that what
    /// later stages choose by may change. `None` where the labels are only known afterwards.
    fn labels(_config: &ConfigOf<Self>, _unit: &Unit, _scope: &Scope) -> Option<Labels> {
        None
    }

    /// Makes one partition: writes its files into [`Context::folder`].
    ///
    /// # Errors
    ///
    /// Fails if the whole stage cannot go on. One bad item is [`Outcome::Skipped`] instead.
    fn make(
        config: &ConfigOf<Self>,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<Self::Metrics>, Self::Error>;
}

/// What sums up an output with these figures, if it tells itself.
pub type OwnLine<M> = Option<fn(&Summary<M>) -> String>;

/// The configuration of an output's stage.
pub type ConfigOf<O> = <<O as Output>::Stage as Stage>::Config;

/// The outputs of a stage, or of its report, in the order in which they are made.
pub type Outputs<S> = &'static [&'static dyn OutputOf<S>];

/// Whether units of an output may be made at the same time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Execution {
    /// As many at once as there are workers.
    Parallel,
    /// One after the other, and none after a failure: units that move a robot.
    OneByOne,
}

/// The options of a stage that decide an output, by their names in its table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Options {
    /// All of them.
    All,
    /// These alone.
    Only(&'static [&'static str]),
    /// All but these.
    Except(&'static [&'static str]),
}

impl Options {
    /// None of them: what an output goes by that shows others, as a report does.
    pub const NONE: Self = Self::Only(&[]);

    /// Whether an option is one of them.
    pub(crate) fn contain(self, option: &str) -> bool {
        match self {
            Self::All => true,
            Self::Only(names) => names.contains(&option),
            Self::Except(names) => !names.contains(&option),
        }
    }

    /// The options that are named.
    pub(crate) fn named(self) -> &'static [&'static str] {
        match self {
            Self::All => &[],
            Self::Only(names) | Self::Except(names) => names,
        }
    }
}

/// An output, for whoever goes through the graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OutputInfo {
    /// The artifact's name.
    pub artifact: &'static str,
    /// Name and version of its schema.
    pub schema: &'static str,
    /// What one partition stands for.
    pub partition: &'static str,
    /// Whether its units may be made at the same time.
    pub execution: Execution,
    /// The sources that decide it.
    pub code: Code,
    /// The options that decide it.
    pub options: Options,
}

/// An [`Output`] of a stage without its type; every output is one.
pub trait OutputOf<S: Stage>: Sync {
    /// Tells outputs apart.
    fn id(&self) -> TypeId;
    /// Describes it; the code is that of the list in which it stands.
    fn info(&self, code: Code) -> OutputInfo;
    /// As [`Output::LINE`].
    fn line(&self) -> Option<Telling>;
    /// As [`Output::units`].
    ///
    /// # Errors
    ///
    /// Fails as [`Output::units`] does.
    fn units(&self, config: &S::Config, scope: &Scope) -> Result<Vec<Unit>, Advised>;
    /// As [`Output::labels`].
    fn labels(&self, config: &S::Config, unit: &Unit, scope: &Scope) -> Option<Labels>;
    /// As [`Output::make`].
    ///
    /// # Errors
    ///
    /// Fails as [`Output::make`] does.
    fn make(&self, config: &S::Config, inputs: &Inputs, cx: &Context) -> Result<Outcome, Advised>;
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

    fn line(&self) -> Option<Telling> {
        O::LINE.map(telling)
    }

    fn units(&self, config: &ConfigOf<O>, scope: &Scope) -> Result<Vec<Unit>, Advised> {
        Ok(O::units(config, scope)?)
    }

    fn labels(&self, config: &ConfigOf<O>, unit: &Unit, scope: &Scope) -> Option<Labels> {
        O::labels(config, unit, scope)
    }

    fn make(
        &self,
        config: &ConfigOf<O>,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome, Advised> {
        Ok(O::make(config, inputs, cx)?.stored())
    }
}
