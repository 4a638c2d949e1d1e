//! What a stage's units need of the machine that makes them.

use serde::{Deserialize, Serialize};

/// What one unit of a stage needs of the machine that makes it: `resources` in its table. Only machines
/// that a scheduler chooses are asked for it; no result depends on it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Resources {
    /// Processor cores.
    pub cores: Option<u32>,
    /// Memory in gigabytes.
    pub memory_gb: Option<u32>,
    /// Graphics processors.
    pub gpus: Option<u32>,
    /// Time for one unit in minutes.
    pub time_min: Option<u32>,
}
