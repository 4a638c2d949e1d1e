//! Reports and lines of `run`, kept apart from a stage's results.

use crate::stage::{Lines, Outputs, Stage};

/// The presentation of a stage's results: tables, charts and summary lines.
///
/// It lives in a module of the stage's crate that its manifest names
/// (`package.metadata.code.reports`) and no other module may use, so that no edit of a report can
/// change a result, and the results' code does not cover it: editing a chart or a summary reruns only
/// reports.
pub trait Report: 'static {
    /// The stage whose results it shows.
    type Stage: Stage;

    /// The artifacts that it makes, after those of the stage.
    const OUTPUTS: Outputs<Self::Stage> = &[];

    /// Adds a line for each output of the stage without [`Output::LINE`](crate::Output::LINE).
    fn lines(lines: &mut Lines<Self::Stage>);
}
