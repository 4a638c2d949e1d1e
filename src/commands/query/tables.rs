//! Tables under their names in queries.

use std::sync::Arc;

use datafusion::{
    arrow::{array::RecordBatch, datatypes::SchemaRef},
    catalog::TableProvider,
};
use lake::{Lake, TableFiles};

use super::{
    answer::Answer, artifacts, engine::Engine, faults, question::Question, scan::FileTable,
    source::Source,
};
use crate::outcome::CommandError;

/// Prefix of a table's name for the rows of all runs.
const ALL: &str = "all_";

/// The columns that are the same in every table.
pub(super) const RUN: &str = "run";
pub(super) const PIPELINE: &str = "pipeline";
pub(super) const STAGE: &str = "stage";
pub(super) const FINGERPRINT: &str = "fingerprint";

/// The tables that a query names, ready for it.
pub(super) struct Tables<'a> {
    source: Source<'a>,
    known: Vec<SchemaRef>,
    /// Tables with the number of their collected partitions.
    pub(super) collected: Vec<(String, usize)>,
    engine: Engine,
}

impl<'a> Tables<'a> {
    /// Opens the tables that a question names: exactly the files in the records, each of which is
    /// read once and checked against its digest.
    pub(super) fn open(source: Source<'a>, question: &Question) -> Result<Self, CommandError> {
        let mut tables = Self {
            source,
            known: Vec::new(),
            collected: Vec::new(),
            engine: Engine::new(),
        };
        let is_named = |name: &str| question.tables.contains(name);
        for name in tables.source.names()? {
            let name = name.as_str();
            if is_named(name) {
                let files = tables.source.newest(name)?;
                tables.note_collected(name, &files);
                if let Some(table) = artifacts::table(&files).map_err(failed)? {
                    tables.add(name, table)?;
                }
            }
            let all = format!("{ALL}{name}");
            if is_named(&all) {
                let files = tables.source.of_all_runs(name)?;
                tables.note_collected(&all, &files);
                if let Some(units) = tables.history("units")? {
                    let units = units.rows().map_err(failed)?;
                    let table = artifacts::of_all_runs(&files, name, &units).map_err(failed)?;
                    if let Some(table) = table {
                        tables.add(&all, table)?;
                    }
                }
            }
        }
        for name in Lake::history_tables() {
            if is_named(name)
                && let Some(table) = tables.history(name)?
            {
                tables.add(name, table)?;
            }
        }
        Ok(tables)
    }

    /// Opens a table of runs, if there are any.
    fn history(&mut self, name: &str) -> Result<Option<FileTable>, CommandError> {
        let files = self.source.history(name)?;
        if files.is_empty() {
            return Ok(None);
        }
        artifacts::history(files).map(Some).map_err(failed)
    }

    fn note_collected(&mut self, name: &str, files: &TableFiles) {
        if files.n_collected > 0 {
            self.collected.push((name.to_owned(), files.n_collected));
        }
    }

    /// Adds a table that the question names.
    pub(super) fn add(&mut self, name: &str, table: FileTable) -> Result<(), CommandError> {
        self.known.push(table.schema());
        self.engine.add(name, Arc::new(table)).map_err(failed)
    }

    /// Answers a question.
    pub(super) fn answer(mut self, question: Question) -> Result<RecordBatch, CommandError> {
        if question.lists_tables {
            return Answer::of_names(self.source.shown()).map_err(failed);
        }
        let answer = self.engine.answer(question.statement);
        let answer = answer.map_err(|err| faults::explain(&err, &mut self.source, &self.known))?;
        answer.named(&question.columns)
    }
}

fn failed(err: impl Into<anyhow::Error>) -> CommandError {
    CommandError::failed(err, None)
}
