//! `job.json`: description of a job for a program.

use std::collections::BTreeMap;

use dataflow::{Context, Labels};
use serde::Serialize;

use crate::{artifacts::KnownArtifact, config::ProgramConfig, own_table};

/// Paths of files by name, relative to the folder.
pub(crate) type JobFiles = BTreeMap<String, String>;

/// Description of a job for a program.
#[derive(Debug, Serialize)]
pub(crate) struct Job {
    /// Key of the partition to make.
    partition: String,
    /// Its name among several that are made of one; `null` if there are none.
    fan_out: Option<String>,
    /// Seed of everything random.
    seed: u64,
    /// The options of the pipeline file.
    options: serde_json::Map<String, serde_json::Value>,
    /// The files of the option `files`: a path each.
    pub(crate) files: JobFiles,
    /// The partitions of each input.
    pub(crate) inputs: BTreeMap<String, Vec<JobInput>>,
    /// The output to make.
    pub(crate) output: JobOutput,
}

/// One partition of an input.
#[derive(Debug, Serialize)]
pub(crate) struct JobInput {
    /// Its key.
    pub(crate) partition: String,
    /// Its labels, from the stage that made it.
    pub(crate) labels: Labels,
    /// Its files.
    pub(crate) files: JobFiles,
}

/// Description of the output to make.
#[derive(Debug, Serialize)]
pub(crate) struct JobOutput {
    /// The artifact.
    artifact: String,
    /// Name and version of its schema.
    schema: String,
    /// An empty table with its columns, if it is a table.
    pub(crate) template: Option<String>,
    /// Path to which its table is written.
    pub(crate) table: Option<String>,
    /// Files that it must have beside its table, in `out`.
    files: &'static [&'static str],
}

impl Job {
    /// Describes the output to make, without inputs yet.
    pub(crate) fn new(
        config: &ProgramConfig,
        known: Option<&KnownArtifact>,
        cx: &Context,
        fan_out: Option<&str>,
    ) -> Self {
        let schema = known.map(|known| known.schema.to_owned());
        Self {
            partition: cx.partition().to_string(),
            fan_out: fan_out.map(str::to_owned),
            seed: cx.seed(),
            options: config.options.clone(),
            files: JobFiles::new(),
            inputs: BTreeMap::new(),
            output: JobOutput {
                artifact: config.makes.clone(),
                schema: schema.unwrap_or_else(|| own_table::version(&config.makes)),
                template: None,
                table: None,
                files: known.map_or(&[], |known| known.files),
            },
        }
    }

    /// Returns the text. All its parts are texts, numbers and JSON, so this cannot fail.
    pub(crate) fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }
}
