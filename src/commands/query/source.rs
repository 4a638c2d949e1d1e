//! Source of a query's tables: the lake, or the depot of several machines.

use std::{collections::BTreeSet, path::PathBuf};

use dataflow::ArtifactName;
use lake::{DepotTables, Lake, LakeError, Run, TableFiles};

use crate::{commands::lookup, outcome::CommandError, sharing};

/// Source of tables.
pub(super) enum Source<'a> {
    /// The lake: the tables of artifacts are those of a run, or else of the newest run that made each.
    Lake {
        /// The lake.
        lake: &'a Lake,
        /// The run.
        run: Option<Box<Run>>,
    },
    /// The runs that machines have sent to the depot.
    Depot(DepotTables<'a>),
}

impl Source<'_> {
    /// Names of the artifacts that may have a table; there is at least one.
    pub(super) fn names(&mut self) -> Result<BTreeSet<ArtifactName>, CommandError> {
        match self {
            Self::Lake { lake, run } => {
                let names = names_in(lake, run.as_deref())?;
                if names.is_empty() {
                    let message = format!("no tables in the lake `{}`", lake.root().display());
                    let other = "or name another lake with `--lake DIR`";
                    return Err(CommandError::usage(
                        message,
                        format!("{}, {other}", lookup::begin()),
                    ));
                }
                Ok(names)
            }
            Self::Depot(tables) => {
                if tables.is_empty() {
                    let variable = sharing::VARIABLE;
                    return Err(CommandError::usage(
                        "no runs in the depot",
                        format!(
                            "runs send what they make where `{variable}` names it; `pipeline push` sends what was made before"
                        ),
                    ));
                }
                Ok(tables.artifacts()?)
            }
        }
    }

    /// The newest partitions of a table, or those of the run.
    pub(super) fn newest(&mut self, table: &str) -> Result<TableFiles, LakeError> {
        match self {
            Self::Lake { lake, run: None } => lake.newest_table(table),
            Self::Lake {
                lake,
                run: Some(run),
            } => lake.table_of_run(table, run),
            Self::Depot(tables) => tables.newest(table),
        }
    }

    /// The partitions of a table from all runs.
    pub(super) fn of_all_runs(&mut self, table: &str) -> Result<TableFiles, LakeError> {
        match self {
            Self::Lake { lake, .. } => lake.table_of_all_runs(table),
            Self::Depot(tables) => tables.of_all_runs(table),
        }
    }

    /// The files of a table of runs, in a lake with the numbers of the runs.
    pub(super) fn history(
        &mut self,
        table: &str,
    ) -> Result<Vec<(Option<u64>, PathBuf)>, LakeError> {
        Ok(match self {
            Self::Lake { lake, .. } => {
                let files = lake.history_table(table)?.into_iter();
                files.map(|(run, file)| (Some(run), file)).collect()
            }
            Self::Depot(tables) => {
                let files = tables.history(table)?.into_iter();
                files.map(|file| (None, file)).collect()
            }
        })
    }

    /// Names of the tables, for people; those that cannot be listed are left out.
    pub(super) fn shown(&mut self) -> Vec<String> {
        let artifacts = match self {
            Self::Lake { lake, .. } => lake.tables().unwrap_or_default(),
            Self::Depot(tables) => tables.tables().unwrap_or_default().into_iter().collect(),
        };
        let mut names: Vec<String> = artifacts.iter().map(ToString::to_string).collect();
        for name in Lake::history_tables() {
            if self.history(name).is_ok_and(|files| !files.is_empty()) {
                names.push(name.to_owned());
            }
        }
        names
    }
}

/// Names of the artifacts that may have a table in a lake.
fn names_in(lake: &Lake, run: Option<&Run>) -> Result<BTreeSet<ArtifactName>, LakeError> {
    let mut names = BTreeSet::new();
    let newest = if run.is_some() {
        None
    } else {
        names.extend(lake.tables()?);
        let numbers = lake.runs()?;
        let newest = numbers.last().map(|&number| lake.run_without_units(number));
        newest.transpose()?
    };
    let outputs = run.or(newest.as_ref()).map(|run| &run.record.outputs);
    names.extend(
        outputs
            .into_iter()
            .flatten()
            .map(|output| output.node.artifact.clone()),
    );
    Ok(names)
}
