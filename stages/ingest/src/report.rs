//! Sums up what the stage `ingest` made, in a line of `run` each.

use dataflow::{Lines, Report, counted};

use crate::{Demonstrations, Ingest, Objects, ShapeMetrics, Shapes};

/// Sums up what `ingest` made.
pub enum IngestReport {}

impl Report for IngestReport {
    type Stage = Ingest;

    fn lines(lines: &mut Lines<Ingest>) {
        lines.add::<Shapes>(|summary| {
            format!(
                "{} in {}{}{}",
                counted(summary.n_made, "shape"),
                counted(summary.metrics.convex_parts_n, "convex part"),
                mended(&summary.metrics),
                left_out(summary.n_skipped, "skipped")
            )
        });
        lines.add::<Demonstrations>(|summary| {
            format!(
                "{} → {}{}{}{}",
                counted(summary.item_count(), "recording"),
                counted(summary.n_made, "demonstration"),
                left_out(summary.n_filtered, "left out"),
                left_out(summary.n_skipped, "skipped"),
                match summary.metrics.assumed_rate_n {
                    Some(n) if n > 0.0 => ", 30 Hz assumed",
                    _ => "",
                },
            )
        });
        lines.add::<Objects>(|summary| {
            let skipped = left_out(summary.n_skipped, "skipped");
            counted(summary.n_made, "object") + &skipped
        });
    }
}

/// Returns `, 3 triangles turned outward`, or nothing for none.
fn mended(shapes: &ShapeMetrics) -> String {
    let repairs = shapes.repairs().to_string();
    if repairs.is_empty() {
        repairs
    } else {
        format!(", {repairs}")
    }
}

/// Returns `, 3 skipped`, or nothing for none.
fn left_out(n: usize, what: &str) -> String {
    if n == 0 {
        String::new()
    } else {
        format!(", {n} {what}")
    }
}
