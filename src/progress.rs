//! A run as people watch it: a bar on a terminal, one line per output everywhere.

use std::{
    collections::BTreeMap,
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
            state: Mutex::default(),
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
                state.print(&format!("skip   {partition}: {reason}"));
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
                "  {:>width$}/{}  {:<9} {:<58} {time:>9}",
                state.n_done, state.n_outputs, report.node.stage, report.description
            );
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
