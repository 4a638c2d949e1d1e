//! Limits on a program's output, and lines of progress in it.

use std::{
    io::{BufRead, BufReader, Read},
    sync::mpsc::Sender,
    time::{Duration, Instant},
};

use crate::log::Log;

/// Most that a program may print on stdout or stderr, in bytes: a log is for people.
const MAX_PRINTED: u64 = 32 << 20;
/// Most lines of progress.
const MAX_PROGRESS_LINES: u32 = 100_000;
/// Longest part of a line that is held, in bytes.
const MAX_LINE: u64 = 64 << 10;
/// First word of a line of progress.
const PROGRESS: &str = "progress ";
/// Least time between two reports of progress.
const PROGRESS_EVERY: Duration = Duration::from_millis(50);

/// An event in a unit's processes.
#[derive(Debug)]
pub(crate) enum ProcessEvent {
    /// A share of the work is done, with a message.
    Progress(f64, String),
    /// One of its outputs has closed.
    Closed,
    /// It printed more than it may: the problem, and advice to the user.
    Flooded(String, &'static str),
    /// The program's first process has ended.
    Ended(std::io::Result<std::process::ExitStatus>),
}

/// Reads one output of a program to its end: progress goes to `events`, everything else into the log.
pub(crate) fn read(output: impl Read, name: &str, log: &Log, events: &Sender<ProcessEvent>) {
    let mut output = BufReader::new(output);
    let (mut n_bytes, mut n_progress) = (0_u64, 0_u32);
    let mut reported: Option<Instant> = None;
    let mut line = Vec::new();
    // The receiver may have gone: then nobody asks any more.
    let send = |happened| events.send(happened).is_ok();
    loop {
        line.clear();
        match output.by_ref().take(MAX_LINE).read_until(b'\n', &mut line) {
            Ok(0) | Err(_) => break,
            Ok(_) => {}
        }
        if let Some((share, message)) = progress(&line) {
            n_progress += 1;
            if n_progress > MAX_PROGRESS_LINES {
                let problem = format!("printed more than {MAX_PROGRESS_LINES} lines of progress");
                send(ProcessEvent::Flooded(problem, "print one for each percent"));
                break;
            }
            let now = Instant::now();
            if reported.is_none_or(|before| now - before >= PROGRESS_EVERY) {
                reported = Some(now);
                if !send(ProcessEvent::Progress(share, message)) {
                    break;
                }
            }
            continue;
        }
        n_bytes += line.len() as u64;
        if n_bytes > MAX_PRINTED {
            let problem = format!("printed more than {} MB to {name}", MAX_PRINTED >> 20);
            let advice = "print less; results belong into a file in `out`";
            send(ProcessEvent::Flooded(problem, advice));
            break;
        }
        log.line(&line);
    }
    send(ProcessEvent::Closed);
}

/// Parses `progress 0.25 what is done`.
fn progress(line: &[u8]) -> Option<(f64, String)> {
    let text = std::str::from_utf8(line)
        .ok()?
        .trim_end()
        .strip_prefix(PROGRESS)?;
    let (share, message) = text.split_once(' ').unwrap_or((text, ""));
    let share: f64 = share.parse().ok()?;
    (0.0..=1.0)
        .contains(&share)
        .then(|| (share, message.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_is_a_share_and_a_message() {
        let parsed = |text: &str| progress(text.as_bytes());
        assert_eq!(
            parsed("progress 0.25 in physics\n"),
            Some((0.25, "in physics".to_owned()))
        );
        assert_eq!(parsed("progress 1\r\n"), Some((1.0, String::new())));
        for other in [
            "progress",
            "progress report",
            "progress 1.5",
            "progress nan",
            " progress 0.5",
        ] {
            assert_eq!(parsed(other), None, "{other}");
        }
    }
}
