//! Units made by processes of their own: `pipeline unit`, with nothing shared but the lake and the
//! pipeline's file.

use std::{
    env,
    io::{BufRead, BufReader},
    path::PathBuf,
    process::{Child, Command, ExitStatus, Stdio},
};

use dataflow::{Elsewhere, Failure, Forced, NodeName, Origin, Progress};
use serde::{Deserialize, Serialize};

/// What a unit's process says on stdout, one JSON object per line.
#[derive(Debug, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub(crate) enum Event {
    /// It is this far.
    Progress {
        /// In 0..=1.
        fraction: f64,
        /// What it is doing.
        message: String,
    },
    /// Its result is in the lake.
    Done {
        /// Digest of its fingerprint.
        fingerprint: String,
        /// Whether this process made it, and not an earlier one.
        made_now: bool,
    },
    /// It failed.
    Failed {
        /// Why.
        message: String,
        /// What to do.
        hint: Option<String>,
        /// The output of which too little came to the stage, if that is why.
        left_out: Option<NodeName>,
    },
}

/// Makes each unit in a process of its own.
pub(crate) struct Processes {
    /// The lake's folder.
    pub(crate) lake: PathBuf,
    /// The pipeline's file, profile and values.
    pub(crate) origin: Origin,
}

impl Processes {
    fn start(&self, node: &NodeName, partition: &str, forced: Forced) -> std::io::Result<Child> {
        let mut command = Command::new(env::current_exe()?);
        command.arg("unit").arg("--lake").arg(&self.lake).args([
            "--format",
            "json",
            "--with-parent",
        ]);
        if let Some(profile) = &self.origin.profile {
            command.args(["--profile", profile]);
        }
        for value in &self.origin.overrides {
            command.args(["--set", value]);
        }
        if forced == Forced::Yes {
            command.arg("--fresh");
        }
        command
            .arg("--")
            .arg(&self.origin.file)
            .arg(node.to_string())
            .arg(partition);
        // Its stdin is a pipe that closes when this process ends, however it ends.
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()
    }
}

impl Elsewhere for Processes {
    fn make(
        &self,
        node: &NodeName,
        partition: &str,
        forced: Forced,
        progress: &Progress,
    ) -> Result<bool, Failure> {
        let failed = |message: String, hint: Option<String>| Failure::Elsewhere {
            message,
            hint,
            left_out: None,
        };
        let broken = |err: std::io::Error| {
            let message = format!("cannot run a process for `{node}` at `{partition}`: {err}");
            failed(message, None)
        };
        let mut child = self.start(node, partition, forced).map_err(broken)?;
        let mut result = None;
        if let Some(stdout) = child.stdout.take() {
            for line in BufReader::new(stdout).lines() {
                match serde_json::from_str(&line.map_err(broken)?) {
                    Ok(Event::Progress { fraction, message }) => progress(fraction, &message),
                    Ok(Event::Done { made_now, .. }) => result = Some(Ok(made_now)),
                    Ok(Event::Failed {
                        message,
                        hint,
                        left_out,
                    }) => {
                        result = Some(Err(Failure::Elsewhere {
                            message,
                            hint,
                            left_out: left_out.map(Into::into),
                        }));
                    }
                    Err(_) => {}
                }
            }
        }
        let status = child.wait().map_err(broken)?;
        result.unwrap_or_else(|| {
            Err(failed(
                format!(
                    "the process that made `{node}` at `{partition}` ended {}",
                    described(status)
                ),
                Some("what is made is kept: run the same command again".to_owned()),
            ))
        })
    }
}

/// How a process ended, in words.
fn described(status: ExitStatus) -> String {
    use std::os::unix::process::ExitStatusExt;
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("with exit code {code} and no result"),
        (None, Some(signal)) => format!("by signal {signal}"),
        (None, None) => "for a reason unknown".to_owned(),
    }
}
