//! Options of `kind = "replay"`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Options of `kind = "replay"`.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReplayConfig {
    /// Objects whose trajectories are offered, by name; empty: all
    #[serde(default)]
    pub objects: Vec<String>,
}
