//! Resources that the units of a stage need.

use serde::{Deserialize, Serialize};

/// Resources that one unit of a stage needs: `resources` in its table. They are requested only from schedulers; no
/// result depends on them.
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
