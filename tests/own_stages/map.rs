//! `map`: each partition becomes one.

use std::collections::BTreeMap;

use dataflow::{
    Code, Context, Input, Inputs, Labels, Made, Outcome, Output, Scope, Stage, Summary, Unit,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    OwnError,
    bytes::{self, Change},
    code, hooks,
};

/// Changes the bytes of each partition.
pub(crate) enum Map<const VERSION: u8> {}

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

impl<const VERSION: u8> Stage for Map<VERSION> {
    type Config = MapConfig;
    type Error = OwnError;

    const KIND: &'static str = "map";
    const ABOUT: &'static str = "Changes the bytes of each partition";
    const CODE: Code = code(VERSION);
    const INPUTS: &'static [Input] = &[Input {
        name: "parts",
        artifact: "parts",
    }];
    const OUTPUTS: &'static [Output] = &[Output {
        artifact: "parts",
        schema: "parts/1",
        partition: "part",
        parallel: true,
    }];

    fn units(_config: &MapConfig, _output: &str, scope: &Scope) -> Result<Vec<Unit>, OwnError> {
        let parts = scope.partitions("parts").iter();
        Ok(parts
            .map(|part| Unit::new(&part.key).reading("parts", [&part.key]))
            .collect())
    }

    fn foretell(_config: &MapConfig, _output: &str, unit: &Unit, scope: &Scope) -> Option<Labels> {
        let parts = scope.partitions("parts");
        let place = parts.binary_search_by(|part| part.key.cmp(&unit.partition));
        // A part has no other label, and passes it on.
        let group = parts.get(place.ok()?)?.label("group")?;
        Some(Labels::from([("group".to_owned(), group.to_owned())]))
    }

    fn run(config: &MapConfig, inputs: &Inputs, cx: &Context) -> Result<Outcome, OwnError> {
        hooks::started(Self::KIND, cx)?;
        let mut made = Made::default();
        for part in inputs.artifacts("parts") {
            let change = Change {
                add: config.add.wrapping_add(VERSION - 1),
                modulo: config.modulo,
            };
            let data = bytes::data(part)?;
            let tally = bytes::write_changed(cx.partition(), data, change, cx.folder())?;
            made.labels.clone_from(&part.labels);
            made.metrics = BTreeMap::from([("bytes".to_owned(), tally.bytes as f64)]);
            if config.chart {
                let chart = format!("<svg><title>{} bytes</title></svg>\n", tally.bytes);
                lake::write_whole(&cx.folder().join("bytes.svg"), chart.as_bytes())?;
            }
            if config.table {
                bytes::write_table(cx.folder(), &[tally])?;
            }
        }
        Ok(Outcome::Made(made))
    }

    fn describe(_output: &str, summary: &Summary) -> String {
        format!("{} parts mapped", summary.n_made)
    }
}
