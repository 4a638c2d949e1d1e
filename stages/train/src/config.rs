//! Options of `kind = "train"`.

use std::path::PathBuf;

use cgf::{NetworkConfig, TrainingConfig};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Options of `kind = "train"`.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// URDF of the robot hand of the trajectories
    #[serde(skip_serializing)]
    pub hand: PathBuf,
    /// Objects whose trajectories are learned from, by name; empty: all
    pub objects: Vec<String>,
    /// Objects whose trajectories are left out, by name, to be unseen in sampling
    pub held_out_objects: Vec<String>,
    /// Widths and shapes of the network
    pub network: NetworkConfig,
    /// How it is trained
    pub training: TrainingConfig,
}

impl TrainConfig {
    /// Says whether trajectories of this object are learned from.
    pub(crate) fn takes(&self, object: &str) -> bool {
        let named = |names: &[String]| names.iter().any(|name| name == object);
        (self.objects.is_empty() || named(&self.objects)) && !named(&self.held_out_objects)
    }
}
