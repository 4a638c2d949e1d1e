//! Reports and lines of `run`, kept apart from a stage's results.

use crate::{
    code::Code,
    stage::{Lines, Outputs, Stage},
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
    /// The artifacts that it makes, after those of the stage.
    const OUTPUTS: Outputs<Self::Stage> = &[];

    /// Adds a line for each output of the stage without [`Output::LINE`](crate::Output::LINE).
    fn lines(lines: &mut Lines<Self::Stage>);
}
