//! `map`: each partition becomes one.

use dataflow::{
    BoxedDiagnostic, Context, Inputs, Line, Outcome, Output, Outputs, Scope, Stage, Unit,
};
use lake::ReadInputs;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    bytes::{self, Bytes, Change},
    hooks,
};

/// Changes the bytes of each partition.
pub(crate) struct Map<const VERSION: u8>;

/// Options of `kind = "map"`.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct MapConfig {
    /// Added to every byte; the second version of this stage adds one more.
    #[serde(default)]
    add: u8,
    /// Every byte is divided by this and the remainder is kept; 0 keeps the byte.
    #[serde(default)]
    modulo: u8,
    /// Whether each partition has a table beside its bytes.
    #[serde(default)]
    table: bool,
    /// Whether each partition has a chart beside its bytes.
    #[serde(default)]
    chart: bool,
}

impl dataflow::Options for MapConfig {}

impl<const VERSION: u8> Stage for Map<VERSION> {
    type Config = MapConfig;

    const KIND: &'static str = "map";
    const ABOUT: &'static str = "Changes the bytes of each partition";
    const INPUTS: &'static [&'static str] = &["parts"];
    const OUTPUTS: Outputs<Self> = &[&Self];
}

impl<const VERSION: u8> Output for Map<VERSION> {
    type Stage = Self;
    type Metrics = Bytes;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = "parts";
    const SCHEMA: &'static str = "parts/1";
    const PARTITION: &'static str = "part";
    const LINE: Option<Line<Bytes>> = Some(|summary| format!("{} parts mapped", summary.n_made));

    fn units(_config: &MapConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let parts = scope.partitions("parts").iter();
        Ok(parts
            .map(|part| {
                Unit::new(&part.key)
                    .with_label_of("group", part)
                    .reading("parts", [&part.key])
            })
            .collect())
    }

    fn make(
        config: &MapConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<Bytes>, BoxedDiagnostic> {
        hooks::started::<Self>(cx)?;
        let part = inputs.artifact("parts")?;
        let change = Change {
            add: config.add.wrapping_add(VERSION - 1),
            modulo: config.modulo,
        };
        let data = bytes::data(part)?;
        let tally = bytes::write_changed(cx.partition().as_str(), data, change, cx.folder())?;
        if config.chart {
            let chart = format!("<svg><title>{} bytes</title></svg>\n", tally.bytes);
            lake::write_atomic(&cx.folder().join("bytes.svg"), chart.as_bytes())?;
        }
        let metrics = tally.metrics();
        if config.table {
            bytes::write_table(cx.folder(), &[tally])?;
        }
        Ok(Outcome::Made(metrics))
    }
}
