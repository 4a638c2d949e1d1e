//! `group`: the partitions with the same label become one table.

use std::collections::BTreeMap;

use dataflow::{Code, Context, Input, Inputs, Made, Outcome, Output, Scope, Stage, Summary, Unit};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{OwnError, bytes, code, hooks};

/// Counts the bytes of each group of partitions.
pub(crate) enum Group<const VERSION: u8> {}

/// Options of `kind = "group"`.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct GroupConfig {
    /// Partitions with fewer bytes are not in the table.
    #[serde(default)]
    min_bytes: u64,
}

impl<const VERSION: u8> Stage for Group<VERSION> {
    type Config = GroupConfig;
    type Error = OwnError;

    const KIND: &'static str = "group";
    const ABOUT: &'static str = "Counts the bytes of the partitions of each group";
    const CODE: Code = code(VERSION);
    const INPUTS: &'static [Input] = &[Input {
        name: "parts",
        artifact: "parts",
    }];
    const OUTPUTS: &'static [Output] = &[Output {
        artifact: "groups",
        schema: "groups/1",
        partition: "letter",
        parallel: true,
    }];

    fn units(_config: &GroupConfig, _output: &str, scope: &Scope) -> Result<Vec<Unit>, OwnError> {
        let mut groups: BTreeMap<&str, Vec<&String>> = BTreeMap::new();
        for part in scope.partitions("parts") {
            let group = part.label("group").unwrap_or("other");
            groups.entry(group).or_default().push(&part.key);
        }
        let units = groups.into_iter();
        Ok(units
            .map(|(group, keys)| Unit::new(group).reading("parts", keys))
            .collect())
    }

    fn run(config: &GroupConfig, inputs: &Inputs, cx: &Context) -> Result<Outcome, OwnError> {
        hooks::started(Self::KIND, cx)?;
        let mut tallies = Vec::new();
        for part in inputs.artifacts("parts") {
            let tally = bytes::tally(part)?;
            if tally.bytes >= config.min_bytes {
                tallies.push(tally);
            }
        }
        bytes::write_table(cx.folder(), &tallies)?;
        Ok(Outcome::Made(Made::default()))
    }

    fn describe(_output: &str, summary: &Summary) -> String {
        format!("{} groups", summary.n_made)
    }
}
