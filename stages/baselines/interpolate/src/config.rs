//! Options of `kind = "interpolate"`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Options of `kind = "interpolate"`.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InterpolateConfig {
    /// Objects whose motions are replaced, by name; empty: all
    #[serde(default)]
    pub objects: Vec<String>,
}
