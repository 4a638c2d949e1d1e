//! The lines of `run`.

use dataflow::{Code, Report, Summary};
use stage_ingest::{Ingest, IngestError, OBJECTS, SHAPES};

/// Sums up what `ingest` made.
pub enum IngestReport {}

impl Report for IngestReport {
    type Stage = Ingest;
    type Error = IngestError;

    const CODE: Code = dataflow::code!();

    fn describe(output: &str, summary: &Summary) -> String {
        let skipped = counted(summary.n_skipped, "skipped");
        match output {
            SHAPES => format!(
                "{} shapes in {} convex parts{skipped}",
                summary.n_made,
                summary.total("convex_parts_n")
            ),
            OBJECTS => format!("{} objects{skipped}", summary.n_made),
            _ => {
                let n_recordings = summary.n_made + summary.n_skipped + summary.n_filtered;
                format!(
                    "{n_recordings} recordings → {} demonstrations{}{skipped}",
                    summary.n_made,
                    counted(summary.n_filtered, "left out"),
                )
            }
        }
    }
}

/// Returns `, 3 skipped`, or nothing for none.
fn counted(n: usize, what: &str) -> String {
    if n == 0 {
        String::new()
    } else {
        format!(", {n} {what}")
    }
}
