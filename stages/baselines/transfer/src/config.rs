//! Options of `kind = "transfer"`.

use folds::UnseenObjects;
use options::options;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Most motions of one object.
const MAX_MOTIONS: usize = 100_000;

/// Options of `kind = "transfer"`.
#[options]
pub struct TransferConfig {
    /// Demonstrations that are transferred to an object
    #[option(default)]
    pub from: TransferSource,
    /// The objects whose demonstrations are not transferred, as in `train`
    #[option(flatten)]
    pub unseen: UnseenObjects,
    /// Objects that get motions, by name; empty: all
    #[option(default)]
    pub objects: Vec<String>,
    /// Most motions per object: as many as of a function in the studies
    #[option(default = 40, range = 1..=MAX_MOTIONS, why = "each motion is simulated later")]
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
