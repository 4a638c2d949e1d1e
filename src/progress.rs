//! A run as people watch it: a bar on a terminal, one line per output everywhere.

use std::{
    collections::BTreeMap,
    io,
    sync::{Mutex, PoisonError},
    time::Duration,
};

use dataflow::{Node, NodeReport, Observer, RecordOutcome};
use indicatif::{ProgressBar, ProgressStyle};

use crate::report;

/// Units of progress of a bar per unit of work, so that a single long unit moves it too.
const TICKS: f64 = 1000.0;

/// Prints a run's progress.
pub(crate) struct Screen {
    quiet: Quiet,
    state: Mutex<State>,
}

/// Whether only errors are printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Quiet {
    Yes,
    No,
}

#[derive(Default)]
struct State {
    /// Characters in a line, if they are limited.
    width: Option<usize>,
    n_outputs: usize,
    n_done: usize,
    bar: Option<ProgressBar>,
    /// How far the units in the making are.
    fractions: BTreeMap<String, f64>,
    n_units_done: usize,
    /// Lines of outputs that were all in the lake; printed only when something has to be made.
    held_back: Vec<String>,
}

impl Screen {
    pub(crate) fn new(quiet: Quiet) -> Self {
        Self {
            quiet,
            state: Mutex::new(State {
                width: report::width_of(&io::stderr()),
                ..State::default()
            }),
        }
    }

    fn with(&self, change: impl FnOnce(&mut State)) {
        if self.quiet == Quiet::No {
            change(&mut self.state.lock().unwrap_or_else(PoisonError::into_inner));
        }
    }
}

impl State {
    fn move_bar(&self) {
        if let Some(bar) = &self.bar {
            let making: f64 = self.fractions.values().sum();
            bar.set_position(ticks(self.n_units_done as f64 + making));
        }
    }

    fn print(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| report::line(text)),
            None => report::line(text),
        }
    }

    /// Prints a line of which the end may be left out on a terminal.
    fn print_short(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| report::short_line(text)),
            None => report::short_line(text),
        }
    }
}

/// Characters of a stage's description where nothing limits them.
const DESCRIPTION: usize = 51;

/// Characters of the time that an output took.
const TIME: usize = 8;

/// What became of an output, in one line of a width if there is one: the description is cut, not the time.
fn stage_line(head: &str, description: &str, time: &str, width: Option<usize>) -> String {
    let taken = head.chars().count() + 1 + TIME.max(time.chars().count());
    let description = match width {
        Some(width) => report::cut(description, width.saturating_sub(taken)),
        None => description.to_owned(),
    };
    let line = format!("{head}{description:<DESCRIPTION$} {time:>TIME$}");
    match width {
        // Narrower than a description usually is.
        Some(width) if line.chars().count() > width => format!("{head}{description} {time:>TIME$}"),
        _ => line,
    }
}

/// The bar's position for this many units.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a number of units is not negative, and a bar need not be exact"
)]
fn ticks(units: f64) -> u64 {
    (units * TICKS).round() as u64
}

impl Observer for Screen {
    fn planned(&self, nodes: &[&Node]) {
        self.with(|state| state.n_outputs = nodes.len());
    }

    fn node_started(&self, node: &Node, n_units: usize, _n_to_make: usize) {
        self.with(|state| {
            let bar = ProgressBar::new(ticks(n_units as f64));
            let style = ProgressStyle::with_template(
                "       {prefix:<10} [{bar:30}] {percent:>3} %  {elapsed} {wide_msg}",
            );
            if let Ok(style) = style {
                bar.set_style(style.progress_chars("=> "));
            }
            bar.set_prefix(node.name.stage.clone());
            bar.enable_steady_tick(Duration::from_millis(200));
            state.bar = Some(bar);
            state.fractions.clear();
            state.n_units_done = 0;
        });
    }

    fn unit_progress(&self, _node: &Node, partition: &str, fraction: f64, message: &str) {
        self.with(|state| {
            state
                .fractions
                .insert(partition.to_owned(), fraction.clamp(0.0, 1.0));
            state.move_bar();
            if let Some(bar) = &state.bar {
                bar.set_message(message.to_owned());
            }
        });
    }

    fn waiting(&self, node: &Node, partition: &str, holder: &str) {
        self.with(|state| {
            state.print(&format!(
                "wait   {} `{partition}`: waiting for {holder}",
                node.name
            ));
        });
    }

    fn unit_done(&self, _node: &Node, partition: &str, outcome: &RecordOutcome) {
        self.with(|state| {
            state.fractions.remove(partition);
            state.n_units_done += 1;
            state.move_bar();
            if let RecordOutcome::Skipped { reason } = outcome {
                state.print_short(&format!("skip   {partition}: {reason}"));
            }
        });
    }

    fn damaged(&self, node: &Node, partition: &str) {
        self.with(|state| {
            state.print(&format!(
                "mend   {} `{partition}` is damaged in the lake and is made again",
                node.name
            ));
        });
    }

    fn node_done(&self, report: &NodeReport) {
        self.with(|state| {
            if let Some(bar) = state.bar.take() {
                bar.finish_and_clear();
            }
            state.n_done += 1;
            let time = if report.n_made_now == 0 {
                "cached".to_owned()
            } else {
                report::duration(report.seconds)
            };
            let width = state.n_outputs.to_string().len();
            let line = format!(
                "  {:>width$}/{}  {:<9} ",
                state.n_done, state.n_outputs, report.node.stage
            );
            let line = stage_line(&line, &report.description, &time, state.width);
            if report.n_made_now == 0 {
                state.held_back.push(line);
            } else {
                for line in state.held_back.drain(..) {
                    report::line(&line);
                }
                report::line(&line);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_line_fits_its_width_and_keeps_its_time() {
        let head = "  12/16  retarget  ";
        let long = "72 demonstrations and more of them than fit in one line of a narrow terminal";
        for width in 40..120 {
            for (description, time) in [("short", "0.1 s"), (long, "cached"), (long, "59 min 59 s")]
            {
                let line = stage_line(head, description, time, Some(width));
                assert!(line.chars().count() <= width, "{width}: {line}");
                assert!(line.ends_with(time), "{line}");
            }
        }
        let free = stage_line(head, long, "0.1 s", None);
        assert!(free.contains(long), "{free}");
    }
}
