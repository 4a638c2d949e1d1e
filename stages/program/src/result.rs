//! Output of a program, checked and stored in the form of this program.

use std::{collections::BTreeMap, path::Path};

use arrow_array::{Array, RecordBatch};
use arrow_schema::{DataType, Schema};
use dataflow::{Artifact, Inputs, PartitionKey};
use lake::LakeError;
use schemas::{
    Table,
    candidates::Candidates,
    rollouts::{Rollout, Rollouts},
};

use crate::{
    artifacts::KnownTable,
    columns::conformed,
    config::ProgramConfig,
    error::{ProgramError, TableFault},
    own_table, process,
};

/// Reads the table that a program wrote and checks it: its columns, its rows, and the rows against the inputs.
pub(crate) fn checked(
    config: &ProgramConfig,
    known: Option<&KnownTable>,
    schema: &Schema,
    inputs: &Inputs,
    key: &PartitionKey,
    path: &Path,
) -> Result<RecordBatch, ProgramError> {
    let file = lake::table::FILE;
    let version = schema.metadata().get("schema").cloned().unwrap_or_default();
    let broken = |source: TableFault| ProgramError::Table {
        command: process::words(config),
        file: file.to_owned(),
        schema: version.clone(),
        source: Box::new(source),
    };
    let written = Artifact {
        key: key.clone(),
        labels: BTreeMap::new(),
        files: BTreeMap::from([(file.to_owned(), path.to_owned())]),
    };
    let written = lake::table::read_batch(&written).map_err(|source| {
        let (command, file) = (process::words(config), file.to_owned());
        match source {
            LakeError::Compression { codec, .. } => ProgramError::Compression {
                command,
                file,
                codec,
            },
            source => ProgramError::Unreadable {
                command,
                file,
                source: Box::new(source),
            },
        }
    })?;
    let batch = conformed(&written, schema).map_err(&broken)?;
    if let Some(known) = known {
        let stored = (known.checked)(key.as_str(), &batch).map_err(|err| broken(err.into()))?;
        check_derived(&batch, &stored).map_err(&broken)?;
        (known.against)(inputs, key.as_str(), &stored).map_err(&broken)?;
        return Ok(stored);
    }
    if let Some((input, column)) = config.rows_of() {
        own_table::check_rows(inputs, input, column, &batch).map_err(|err| match err {
            ProgramError::TableFault(source) => broken(*source),
            err => err,
        })?;
    }
    Ok(batch)
}

/// Checks that the columns that follow from others, such as `success` from `reason`, are those that follow: the stored
/// ones are computed anew. Numbers may differ by rounding.
fn check_derived(written: &RecordBatch, stored: &RecordBatch) -> Result<(), TableFault> {
    for field in stored.schema_ref().fields() {
        let exact = matches!(
            field.data_type(),
            DataType::Utf8 | DataType::Boolean | DataType::Int64
        );
        let columns = (
            written.column_by_name(field.name()),
            stored.column_by_name(field.name()),
        );
        let (Some(written), Some(stored)) = columns else {
            continue;
        };
        // Rows of some artifacts are put in order.
        if !exact || written.len() != stored.len() {
            continue;
        }
        let differs =
            |&row: &usize| written.slice(row, 1).as_ref() != stored.slice(row, 1).as_ref();
        if let Some(row) = (0..written.len()).find(differs) {
            return Err(TableFault::NotDerived {
                column: field.name().clone(),
                row,
            });
        }
    }
    Ok(())
}

/// Checks that there is one rollout for each candidate that the unit reads, in their order, and that it states the
/// candidate's own source.
pub(crate) fn one_rollout_per_candidate(
    inputs: &Inputs,
    key: &str,
    batch: &RecordBatch,
) -> Result<(), TableFault> {
    let input = Candidates::NAME;
    let mut asked = Vec::new();
    let mut is_asked = false;
    for artifact in inputs.artifacts(input) {
        // An input of this name may be something else.
        if let Ok(candidates) = lake::table::read::<Candidates>(artifact) {
            is_asked = true;
            asked.extend(candidates.candidates);
        }
    }
    if !is_asked {
        return Ok(());
    }
    let made = Rollouts::from_batch(key, batch)?;
    let ids = |all: &mut dyn Iterator<Item = &String>| all.cloned().collect::<Vec<String>>();
    own_table::same_rows(
        "candidate_id",
        input,
        &ids(&mut asked.iter().map(|candidate| &candidate.candidate_id)),
        &ids(&mut made.iter().map(|rollout| &rollout.candidate_id)),
    )?;
    for (row, (rollout, candidate)) in made.iter().zip(&asked).enumerate() {
        let contradicts = |column: &str, found: String, expected: String| TableFault::Contradicts {
            column: column.to_owned(),
            row,
            found,
            expected,
            input: input.to_owned(),
        };
        if rollout.generator != candidate.generator {
            let (found, expected) = (rollout.generator.clone(), candidate.generator.clone());
            return Err(contradicts("generator", found, expected));
        }
        let (found, expected) = (&rollout.source, &candidate.source);
        if found != expected {
            let (column, found, expected) = if found.draw_n != expected.draw_n {
                (
                    "draw_n",
                    found.draw_n.to_string(),
                    expected.draw_n.to_string(),
                )
            } else if found.origin != expected.origin {
                (
                    "origin",
                    format!("{:?}", found.origin),
                    format!("{:?}", expected.origin),
                )
            } else if found.demonstration != expected.demonstration {
                (
                    "demonstration",
                    found.demonstration.clone(),
                    expected.demonstration.clone(),
                )
            } else {
                let split = |split| format!("{split:?}");
                (
                    "object_split",
                    split(found.object_split),
                    split(expected.object_split),
                )
            };
            return Err(contradicts(column, found, expected));
        }
    }
    Ok(())
}

/// Returns the number of rollouts that succeed, if the table is one of rollouts.
pub(crate) fn accepted_n(key: &str, batch: &RecordBatch) -> Option<usize> {
    let rollouts: Vec<Rollout> = Rollouts::from_batch(key, batch).ok()?;
    let verdicts = rollouts.iter().map(|rollout| rollout.verdict);
    Some(
        verdicts
            .filter(|verdict| *verdict == schemas::rollouts::Verdict::Held)
            .count(),
    )
}
