//! Options of `kind = "transfer"`.

use dataflow::{OptionFault, OptionFaults};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Most motions of one object.
const MAX_MOTIONS: usize = 100_000;

/// Options of `kind = "transfer"`.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TransferConfig {
    /// Demonstrations that are transferred to an object
    #[serde(default)]
    pub from: TransferSource,
    /// Objects that get motions, by name; empty: all
    #[serde(default)]
    pub objects: Vec<String>,
    /// Most motions per object: as many as of a function in the studies
    #[serde(default = "defaults::per_object")]
    pub per_object: usize,
}

/// Demonstrations that are transferred to an object.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(inline)]
pub enum TransferSource {
    /// Those of the other object whose box has the most similar sides.
    #[default]
    Nearest,
    /// Those of any other object, chosen at random.
    Other,
    /// The mean of the object's own, one for each resting orientation.
    Mean,
}

impl TransferConfig {
    /// Returns what is wrong with the options.
    pub(crate) fn faults(&self) -> Vec<OptionFault> {
        let mut faults = OptionFaults::default();
        let why = "each motion is simulated later";
        faults.within("per_object", self.per_object, 1..=MAX_MOTIONS, why);
        faults.found()
    }
}

/// Values of options that a pipeline file leaves out; the options say why.
#[rustfmt::skip]
mod defaults {
    pub(super) fn per_object() -> usize { 40 }
}
