//! Printing: the only file that writes to stdout and stderr.

use std::{
    io::{self, Write},
    process::ExitCode,
};

use serde::Serialize;

use crate::outcome::Trouble;

/// Writes data to stdout. A reader that has gone away is no fault.
pub(crate) fn data(bytes: &[u8]) {
    let mut stdout = io::stdout().lock();
    let _gone = stdout.write_all(bytes).and_then(|()| stdout.flush());
}

/// Writes a value as JSON to stdout, for programs.
pub(crate) fn json(value: &impl Serialize) -> Result<(), Trouble> {
    let json = serde_json::to_string_pretty(value).map_err(|err| Trouble::failed(err, None))?;
    data(format!("{json}\n").as_bytes());
    Ok(())
}

/// Writes a line for people to stderr.
pub(crate) fn line(text: &str) {
    let _gone = writeln!(io::stderr().lock(), "{text}");
}

/// Reports why a command did not do what it was asked, and returns its exit code.
pub(crate) fn trouble(trouble: &Trouble) -> ExitCode {
    match trouble {
        Trouble::File(err) => {
            for problem in &err.problems {
                line(&format!("error: {}", problem.message));
                if let Some(location) = &problem.location {
                    line(&location.to_string());
                }
                hint(problem.hint.as_deref());
            }
            ExitCode::from(2)
        }
        Trouble::Usage {
            message,
            hint: advice,
        } => {
            line(&format!("error: {message}"));
            hint(advice.as_deref());
            ExitCode::from(2)
        }
        Trouble::Failed {
            error,
            hint: advice,
        } => {
            line(&format!("error: {}", chain(error)));
            hint(advice.as_deref());
            ExitCode::from(1)
        }
    }
}

fn hint(advice: Option<&str>) {
    if let Some(advice) = advice {
        line(&format!("hint: {advice}"));
    }
}

/// An error and its causes on one line; a cause that repeats what was said is left out.
pub(crate) fn chain(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if text.is_empty() {
            text = cause;
        } else if !text.ends_with(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
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

/// A number of bytes as people read it.
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

/// A duration as people read it.
pub(crate) fn duration(seconds: f64) -> String {
    if seconds < 60.0 {
        format!("{seconds:.1} s")
    } else if seconds < 3600.0 {
        format!(
            "{:.0} min {:02.0} s",
            (seconds / 60.0).floor(),
            seconds % 60.0
        )
    } else {
        let minutes = seconds / 60.0;
        format!(
            "{:.0} h {:02.0} min",
            (minutes / 60.0).floor(),
            minutes % 60.0
        )
    }
}
