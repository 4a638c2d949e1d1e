//! Units made in separate processes: `pipeline unit`, which shares only the lake and the pipeline
//! file.

use std::{
    env,
    io::{self, BufRead, BufReader},
    process::{Child, Command, ExitStatus, Stdio},
};

use dataflow::{Failure, Forced, Origin, Relay, RemoteWorker, UnitName};
use lake::Lake;

use crate::sharing;

/// Makes each unit in a separate process.
pub(crate) struct Processes<'a> {
    /// The lake.
    pub(crate) lake: &'a Lake,
    /// The pipeline's file, profile and values.
    pub(crate) origin: Origin,
}

impl Processes<'_> {
    fn start(&self, unit: &UnitName, forced: Forced) -> io::Result<Child> {
        let mut command = Command::new(env::current_exe()?);
        command
            .arg("unit")
            .arg("--lake")
            .arg(self.lake.root())
            .args(["--format", "json", "--with-parent"]);
        if let Some(profile) = &self.origin.profile {
            command.args(["--profile", profile]);
        }
        for value in &self.origin.overrides {
            command.args(["--set", value]);
        }
        if self.lake.is_depot_offline() {
            // So that not every process waits for it.
            command.env_remove(sharing::VARIABLE);
        }
        if forced == Forced::Yes {
            command.arg("--fresh");
        }
        command
            .arg("--")
            .arg(&self.origin.file)
            .arg(unit.node.to_string())
            .arg(unit.partition.as_str());
        // Its stdin is a pipe that closes when this process ends, however it ends.
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()
    }
}

impl RemoteWorker for Processes<'_> {
    fn make(&self, unit: &UnitName, forced: Forced, relay: &mut Relay) -> Result<(), Failure> {
        let UnitName { node, partition } = unit;
        let failed = |message: String, hint: Option<String>| Failure::Remote {
            message,
            hint,
            left_out: None,
        };
        let broken = |err: io::Error| {
            let message = format!("cannot run a process for `{node}` at `{partition}`: {err}");
            failed(message, None)
        };
        let mut child = self.start(unit, forced).map_err(broken)?;
        let lines = child.stdout.take().map(BufReader::new);
        for line in lines.into_iter().flat_map(BufRead::lines) {
            let relayed = line.map_err(broken).and_then(|line| relay.line(&line));
            if relayed.is_err() {
                // It has no listener any more; if it cannot be killed, it ends by itself.
                let _killed = child.kill();
                let _ended = child.wait();
                return relayed;
            }
        }
        let status = child.wait().map_err(broken)?;
        if relay.is_over() {
            return Ok(());
        }
        Err(failed(
            format!(
                "the process that made `{node}` at `{partition}` ended {}",
                described(status)
            ),
            Some("what is made is kept: run the same command again".to_owned()),
        ))
    }
}

/// Description of a process's exit status.
fn described(status: ExitStatus) -> String {
    use std::os::unix::process::ExitStatusExt;
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("with exit code {code} and no result"),
        (None, Some(signal)) => format!("by signal {signal}"),
        (None, None) => "for a reason unknown".to_owned(),
    }
}
