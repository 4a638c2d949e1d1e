//! Two stages that take time: one makes parts, the other makes one of each.

use std::time::Duration;

use dataflow::{
    BoxedDiagnostic, Code, Context, Inputs, Kind, Line, Outcome, Output, Outputs, Scope, Stage,
    Unit,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::seen::Seen;

/// Longest time of a unit.
const LONGEST_MS: u64 = 20_000;

/// Name of the file of a part.
const DATA: &str = "data.bin";

/// Options of both kinds.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Config {
    /// The history.
    seed: u64,
    /// Number of parts, of the first.
    #[serde(default)]
    n_units: usize,
}

impl dataflow::Options for Config {}

/// A stage: the first makes parts.
struct Makes<const IS_FIRST: bool>;

impl<const IS_FIRST: bool> Stage for Makes<IS_FIRST> {
    type Config = Config;

    const KIND: &'static str = if IS_FIRST { "first" } else { "second" };
    const ABOUT: &'static str = "Takes time";
    const INPUTS: &'static [&'static str] = if IS_FIRST { &[] } else { &["parts"] };
    const OUTPUTS: Outputs<Self> = &[&Self];
}

impl<const IS_FIRST: bool> Output for Makes<IS_FIRST> {
    type Stage = Self;
    type Metrics = ();
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = "parts";
    const SCHEMA: &'static str = "parts/1";
    const PARTITION: &'static str = "part";
    const LINE: Option<Line<()>> = Some(|summary| format!("{} parts", summary.n_made));

    fn units(config: &Config, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let first = (0..config.n_units).map(|number| Unit::new(format!("p{number}")));
        if IS_FIRST {
            return Ok(first.collect());
        }
        let parts = scope.partitions("parts").iter();
        Ok(parts
            .map(|part| Unit::new(&part.key).reading("parts", [&part.key]))
            .collect())
    }

    fn make(config: &Config, _: &Inputs, cx: &Context) -> Result<Outcome<()>, BoxedDiagnostic> {
        let unit = format!("{}/{}", Self::KIND, cx.partition());
        let seen = Seen::of(config.seed);
        seen.begun(&unit);
        clock::sleep(Duration::from_millis(cx.seed() % LONGEST_MS));
        lake::write_atomic(&cx.folder().join(DATA), unit.as_bytes())?;
        seen.finished(&unit);
        Ok(Outcome::Made(()))
    }
}

pub(super) fn kinds() -> Vec<Kind> {
    let code = Code {
        parts: "simulation=1",
    };
    vec![
        Kind::of::<Makes<true>>(code),
        Kind::of::<Makes<false>>(code),
    ]
}
