//! What is apart from a stage's results: reports, the lines of `run`, and generated datasets.

use std::marker::PhantomData;

use crate::{
    advice::Advise,
    code::Code,
    line::Lines,
    stage::{Outputs, Stage},
};

/// What shows the results of a stage: tables and charts, and the lines that sum up what was made.
///
/// It lives in a crate of its own that links the stage's. The stage's crate cannot link it, so no
/// edit of a report can change a result, and the code part of the results does not cover it: editing
/// a chart or a summary makes reports again and nothing else.
pub trait Report: 'static {
    /// The stage whose results it shows.
    type Stage: Stage;

    /// The sources that decide the reports, made at build time by `dataflow::code!()`.
    const CODE: Code;
    /// One line for each output of the stage that does not tell itself.
    const LINES: Lines<Self::Stage>;
    /// The artifacts that it makes, after those of the stage.
    const OUTPUTS: Outputs<Self::Stage> = &[];
}

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
    fn generate(config: &<Self::Stage as Stage>::Config) -> Result<(), Self::Error>;
}

/// The report of a stage that has none: its outputs tell themselves.
pub(crate) struct Unreported<S>(PhantomData<S>);

impl<S: Stage> Report for Unreported<S> {
    type Stage = S;

    const CODE: Code = S::CODE;
    const LINES: Lines<S> = &[];
}

/// The generator of a stage whose datasets are all recorded.
pub(crate) struct Recorded<S>(PhantomData<S>);

impl<S: Stage> Generator for Recorded<S> {
    type Stage = S;
    type Error = S::Error;

    fn generate(_config: &S::Config) -> Result<(), S::Error> {
        Ok(())
    }
}
