//! `gather`: all partitions become one table.

use dataflow::{
    BoxedDiagnostic, Context, Inputs, Line, Outcome, Output, Outputs, Scope, Stage, Unit,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{bytes, hooks};

/// Counts the bytes of all partitions.
pub(crate) struct Gather<const VERSION: u8>;

/// Options of `kind = "gather"`.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct GatherConfig {
    /// Partitions with fewer bytes are not in the table.
    #[serde(default)]
    min_bytes: u64,
}

impl dataflow::Options for GatherConfig {}

impl<const VERSION: u8> Stage for Gather<VERSION> {
    type Config = GatherConfig;

    const KIND: &'static str = "gather";
    const ABOUT: &'static str = "Counts the bytes of all partitions";
    const INPUTS: &'static [&'static str] = &["parts"];
    const OUTPUTS: Outputs<Self> = &[&Self];
}

impl<const VERSION: u8> Output for Gather<VERSION> {
    type Stage = Self;
    type Metrics = ();
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = "whole";
    const SCHEMA: &'static str = "whole/1";
    const PARTITION: &'static str = "of";
    const LINE: Option<Line<()>> = Some(|summary| format!("{} table of all parts", summary.n_made));

    fn units(_config: &GatherConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let keys = scope.partitions("parts").iter().map(|part| &part.key);
        // Whether the parts have tables, and their labels, makes no difference here.
        let unit = Unit::new("all")
            .reading("parts", keys)
            .only_files("parts", [bytes::DATA]);
        Ok(vec![unit])
    }

    fn make(
        config: &GatherConfig,
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
