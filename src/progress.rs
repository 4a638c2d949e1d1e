//! Display of a run's events: a bar on a terminal, one line per output everywhere.

use std::{
    collections::BTreeMap,
    io,
    sync::{Mutex, PoisonError},
    time::{Duration, Instant},
};

use dataflow::{Event, NodeName, StageName, UnitName};
use indicatif::{ProgressBar, ProgressStyle};

use crate::{label::Label, report};

/// Ticks of the bar per unit, so that a single long unit moves it too.
const TICKS: f64 = 1000.0;

/// Prints the events of a run, or of a single unit.
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
    /// The output whose units are being made.
    output: Option<NodeName>,
    /// The last notice of where its units wait.
    queued: Option<QueueNotice>,
    /// When its units were begun, their number, and how many were made since.
    started: Option<Instant>,
    n_units: usize,
    n_made_now: usize,
    /// Progress of its units in flight.
    fractions: BTreeMap<UnitName, f64>,
    n_units_done: usize,
    /// Lines of cached outputs; printed only if something is made.
    held_back: Vec<String>,
}

/// Time after which it is said again where units are and how long the others take, without a terminal: it doubles from
/// line to line, up to the longest.
const QUEUE_PERIOD: Duration = Duration::from_secs(5);
const LONGEST_QUEUE_PERIOD: Duration = Duration::from_mins(5);

/// A line about units that wait.
struct QueueNotice {
    output: NodeName,
    reasons: String,
    at: Instant,
    /// Time for which nothing is said of the same again.
    pause: Duration,
}

impl QueueNotice {
    /// Whether nothing has changed that is worth another line.
    fn is_recent(&self, output: &NodeName, reasons: &str) -> bool {
        let is_same = self.output == *output && (self.reasons == reasons || reasons.is_empty());
        is_same && clock::since(self.at) < self.pause
    }
}

/// Whether a reason says only that other jobs come first.
fn is_idle(reason: &str) -> bool {
    ["", "None", "Priority", "Resources", "BeginTime"].contains(&reason)
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

    /// Prints an event.
    pub(crate) fn show(&self, event: &Event) {
        if self.quiet == Quiet::No {
            let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
            state.show(event);
        }
    }
}

impl State {
    fn show(&mut self, event: &Event) {
        match event {
            Event::RunStarted { n_outputs } => self.n_outputs = *n_outputs,
            Event::OutputStarted { output, n_units } => self.start_bar(output, *n_units),
            Event::UnitWaiting { unit, holder } => {
                let text = format!("{unit}: waiting for {holder}");
                self.print(|| report::line(Label::Wait, &text));
            }
            Event::UnitProgress {
                unit,
                fraction,
                message,
            } => {
                if self.is_counted(unit) {
                    self.fractions.insert(unit.clone(), (*fraction).into());
                    self.move_bar();
                }
                if let Some(bar) = &self.bar {
                    bar.set_message(message.clone());
                }
            }
            Event::UnitLost { unit, why } => {
                self.fractions.remove(unit);
                let text = format!("{unit}: {why}");
                self.print(|| report::line(Label::Lost, &text));
            }
            Event::Queue {
                output,
                on,
                waiting,
                running,
            } => self.show_queue(output, on, waiting, running),
            Event::UnitDamaged { unit } => {
                let text = format!("{unit} is damaged in the lake and is made again");
                self.print(|| report::line(Label::Repair, &text));
            }
            Event::UnitDone {
                unit,
                skipped,
                made_now,
                ..
            } if self.is_counted(unit) => {
                self.fractions.remove(unit);
                self.n_units_done += 1;
                self.n_made_now += usize::from(*made_now);
                self.move_bar();
                if let Some(reason) = skipped {
                    let text = format!("{}: {reason}", unit.partition);
                    self.print(|| report::short_line(Label::Skip, &text));
                }
            }
            // A rebuilt artifact.
            Event::UnitDone { .. } | Event::UnitLacking { .. } => {}
            // Others go on; the command reports it again at its end.
            Event::UnitFailed { unit, message, .. } => {
                self.fractions.remove(unit);
                let text = format!("{unit}: {message}");
                self.print(|| report::line(Label::Fail, &text));
            }
            Event::OutputDone {
                output,
                description,
                n_made_now,
                seconds,
            } => self.finish(&output.stage, description, *n_made_now, *seconds),
        }
    }

    /// Shows where units are: beside the bar, or in a line when they are handed over.
    fn show_queue(
        &mut self,
        output: &NodeName,
        on: &str,
        waiting: &BTreeMap<String, usize>,
        running: &BTreeMap<String, usize>,
    ) {
        let hosts = running.iter();
        let hosts: Vec<String> = hosts.map(|(host, n)| format!("{n} on {host}")).collect();
        let n_waiting: usize = waiting.values().sum();
        let reasons = waiting.keys().filter(|reason| !is_idle(reason));
        let reasons: Vec<&str> = reasons.map(String::as_str).collect();
        let reasons = match reasons.join(", ") {
            none if none.is_empty() => none,
            reasons => format!(" ({reasons})"),
        };
        let mut places = vec![format!("{n_waiting} units wait{reasons}")];
        places.extend(hosts);
        let estimate = self.estimate();
        let places = places.join(", ") + &estimate;
        match &self.bar {
            Some(bar) if !bar.is_hidden() => bar.set_message(format!("{on}: {places}")),
            // Without a terminal a line says where they went, why they wait, and now and then how far they are.
            _ if self
                .queued
                .as_ref()
                .is_some_and(|notice| notice.is_recent(output, &reasons)) => {}
            _ => {
                let done = match self.n_units_done {
                    0 => String::new(),
                    n => format!("{n} of {} units made, ", self.n_units),
                };
                report::line(Label::Queue, format!("{output} on {on}: {done}{places}"));
                let before = self.queued.take().filter(|notice| notice.output == *output);
                let pause = before.map_or(QUEUE_PERIOD, |notice| notice.pause * 2);
                self.queued = Some(QueueNotice {
                    output: output.clone(),
                    reasons,
                    at: clock::now(),
                    pause: pause.min(LONGEST_QUEUE_PERIOD),
                });
            }
        }
    }

    /// The time that the other units take if they take as long as those that are made.
    fn estimate(&self) -> String {
        let (Some(started), 1..) = (self.started, self.n_made_now) else {
            return String::new();
        };
        let n_left = self.n_units.saturating_sub(self.n_units_done);
        let per_unit = clock::since(started).as_secs_f64() / self.n_made_now as f64;
        format!(
            ", about {} left",
            report::duration(per_unit * n_left as f64)
        )
    }

    /// Whether the bar counts this unit.
    fn is_counted(&self, unit: &UnitName) -> bool {
        self.output.as_ref() == Some(&unit.node)
    }

    fn start_bar(&mut self, output: &NodeName, n_units: usize) {
        let bar = ProgressBar::new(ticks(n_units as f64));
        let style = ProgressStyle::with_template(
            "       {prefix:<10} [{bar:30}] {percent:>3} %  {elapsed} {wide_msg}",
        );
        if let Ok(style) = style {
            bar.set_style(style.progress_chars("=> "));
        }
        bar.set_prefix(output.stage.to_string());
        bar.enable_steady_tick(Duration::from_millis(200));
        self.bar = Some(bar);
        self.output = Some(output.clone());
        self.fractions.clear();
        self.n_units_done = 0;
        self.n_made_now = 0;
        self.n_units = n_units;
        self.started = Some(clock::now());
    }

    /// Prints the line of an output, or holds it back until something is made.
    fn finish(&mut self, stage: &StageName, description: &str, n_made_now: usize, seconds: f64) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
        self.n_done += 1;
        let time = if n_made_now == 0 {
            "cached".to_owned()
        } else {
            report::duration(seconds)
        };
        let width = self.n_outputs.to_string().len();
        let head = format!("  {:>width$}/{}  {stage:<9} ", self.n_done, self.n_outputs);
        self.held_back
            .push(stage_line(&head, description, &time, self.width));
        if n_made_now > 0 {
            for line in self.held_back.drain(..) {
                report::plain(&line);
            }
        }
    }

    fn move_bar(&self) {
        if let Some(bar) = &self.bar {
            let making: f64 = self.fractions.values().sum();
            bar.set_position(ticks(self.n_units_done as f64 + making));
        }
    }

    /// Prints a line without disturbing the bar.
    fn print(&self, print: impl FnOnce()) {
        match &self.bar {
            Some(bar) => bar.suspend(print),
            None => print(),
        }
    }
}

/// Width of a stage's description without a terminal.
const DESCRIPTION: usize = 51;

/// Width of an output's duration.
const TIME: usize = 8;

/// The line of an output, cut to a width if there is one: the description is cut, not the time.
fn stage_line(head: &str, description: &str, time: &str, width: Option<usize>) -> String {
    let taken = head.chars().count() + 1 + TIME.max(time.chars().count());
    let description = match width {
        Some(width) => report::cut(description, width.saturating_sub(taken)),
        None => description.to_owned(),
    };
    let line = format!("{head}{description:<DESCRIPTION$} {time:>TIME$}");
    match width {
        // Narrower than a usual description.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_others_take_as_long_as_those_made_now_whatever_was_there_before() {
        clock::World::simulate(1, |_| {
            let output = NodeName::parse("first.parts").unwrap();
            let mut state = State::default();
            let done = |number: usize, made_now| Event::UnitDone {
                unit: UnitName::new(&output, &format!("p{number}").parse().unwrap()),
                fingerprint: dataflow::Digest::of_bytes(b"unit"),
                made_now,
                skipped: None,
            };
            state.show(&Event::OutputStarted {
                output: output.clone(),
                n_units: 12,
            });
            (0..2).for_each(|number| state.show(&done(number, false)));
            assert_eq!(state.estimate(), "", "nothing is known yet");
            clock::sleep(Duration::from_mins(1));
            (2..6).for_each(|number| state.show(&done(number, true)));
            // Four in a minute, and six are left.
            assert_eq!(state.estimate(), ", about 1 min 30 s left");
            clock::sleep(Duration::from_mins(1));
            (6..12).for_each(|number| state.show(&done(number, true)));
            assert_eq!(state.estimate(), ", about 0.0 s left");
        });
    }

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
