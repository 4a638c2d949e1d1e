//! Printing: the only file that writes to stdout and stderr.

use std::{
    env, fmt,
    io::{self, IsTerminal, Write},
    iter,
    os::fd::AsFd,
};

use anstream::AutoStream;
use clap::builder::styling::{AnsiColor, Style};
use dataflow::Location;
use serde::Serialize;

use crate::{arguments::Format, label::Label, outcome::CommandError, system_errors::in_words};

/// Writes data to stdout. A closed pipe is not an error; other write errors are.
pub(crate) fn data(bytes: &[u8]) -> Result<(), CommandError> {
    let mut stdout = io::stdout().lock();
    checked(stdout.write_all(bytes).and_then(|()| stdout.flush()))
}

/// The result of a write to stdout.
fn checked(written: io::Result<()>) -> Result<(), CommandError> {
    match written {
        Err(err) if err.kind() != io::ErrorKind::BrokenPipe => Err(CommandError::failed(
            anyhow::Error::from(err).context("cannot write to standard output"),
            None,
        )),
        Ok(()) | Err(_) => Ok(()),
    }
}

/// A line for people.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Line {
    /// The label whose word begins it.
    label: Option<Label>,
    text: String,
}

impl Line {
    /// Returns a line of text behind a label.
    pub(crate) fn labeled(label: Label, text: impl fmt::Display) -> Self {
        Self {
            label: Some(label),
            text: label.line(text),
        }
    }

    /// Returns a line without a label.
    pub(crate) fn plain(text: impl Into<String>) -> Self {
        Self {
            label: None,
            text: text.into(),
        }
    }

    /// Returns the number of its characters.
    pub(crate) fn len(&self) -> usize {
        self.text.chars().count()
    }

    /// Returns it cut to a width, with a mark at the cut.
    pub(crate) fn cut(self, width: usize) -> Self {
        Self {
            text: cut(&self.text, width),
            ..self
        }
    }

    /// Returns it with errors of the operating system in words.
    fn in_words(self) -> Self {
        Self {
            text: in_words(&self.text),
            ..self
        }
    }

    /// Returns its text with the label in color.
    fn painted(&self) -> String {
        match self.label {
            Some(label) => label.painted(&self.text),
            None => self.text.clone(),
        }
    }
}

/// Writes lines for people to stdout, labels in color.
pub(crate) fn lines(lines: &[Line]) -> Result<(), CommandError> {
    let text: String = lines.iter().map(|line| line.painted() + "\n").collect();
    let mut stdout = AutoStream::auto(io::stdout().lock());
    checked(
        stdout
            .write_all(text.as_bytes())
            .and_then(|()| stdout.flush()),
    )
}

/// Writes a value as JSON to stdout, for programs.
pub(crate) fn json(value: &impl Serialize) -> Result<(), CommandError> {
    let json =
        serde_json::to_string_pretty(value).map_err(|err| CommandError::failed(err, None))?;
    data(format!("{json}\n").as_bytes())
}

/// Writes a value as one line of JSON to stdout, for programs.
pub(crate) fn json_line(value: &impl Serialize) -> Result<(), CommandError> {
    let json = serde_json::to_string(value).map_err(|err| CommandError::failed(err, None))?;
    data(format!("{json}\n").as_bytes())
}

/// Writes an answer to stdout: as JSON for programs, or as the text for people.
pub(crate) fn answer<T: Serialize>(
    format: Format,
    answer: &T,
    text: impl FnOnce(&T) -> String,
) -> Result<(), CommandError> {
    match format {
        Format::Json => json(answer),
        Format::Text => data(text(answer).as_bytes()),
    }
}

/// Writes a line for people to stderr.
pub(crate) fn line(label: Label, text: impl fmt::Display) {
    print(&[Line::labeled(label, text)]);
}

/// Writes a line for people to stderr, and below it what to do.
pub(crate) fn line_with_hint(label: Label, text: impl fmt::Display, hint: Option<&str>) {
    let hint = hint.map(|hint| Line::labeled(Label::Hint, hint));
    let lines: Vec<Line> = iter::once(Line::labeled(label, text)).chain(hint).collect();
    print(&lines);
}

/// Writes text for people to stderr.
pub(crate) fn plain(text: &str) {
    print(&[Line::plain(text)]);
}

/// Writes lines for people to stderr, labels in color. A failure cannot be reported anywhere.
pub(crate) fn print(lines: &[Line]) {
    let lines = lines.iter().map(|line| line.clone().in_words().painted());
    write_to_stderr(&lines.collect::<Vec<String>>().join("\n"));
}

/// Writes text with its colors to stderr, in one piece.
fn write_to_stderr(text: &str) {
    if clock::process().is_some() {
        // A simulated process has no terminal.
        return;
    }
    let mut stderr = AutoStream::auto(io::stderr().lock());
    let _gone = writeln!(stderr, "{text}");
}

/// Writes a line about a run to stderr, cut where a terminal would wrap it.
pub(crate) fn short_line(label: Label, text: impl fmt::Display) {
    short(Line::labeled(label, text));
}

/// Writes a line to stderr, cut where a terminal would wrap it.
pub(crate) fn short(line: Line) {
    match width_of(&io::stderr()) {
        Some(width) => print(&[line.in_words().cut(width)]),
        None => print(&[line]),
    }
}

/// Writes a location in a file to stderr, as compilers show it, its carets in color.
fn location(location: &Location) {
    let text = in_words(&location.to_string());
    let before = text.trim_end_matches('^');
    let carets = text.get(before.len()..).unwrap_or_default();
    let style = Style::new().fg_color(Some(AnsiColor::Red.into()));
    write_to_stderr(&format!("{before}{style}{carets}{style:#}"));
}

/// Returns the line width of an output in characters; `None` if it is not a terminal. `COLUMNS`
/// sets it in any case.
pub(crate) fn width_of(shown: &(impl IsTerminal + AsFd)) -> Option<usize> {
    let asked = env::var("COLUMNS").ok();
    let asked = asked.and_then(|text| text.trim().parse().ok());
    let found = || {
        let size = terminal_size::terminal_size_of(shown).filter(|_| shown.is_terminal());
        size.map(|(width, _)| usize::from(width.0))
    };
    asked.or_else(found).filter(|&width| width > 0)
}

/// Characters that a line has room for where the output is no terminal.
pub(crate) const LINE_WIDTH: usize = 100;

/// Mark of omitted text.
pub(crate) const LEFT_OUT: &str = "…";

/// Cuts text to a width, with a mark at the cut.
pub(crate) fn cut(text: &str, width: usize) -> String {
    if text.chars().count() <= width {
        return text.to_owned();
    }
    let kept = width.saturating_sub(LEFT_OUT.chars().count());
    let kept: String = text.chars().take(kept).collect();
    format!("{}{LEFT_OUT}", kept.trim_end())
}

/// Cuts every line of a text to a width, if there is one.
pub(crate) fn cut_lines(text: String, width: Option<usize>) -> String {
    match width {
        Some(width) => text.lines().map(|line| cut(line, width) + "\n").collect(),
        None => text,
    }
}

/// Wraps text to a width, between words.
pub(crate) fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.is_empty() => line.push_str(word),
            Some(line) if line.chars().count() + 1 + word.chars().count() <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// Prints clap's output: help to stdout, errors to stderr.
pub(crate) fn arguments(said: &clap::Error) -> u8 {
    let written = said.print().and_then(|()| io::stdout().flush());
    if said.use_stderr() {
        return 2;
    }
    match checked(written) {
        Ok(()) => 0,
        Err(err) => print_error(&err),
    }
}

/// Reports why a command failed, and returns its exit code.
pub(crate) fn print_error(err: &CommandError) -> u8 {
    match err {
        CommandError::File(err) => {
            for problem in &err.problems {
                line(Label::Error, &problem.message);
                if let Some(at) = &problem.location {
                    location(at);
                }
                hint(problem.hint.as_deref());
            }
            2
        }
        CommandError::Usage {
            message,
            hint: advice,
        } => {
            line(Label::Error, message);
            hint(advice.as_deref());
            2
        }
        CommandError::Failed {
            error,
            hint: advice,
        } => {
            line(Label::Error, chain(error));
            hint(advice.as_deref());
            1
        }
    }
}

fn hint(advice: Option<&str>) {
    if let Some(advice) = advice {
        line(Label::Hint, advice);
    }
}

/// An error and its causes on one line; repeated causes are left out.
pub(crate) fn chain(error: &anyhow::Error) -> String {
    joined(error.chain())
}

/// The same of an error that is borrowed.
pub(crate) fn sources(error: &(dyn std::error::Error + 'static)) -> String {
    let mut next = Some(error);
    joined(std::iter::from_fn(move || {
        let err = next?;
        next = err.source();
        Some(err)
    }))
}

fn joined<'a>(causes: impl Iterator<Item = &'a (dyn std::error::Error + 'static)>) -> String {
    let mut text = String::new();
    for cause in causes.map(ToString::to_string) {
        if text.is_empty() {
            text = cause;
        } else if !text.ends_with(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    in_words(&text)
}

/// Lays out rows in columns two spaces apart; columns in `right` are aligned to the right.
pub(crate) fn columns(rows: &[Vec<String>], right: &[usize]) -> String {
    let n_columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let widths: Vec<usize> = (0..n_columns)
        .map(|column| {
            let cells = rows.iter().filter_map(|row| row.get(column));
            cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
        })
        .collect();
    let mut text = String::new();
    for row in rows {
        let mut laid_out = String::new();
        for (column, (cell, &width)) in row.iter().zip(&widths).enumerate() {
            let padding = " ".repeat(width - cell.chars().count());
            if column > 0 {
                laid_out.push_str("  ");
            }
            if right.contains(&column) {
                laid_out.push_str(&padding);
                laid_out.push_str(cell);
            } else {
                laid_out.push_str(cell);
                laid_out.push_str(&padding);
            }
        }
        text.push_str(laid_out.trim_end());
        text.push('\n');
    }
    text
}

/// A row of a table behind a label.
pub(crate) type LabeledRow = (Label, Vec<String>);

/// Lays out labeled rows in columns two spaces apart; the labels' words have at least `least` characters.
pub(crate) fn labeled_rows(rows: &[LabeledRow], least: usize) -> Vec<Line> {
    let cells = rows.iter().map(|(label, cells)| {
        let word = format!("{:<least$}", label.word());
        iter::once(word).chain(cells.iter().cloned()).collect()
    });
    let text = columns(&cells.collect::<Vec<Vec<String>>>(), &[]);
    let lines = rows.iter().zip(text.lines());
    let line = |((label, _), line): (&(Label, _), &str)| Line {
        label: Some(*label),
        text: line.to_owned(),
    };
    lines.map(line).collect()
}

/// The first row of a table.
pub(crate) fn header<const N: usize>(names: [&str; N]) -> Vec<String> {
    names.map(str::to_owned).to_vec()
}

/// A number of bytes for display.
pub(crate) fn bytes(n_bytes: u64) -> String {
    let mut number = n_bytes as f64;
    for unit in ["bytes", "kB", "MB", "GB"] {
        if number < 1000.0 {
            let digits = usize::from(unit != "bytes");
            return format!("{number:.digits$} {unit}");
        }
        number /= 1000.0;
    }
    format!("{number:.1} TB")
}

/// A duration for display.
pub(crate) fn duration(seconds: f64) -> String {
    // Rounded before it is split, so that no part rounds up to 60.
    let whole = seconds.round();
    if seconds < 59.95 {
        format!("{seconds:.1} s")
    } else if whole < 3600.0 {
        format!("{:.0} min {:02.0} s", (whole / 60.0).floor(), whole % 60.0)
    } else {
        let minutes = (seconds / 60.0).round();
        format!(
            "{:.0} h {:02.0} min",
            (minutes / 60.0).floor(),
            minutes % 60.0
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_have_no_sixtieth_second_or_minute() {
        for (seconds, expected) in [
            (0.04, "0.0 s"),
            (59.94, "59.9 s"),
            (59.96, "1 min 00 s"),
            (359.8, "6 min 00 s"),
            (3599.4, "59 min 59 s"),
            (3599.6, "1 h 00 min"),
            (7199.0, "2 h 00 min"),
        ] {
            assert_eq!(duration(seconds), expected);
        }
    }

    #[test]
    fn cut_text_says_so() {
        assert_eq!(cut("pitcher", 7), "pitcher");
        assert_eq!(cut("pitcher_base", 7), "pitche…");
        assert_eq!(cut("äöüäöü", 3), "äö…");
    }

    #[test]
    fn words_are_kept_whole_where_lines_are_broken() {
        assert_eq!(wrapped("a bc def", 4), ["a bc", "def"]);
        assert_eq!(wrapped("abcdef g", 4), ["abcdef", "g"]);
        assert_eq!(wrapped("", 4), [""]);
    }

    #[test]
    fn the_label_of_a_line_is_colored_and_nothing_else() {
        for line in [
            Line::plain("error: x"),
            Line::labeled(Label::Report, "`a`"),
            Line::labeled(Label::Goal, "1 succeeded"),
        ] {
            assert_eq!(line.painted(), line.text);
        }
        for (label, word) in [
            (Label::Error, "error:"),
            (Label::Hint, "hint:"),
            (Label::Done, "done"),
            (Label::Cached, "cached"),
        ] {
            let line = Line::labeled(label, "error: done");
            let painted = line.painted();
            let end = format!("m{word}\u{1b}[0m");
            let (_, rest) = painted.split_once(&end).unwrap();
            assert!(rest.trim_start() == "error: done", "{painted:?}");
        }
    }

    #[test]
    fn rows_keep_their_labels() {
        let row = |label, cell: &str| (label, vec![cell.to_owned()]);
        let lines = labeled_rows(&[row(Label::Ok, "a"), row(Label::Missing, "b")], 3);
        let texts: Vec<&str> = lines.iter().map(|line| line.text.as_str()).collect();
        assert_eq!(texts, ["ok       a", "missing  b"]);
        assert_eq!(lines[1].label, Some(Label::Missing));
        assert_eq!(
            lines[1].clone().cut(5).painted(),
            Line::plain("miss…").painted()
        );
    }
}
