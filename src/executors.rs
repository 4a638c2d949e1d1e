//! Executors beside this process, by their names in a machine's own file.

use std::{env, fs, path::PathBuf};

use dataflow::{Events, Executor, Failure, OnOutcome, Resources, Wave};
use lake::Lake;
use serde::Deserialize;
use toml_edit::{DocumentMut, Item, Table as TomlTable};

use crate::{
    batch::{Batch, Scheduler, default_true, for_shell, queue},
    invocation,
    outcome::CommandError,
    processes::{Idle, Processes, Reach},
    sharing::{self, DepotName},
};

/// Variable with the path of the machine's own file.
const VARIABLE: &str = "PIPELINE_EXECUTORS";

/// The tables that need no file.
const BUILT_IN: [(&str, &str); 1] = [("slurm", include_str!("executors/slurm.toml"))];

/// A program that runs a command elsewhere and waits for it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Launcher {
    /// The words before the command, e.g. `["ssh", "gpu-box"]`.
    #[serde(rename = "launch")]
    prefix: Vec<String>,
    /// The program there [default: this one].
    program: Option<String>,
    /// Folder there for the lake of a worker.
    #[serde(default = "default_scratch")]
    scratch: String,
    /// Units at once.
    #[serde(default = "default_at_once")]
    at_once: usize,
    /// Whether the other units of an output are made when one fails.
    #[serde(default = "default_true")]
    keep_going: bool,
    /// Longest wait for the depot in minutes; read by [`depot_patience_min`].
    #[serde(default, rename = "depot_patience_min")]
    _depot_patience_min: Option<f64>,
}

fn default_scratch() -> String {
    "/tmp".to_owned()
}

fn default_at_once() -> usize {
    1
}

/// An executor by its name.
pub(crate) enum RemoteExecutor<'a> {
    /// Through a program that waits for each unit.
    Launch(Processes<'a>),
    /// Through the queue of a scheduler.
    Batch(Box<Batch<'a>>),
}

impl Executor for RemoteExecutor<'_> {
    fn takes(&self, wave: &Wave) -> bool {
        match self {
            Self::Launch(processes) => processes.takes(wave),
            Self::Batch(batch) => batch.takes(wave),
        }
    }

    fn keeps_going(&self) -> bool {
        match self {
            Self::Launch(processes) => processes.keeps_going(),
            Self::Batch(batch) => batch.keeps_going(),
        }
    }

    fn execute(&self, wave: &Wave, events: &Events, on_outcome: &OnOutcome) -> Result<(), Failure> {
        match self {
            Self::Launch(processes) => processes.execute(wave, events, on_outcome),
            Self::Batch(batch) => batch.execute(wave, events, on_outcome),
        }
    }
}

impl RemoteExecutor<'_> {
    /// Starts a worker that makes nothing; returns the name of its machine.
    pub(crate) fn try_out(&self) -> Result<String, Failure> {
        match self {
            Self::Launch(processes) => processes.try_out(),
            Self::Batch(batch) => batch.try_out(),
        }
    }

    /// Removes what killed runs of a pipeline have left in the depot, of what is over.
    pub(crate) fn tidy(&self, pipeline: &str) -> Result<(), Failure> {
        match self {
            Self::Launch(_) => Ok(()),
            Self::Batch(batch) => batch.tidy(pipeline),
        }
    }

    /// Asks whether jobs with these resources could be submitted, where there is a scheduler to ask.
    pub(crate) fn test(&self, resources: &Resources) -> Result<(), Failure> {
        match self {
            Self::Launch(_) => Ok(()),
            Self::Batch(batch) => batch.test(resources),
        }
    }
}

impl<'a> RemoteExecutor<'a> {
    /// Finds the executor of this name.
    pub(crate) fn named(name: &str, lake: &'a Lake) -> Result<Self, CommandError> {
        let depot = sharing::depot_name()?.ok_or_else(|| {
            CommandError::usage(
                "other machines need a depot, to get their inputs and to leave their results",
                format!(
                    "name a folder that all of them mount, or an object store, e.g. `export {}=/mnt/lab/depot`",
                    sharing::VARIABLE
                ),
            )
        })?;
        let (text, file) = configured(name)?;
        let wrong = |err: toml_edit::de::Error| {
            CommandError::usage(
                format!(
                    "`{name}` in `{}` is wrong: {}",
                    file.display(),
                    err.message()
                ),
                "crates/engine/depot/cluster.md has examples",
            )
        };
        if text.contains_key("launch") {
            let launcher: Launcher = toml_edit::de::from_str(&text.to_string()).map_err(wrong)?;
            return Ok(Self::Launch(launcher.processes(lake, &depot)?));
        }
        let scheduler: Scheduler = toml_edit::de::from_str(&text.to_string()).map_err(wrong)?;
        let logs = match (scheduler.logs.as_ref(), &depot) {
            (Some(logs), _) => {
                fs::create_dir_all(logs).map_err(|err| {
                    let message = format!("cannot make the folder of logs `{logs}`");
                    CommandError::failed(anyhow::Error::from(err).context(message), None)
                })?;
                PathBuf::from(logs)
            }
            // Made before jobs are submitted, in a depot that answers.
            (None, DepotName::Folder(folder)) => folder.join("logs"),
            (None, DepotName::Store(_)) => {
                return Err(CommandError::usage(
                    format!("`{name}` in `{}` names no folder of logs", file.display()),
                    "with an object store, set `logs` to a folder that every machine mounts",
                ));
            }
        };
        Ok(Self::Batch(Box::new(Batch {
            name: name.to_owned(),
            scheduler,
            lake,
            depot: depot.to_string(),
            logs,
            ask: &queue::ask,
        })))
    }
}

impl Launcher {
    fn processes<'a>(
        self,
        lake: &'a Lake,
        depot: &DepotName,
    ) -> Result<Processes<'a>, CommandError> {
        let here = || invocation::executable().map(|path| path.display().to_string());
        let program = match self.program {
            Some(program) => program,
            None => here().map_err(|err| CommandError::failed(err, None))?,
        };
        let named = format!("{}={depot}", sharing::VARIABLE);
        let worker = ["env", &named, &program, "unit", "--scratch", &self.scratch];
        let is_shell = self.prefix.first().is_some_and(|it| it.ends_with("ssh"));
        // `ssh` gives all of them to a shell in one line.
        let worker = worker.map(|word| {
            if is_shell {
                for_shell(word)
            } else {
                word.to_owned()
            }
        });
        let words = self.prefix.iter().cloned().chain(worker);
        Ok(Processes {
            lake,
            worker: words.map(Into::into).collect(),
            reach: Reach::DepotAlone,
            at_once: self.at_once.max(1),
            keep_going: self.keep_going,
            idle: Idle::default(),
        })
    }
}

/// Returns for how many minutes a run by this executor waits for a depot that is down, if its table says so.
pub(crate) fn depot_patience_min(name: &str) -> Result<Option<f64>, CommandError> {
    let (table, _) = configured(name)?;
    let number = table.get("depot_patience_min");
    Ok(number.and_then(|it| {
        it.as_float()
            .or_else(|| it.as_integer().map(|it| it as f64))
    }))
}

/// Returns the table of a name, and the file that may change it: of one that is built in, the keys of the
/// file come over those that are built in.
fn configured(name: &str) -> Result<(DocumentMut, PathBuf), CommandError> {
    let home = || env::var_os("HOME").map(|home| PathBuf::from(home).join(".config"));
    let base = env::var_os("XDG_CONFIG_HOME")
        .map(PathBuf::from)
        .or_else(home);
    let file = match env::var_os(VARIABLE) {
        Some(file) => PathBuf::from(file),
        None => base.unwrap_or_default().join("pipeline/executors.toml"),
    };
    let text = match fs::read_to_string(&file) {
        Err(err) if err.kind() == std::io::ErrorKind::NotFound => String::new(),
        read => read.map_err(|err| {
            let message = format!("cannot read `{}`", file.display());
            CommandError::failed(anyhow::Error::from(err).context(message), None)
        })?,
    };
    let unreadable = |err: toml_edit::TomlError| {
        CommandError::usage(
            format!("`{}` is not TOML: {}", file.display(), err.message()),
            "crates/engine/depot/cluster.md has examples",
        )
    };
    let own: DocumentMut = text.parse().map_err(unreadable)?;
    let changes = own.get(name).and_then(Item::as_table);
    let built_in = BUILT_IN.iter().find(|(built_in, _)| *built_in == name);
    if changes.is_none() && built_in.is_none() {
        let own = own.iter().map(|(name, _)| name);
        let known: Vec<&str> = BUILT_IN.iter().map(|(name, _)| *name).chain(own).collect();
        return Err(CommandError::usage(
            format!("no executor `{name}` is known on this machine"),
            format!(
                "known are: {}; `{}` adds others",
                known.join(", "),
                file.display()
            ),
        ));
    }
    let is_launch = changes.is_some_and(|it| it.contains_key("launch"));
    let base = built_in.filter(|_| !is_launch).map_or("", |(_, text)| text);
    let mut table: DocumentMut = base.parse().map_err(unreadable)?;
    for (key, value) in changes.unwrap_or(&TomlTable::new()) {
        table.insert(key, value.clone());
    }
    Ok((table, file))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_behind_ssh_stay_whole() {
        assert_eq!(for_shell("~/bin/pipeline"), "~/bin/pipeline");
        assert_eq!(
            for_shell("PIPELINE_DEPOT=s3://lab/depot"),
            "PIPELINE_DEPOT=s3://lab/depot"
        );
        assert_eq!(for_shell("/my disk/$x"), "'/my disk/$x'");
    }
}
