//! The lines of `run`.

use dataflow::{Code, Lines, Report};
use stage_ingest::{Demonstrations, Ingest, Objects, Shapes};

/// Sums up what `ingest` made.
pub enum IngestReport {}

impl Report for IngestReport {
    type Stage = Ingest;

    const CODE: Code = dataflow::code!();

    fn lines(lines: &mut Lines<Ingest>) {
        lines.add::<Shapes>(|summary| {
            format!(
                "{} shapes in {} convex parts{}",
                summary.n_made,
                summary.metrics.convex_parts_n,
                counted(summary.n_skipped, "skipped")
            )
        });
        lines.add::<Demonstrations>(|summary| {
            format!(
                "{} recordings → {} demonstrations{}{}",
                summary.item_count(),
                summary.n_made,
                counted(summary.n_filtered, "left out"),
                counted(summary.n_skipped, "skipped"),
            )
        });
        lines.add::<Objects>(|summary| {
            let skipped = counted(summary.n_skipped, "skipped");
            format!("{} objects{skipped}", summary.n_made)
        });
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
