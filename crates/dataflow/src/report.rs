//! What is apart from a stage's results: reports, the lines of `run`, and generated datasets.

use std::marker::PhantomData;

use crate::{
    advice::Advise,
    code::Code,
    context::{Context, Inputs},
    outcome::{Labels, Outcome},
    stage::{Output, Scope, Stage},
    unit::{Summary, Unit},
};

/// The configuration of a stage.
type Config<S> = <S as Stage>::Config;

/// What shows the results of a stage: tables and charts, and the lines that sum up what was made.
///
/// It lives in a crate of its own that links the stage's. The stage's crate cannot link it, so no
/// edit of a report can change a result, and the code part of the results does not cover it: editing
/// a chart or a summary makes reports again and nothing else.
pub trait Report: Sized + 'static {
    /// The stage whose results it shows.
    type Stage: Stage;
    /// Why a report could not be made.
    type Error: Advise;

    /// The sources that decide the reports, made at build time by `dataflow::code!()`.
    const CODE: Code;
    /// The artifacts that it makes, after those of the stage.
    const OUTPUTS: &'static [Reported<Self>] = &[];

    /// Sums up one output of the stage in the user's terms, e.g. `24 recordings → 23
    /// demonstrations`.
    fn describe(output: &str, summary: &Summary) -> String;

    /// Finds one of [`Report::OUTPUTS`] by its artifact.
    fn reported(artifact: &str) -> Option<&'static Reported<Self>> {
        let mut outputs = Self::OUTPUTS.iter();
        outputs.find(|reported| reported.output.artifact == artifact)
    }
}

/// One artifact of a report, and how it is made.
///
/// The stage's options are no part of its fingerprint: it goes by what it reads.
pub struct Reported<R: Report> {
    /// The artifact.
    pub output: Output,
    /// Lists its partitions and what each of them reads, as [`Stage::units`] does.
    pub units: Units<R>,
    /// Foretells the labels of a partition, as [`Stage::foretell`] does.
    pub foretell: fn(&Unit) -> Option<Labels>,
    /// Makes one partition, as [`Stage::run`] does.
    pub run: Run<R>,
    /// Sums up all partitions in the user's terms.
    pub describe: fn(&Summary) -> String,
}

/// Lists what there is of a report.
type Units<R> =
    fn(&Config<<R as Report>::Stage>, &Scope) -> Result<Vec<Unit>, <R as Report>::Error>;
/// Makes one partition of a report.
type Run<R> =
    fn(&Config<<R as Report>::Stage>, &Inputs, &Context) -> Result<Outcome, <R as Report>::Error>;

/// Makes the dataset that a stage reads, where it is generated rather than recorded.
///
/// Its code is no part of any fingerprint: files outside the lake count by their bytes.
pub trait Generator: 'static {
    /// The stage that reads the dataset.
    type Stage: Stage;
    /// Why the dataset could not be made.
    type Error: Advise;

    /// Makes the dataset that the options name if it is a generated one, before [`Stage::prepare`].
    ///
    /// # Errors
    ///
    /// Fails if it cannot be made.
    fn generate(config: &Config<Self::Stage>) -> Result<(), Self::Error>;
}

/// The reports of a stage that has none: it sums up its results itself.
pub(crate) struct Unreported<S>(PhantomData<S>);

impl<S: Stage> Report for Unreported<S> {
    type Stage = S;
    type Error = S::Error;

    const CODE: Code = S::CODE;

    fn describe(output: &str, summary: &Summary) -> String {
        S::describe(output, summary)
    }
}

/// The generator of a stage whose datasets are all recorded.
pub(crate) struct Recorded<S>(PhantomData<S>);

impl<S: Stage> Generator for Recorded<S> {
    type Stage = S;
    type Error = S::Error;

    fn generate(_config: &Config<S>) -> Result<(), S::Error> {
        Ok(())
    }
}
