//! Reports, the lines of `run`, and generated datasets: kept apart from a stage's results.

use std::marker::PhantomData;

use crate::{
    advice::Advise,
    code::Code,
    line::Lines,
    stage::{Outputs, Stage},
};

/// The presentation of a stage's results: tables, charts and summary lines.
///
/// It lives in a separate crate that links the stage's. The stage's crate cannot link it, so no
/// edit of a report can change a result, and the results' code digests do not cover it: editing a
/// chart or a summary reruns only reports.
pub trait Report: 'static {
    /// The stage whose results it shows.
    type Stage: Stage;

    /// The sources that the reports depend on, digested at build time by `dataflow::code!()`.
    const CODE: Code;
    /// One line for each output of the stage without [`Output::LINE`](crate::Output::LINE).
    const LINES: Lines<Self::Stage>;
    /// The artifacts that it makes, after those of the stage.
    const OUTPUTS: Outputs<Self::Stage> = &[];
}

/// Makes the dataset that a stage reads, if it is generated rather than recorded.
///
/// Its code is not part of any fingerprint: files outside the lake are fingerprinted by their
/// bytes.
pub trait Generator: 'static {
    /// The stage that reads the dataset.
    type Stage: Stage;
    /// Why the dataset could not be made.
    type Error: Advise;

    /// Makes the dataset that the options name if it is generated, before [`Stage::prepare`].
    ///
    /// # Errors
    ///
    /// Fails if it cannot be made.
    fn generate(config: &<Self::Stage as Stage>::Config) -> Result<(), Self::Error>;
}

/// The report of a stage without one: its outputs have their own lines.
pub(crate) struct Unreported<S>(PhantomData<S>);

impl<S: Stage> Report for Unreported<S> {
    type Stage = S;

    const CODE: Code = S::CODE;
    const LINES: Lines<S> = &[];
}

/// The generator of a stage with only recorded datasets.
pub(crate) struct Recorded<S>(PhantomData<S>);

impl<S: Stage> Generator for Recorded<S> {
    type Stage = S;
    type Error = S::Error;

    fn generate(_config: &S::Config) -> Result<(), S::Error> {
        Ok(())
    }
}
