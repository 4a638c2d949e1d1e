//! Job states from a scheduler, in one answer for all jobs.

use std::{
    collections::HashMap,
    io::{self, Read, Write},
    process::{Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use super::scheduler::Scheduler;

/// Time after which a command of a scheduler counts as failed.
const COMMAND_TIMEOUT: Duration = Duration::from_secs(30);

/// Time between looks whether a command has ended.
const LOOK_EVERY: Duration = Duration::from_millis(5);

/// The state of a job.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum JobState {
    /// It waits for a machine, for this reason.
    Waiting(String),
    /// It runs on this machine.
    Running(String),
    /// It will never run.
    Stuck(String),
    /// Nor would another like it.
    Impossible(String),
    /// It has ended in this state.
    Over(String),
}

/// The states of jobs by the name of their array and their index in it.
pub(crate) type Queue = HashMap<(String, usize), JobState>;

/// Reads an answer to the query for all jobs.
pub(crate) fn read(scheduler: &Scheduler, said: &str) -> Queue {
    let lines = said.lines().filter_map(|line| {
        let words = line.split(&scheduler.separator).map(str::trim);
        let columns: HashMap<&str, &str> = scheduler
            .columns
            .iter()
            .map(String::as_str)
            .zip(words)
            .collect();
        let column = |name| columns.get(name).copied().unwrap_or_default();
        let index = column("index").parse().ok()?;
        let state = column("state");
        let is_one_of = |names: &[String], word: &str| names.iter().any(|name| name == word);
        let reason = column("reason");
        let state = if is_one_of(&scheduler.running, state) {
            JobState::Running(column("host").to_owned())
        } else if !is_one_of(&scheduler.waiting, state) {
            JobState::Over(state.to_owned())
        } else if is_one_of(&scheduler.stuck, reason) {
            JobState::Stuck(reason.to_owned())
        } else if is_one_of(&scheduler.impossible, reason) {
            JobState::Impossible(reason.to_owned())
        } else {
            JobState::Waiting(reason.to_owned())
        };
        Some(((column("name").to_owned(), index), state))
    });
    lines.collect()
}

/// Runs a command of a scheduler with a text on its stdin; returns its stdout.
pub(crate) type SchedulerCall<'a> = dyn Fn(&[String], &str) -> io::Result<String> + Sync + 'a;

/// Runs a command of a scheduler with this on its stdin; returns its stdout.
pub(crate) fn ask(words: &[String], stdin: &str) -> io::Result<String> {
    let mut rest = words.iter();
    let program = rest.next().ok_or(io::ErrorKind::InvalidInput)?;
    let mut child = Command::new(program)
        .args(rest)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()?;
    if let Some(mut pipe) = child.stdin.take() {
        // A command that reads nothing of it may end before.
        let _read = pipe.write_all(stdin.as_bytes());
    }
    let reader = |pipe: Option<Box<dyn Read + Send>>| {
        thread::spawn(move || {
            let mut text = Vec::new();
            let read = pipe.map(|mut pipe| pipe.read_to_end(&mut text));
            read.transpose()
                .map(|_| String::from_utf8_lossy(&text).into_owned())
        })
    };
    let said = reader(child.stdout.take().map(|pipe| Box::new(pipe) as _));
    let complained = reader(child.stderr.take().map(|pipe| Box::new(pipe) as _));
    let until = Instant::now() + COMMAND_TIMEOUT;
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break status;
        }
        if Instant::now() > until {
            child.kill()?;
            child.wait()?;
            return Err(io::Error::new(
                io::ErrorKind::TimedOut,
                format!(
                    "`{program}` has not ended after {} s",
                    COMMAND_TIMEOUT.as_secs()
                ),
            ));
        }
        thread::sleep(LOOK_EVERY);
    };
    let broken = || io::Error::other("its output cannot be read");
    let said = said.join().ok().ok_or_else(broken)??;
    let complained = complained.join().ok().ok_or_else(broken)??;
    if status.success() {
        return Ok(said);
    }
    // Some complain on stdout, some on both.
    let words: Vec<&str> = [complained.trim(), said.trim()]
        .into_iter()
        .filter(|text| !text.is_empty())
        .collect();
    let words = if words.is_empty() {
        format!("{status}, and printed nothing")
    } else {
        words.join("\n")
    };
    Err(io::Error::other(format!("`{program}` failed: {words}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_is_shown_whichever_stream_it_used() {
        let said = |script: &str| {
            let words = ["sh", "-c", script].map(str::to_owned);
            ask(&words, "").unwrap_err().to_string()
        };
        assert!(said("echo no such account; exit 1").ends_with("no such account"));
        assert!(said("echo no such account >&2; exit 1").ends_with("no such account"));
        let both = said("echo maintenance; echo refused >&2; exit 2");
        assert!(
            both.contains("maintenance") && both.contains("refused"),
            "{both}"
        );
        assert!(said("exit 3").contains("3, and printed nothing"));
    }

    #[test]
    fn an_answer_of_slurm_is_read_line_by_line() {
        let scheduler = toml_edit::de::from_str(include_str!("../executors/slurm.toml")).unwrap();
        let said = "pl1|0|RUNNING|n1|None\npl1|1|PENDING||Resources\npl1|2|COMPLETED|n2|None\n\
                    pl2|0|PENDING||launch failed requeued held\npl2|N/A|PENDING||x\n\n";
        let queue = read(&scheduler, said);
        let of = |name: &str, index| queue.get(&(name.to_owned(), index)).cloned();
        assert_eq!(of("pl1", 0), Some(JobState::Running("n1".to_owned())));
        assert_eq!(
            of("pl1", 1),
            Some(JobState::Waiting("Resources".to_owned()))
        );
        assert_eq!(of("pl1", 2), Some(JobState::Over("COMPLETED".to_owned())));
        assert!(matches!(of("pl2", 0), Some(JobState::Stuck(_))));
        assert_eq!(queue.len(), 4);
    }

    #[test]
    fn a_command_that_fails_says_why() {
        let words = ["sh", "-c", "cat >&2; exit 3"].map(str::to_owned);
        let err = ask(&words, "no such partition").unwrap_err();
        assert_eq!(err.to_string(), "`sh` failed: no such partition");
        let words = ["cat"].map(str::to_owned);
        assert_eq!(ask(&words, "as it came").unwrap(), "as it came");
    }
}
