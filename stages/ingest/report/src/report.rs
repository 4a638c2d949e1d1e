//! The lines of `run`.

use dataflow::{Code, Lines, Report, counted};
use stage_ingest::{Demonstrations, Ingest, Objects, Shapes};

/// Sums up what `ingest` made.
pub enum IngestReport {}

impl Report for IngestReport {
    type Stage = Ingest;

    const CODE: Code = dataflow::code!();

    fn lines(lines: &mut Lines<Ingest>) {
        lines.add::<Shapes>(|summary| {
            format!(
                "{} in {}{}{}{}",
                counted(summary.n_made, "shape"),
                counted(summary.metrics.convex_parts_n, "convex part"),
                mended(summary.metrics.unused_vertices_n, "unused mesh corner"),
                mended(summary.metrics.turned_triangles_n, "inward triangle"),
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

/// Returns `, 3 inward triangles mended`, or nothing for none.
fn mended(n: Option<f64>, what: &str) -> String {
    n.map_or_else(String::new, |n| format!(", {} mended", counted(n, what)))
}

/// Returns `, 3 skipped`, or nothing for none.
fn left_out(n: usize, what: &str) -> String {
    if n == 0 {
        String::new()
    } else {
        format!(", {n} {what}")
    }
}
