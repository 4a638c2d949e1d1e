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
    /// Part of the machines, by the name that the scheduler gives it.
    pub partition: Option<String>,
    /// Account to which the time is charged.
    pub account: Option<String>,
    /// Quality of service.
    pub qos: Option<String>,
    /// Features that a machine must have, e.g. `a100`.
    pub constraint: Option<String>,
    /// Generic resources, e.g. `gpu:a100:1`.
    pub gres: Option<String>,
    /// Lines of a shell that load an environment before the unit is made, e.g. `module load cuda`.
    #[serde(default)]
    pub environment: Vec<String>,
}
