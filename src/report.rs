//! Printing: the only file that writes to stdout and stderr.

use std::{
    env, fmt,
    io::{self, IsTerminal, Write},
    os::fd::AsFd,
};

use anstream::AutoStream;
use clap::builder::styling::{AnsiColor, Style};
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

/// Writes text for people to stdout, labels in color.
pub(crate) fn text(text: &str) -> Result<(), CommandError> {
    let lines = text.lines().map(|line| painted(line) + "\n");
    let text: String = lines.collect();
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
    plain(&label.line(text));
}

/// Writes text for people to stderr, labels in color. A failure cannot be reported anywhere.
pub(crate) fn plain(text: &str) {
    if clock::process().is_some() {
        // A simulated process has no terminal.
        return;
    }
    let mut stderr = AutoStream::auto(io::stderr().lock());
    let text = in_words(text);
    let lines: Vec<String> = text.lines().map(painted).collect();
    let _gone = writeln!(stderr, "{}", lines.join("\n"));
}

/// Writes a line about a run to stderr, cut where a terminal would wrap it.
pub(crate) fn short_line(label: Label, text: impl fmt::Display) {
    short_plain(&label.line(text));
}

/// Writes a line to stderr as it is, cut where a terminal would wrap it.
pub(crate) fn short_plain(text: &str) {
    match width_of(&io::stderr()) {
        Some(width) => plain(&cut(&in_words(text), width)),
        None => plain(text),
    }
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

/// A line with the label that begins it, or its trailing carets, in color.
fn painted(line: &str) -> String {
    let word = line.split(' ').next().unwrap_or_default();
    if let Some(label) = Label::of(word) {
        let style = label.style();
        let rest = line.get(word.len()..).unwrap_or_default();
        return format!("{style}{word}{style:#}{rest}");
    }
    let before = line.trim_end_matches('^');
    let carets = line.get(before.len()..).unwrap_or_default();
    if carets.is_empty() || !before.ends_with(char::is_whitespace) {
        return line.to_owned();
    }
    let style = Style::new().fg_color(Some(AnsiColor::Red.into()));
    format!("{before}{style}{carets}{style:#}")
}

/// Prints clap's output: help to stdout, errors to stderr.
pub(crate) fn arguments(said: &clap::Error) -> u8 {
    let written = said.print().and_then(|()| io::stdout().flush());
    if said.use_stderr() {
        return 2;
    }
    match checked(written) {
        Ok(()) => 0,
        Err(failed) => trouble(&failed),
    }
}

/// Reports why a command failed, and returns its exit code.
pub(crate) fn trouble(trouble: &CommandError) -> u8 {
    match trouble {
        CommandError::File(err) => {
            for problem in &err.problems {
                line(Label::Error, &problem.message);
                if let Some(location) = &problem.location {
                    plain(&location.to_string());
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
    fn only_words_that_begin_a_line_and_carets_are_colored() {
        let plain = [
            "an error: x",
            "  done",
            "a^",
            "report `a`",
            "goal   1 succeeded",
        ];
        for text in plain {
            assert_eq!(painted(text), text);
        }
        for (text, word) in [
            ("error: no stage", "error:"),
            ("hint: name one", "hint:"),
            ("done   all", "done"),
            ("cached   a.b", "cached"),
            ("  | ^^^^", "^^^^"),
        ] {
            let colored = painted(text);
            let start = colored.find('\u{1b}').unwrap();
            assert!(
                colored[start..].contains(&format!("m{word}\u{1b}[0m")),
                "{colored:?}"
            );
        }
    }
}
