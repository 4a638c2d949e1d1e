//! `group`: the partitions with the same label become one table.

use std::collections::BTreeMap;

use dataflow::{
    BoxedDiagnostic, Context, Inputs, Line, Outcome, Output, Outputs, PartitionKey, Scope, Stage,
    Unit,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{bytes, hooks};

/// Counts the bytes of each group of partitions.
pub(crate) struct Group<const VERSION: u8>;

/// Options of `kind = "group"`.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct GroupConfig {
    /// Partitions with fewer bytes are not in the table.
    #[serde(default)]
    min_bytes: u64,
}

impl dataflow::Options for GroupConfig {}

impl<const VERSION: u8> Stage for Group<VERSION> {
    type Config = GroupConfig;

    const KIND: &'static str = "group";
    const ABOUT: &'static str = "Counts the bytes of the partitions of each group";
    const INPUTS: &'static [&'static str] = &["parts"];
    const OUTPUTS: Outputs<Self> = &[&Self];
}

impl<const VERSION: u8> Output for Group<VERSION> {
    type Stage = Self;
    type Metrics = ();
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = "groups";
    const SCHEMA: &'static str = "groups/1";
    const PARTITION: &'static str = "letter";
    const LINE: Option<Line<()>> = Some(|summary| format!("{} groups", summary.n_made));

    fn units(_config: &GroupConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let mut groups: BTreeMap<&str, Vec<&PartitionKey>> = BTreeMap::new();
        for part in scope.partitions("parts") {
            let group = part.label("group").unwrap_or("other");
            groups.entry(group).or_default().push(&part.key);
        }
        let units = groups.into_iter();
        Ok(units
            .map(|(group, keys)| Unit::new(group).reading("parts", keys))
            .collect())
    }

    fn make(
        config: &GroupConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<()>, BoxedDiagnostic> {
        hooks::started::<Self>(cx)?;
        let mut tallies = Vec::new();
        for part in inputs.artifacts("parts") {
            let tally = bytes::tally(part)?;
            if tally.bytes >= config.min_bytes {
                tallies.push(tally);
            }
        }
        bytes::write_table(cx.folder(), &tallies)?;
        Ok(Outcome::Made(()))
    }
}
