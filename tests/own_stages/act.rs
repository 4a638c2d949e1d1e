//! `act`: what must not be done twice, as moving a robot.

use dataflow::{
    BoxedDiagnostic, Context, Execution, Inputs, Line, Outcome, Output, Outputs, Scope, Stage, Unit,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::hooks;

/// Acts once for each partition.
pub(crate) struct Act;

/// Options of `kind = "act"`.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct ActConfig {}

impl dataflow::Options for ActConfig {}

impl Stage for Act {
    type Config = ActConfig;

    const KIND: &'static str = "act";
    const ABOUT: &'static str = "Acts once for each partition";
    const INPUTS: &'static [&'static str] = &["parts"];
    const OUTPUTS: Outputs<Self> = &[&Self];
}

impl Output for Act {
    type Stage = Self;
    type Metrics = ();
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = "acts";
    const SCHEMA: &'static str = "acts/1";
    const PARTITION: &'static str = "part";
    const EXECUTION: Execution = Execution::Physical;
    const LINE: Option<Line<()>> = Some(|summary| format!("{} acts", summary.n_made));

    fn units(_config: &ActConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let parts = scope.partitions("parts").iter();
        let units = parts.map(|part| Unit::new(&part.key).reading("parts", [&part.key]));
        Ok(units.collect())
    }

    fn make(
        _config: &ActConfig,
        _inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<()>, BoxedDiagnostic> {
        hooks::started::<Self>(cx)?;
        hooks::fail("acting")?;
        lake::write_atomic(&cx.folder().join("acted"), b"acted")?;
        Ok(Outcome::Made(()))
    }
}
