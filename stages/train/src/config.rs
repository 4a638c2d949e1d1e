//! Options of `kind = "train"`.

use std::path::PathBuf;

use cgf::{CgfError, NetworkConfig, TrainingConfig};
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
    /// Objects whose trajectories are not learned from, by name, to be unseen in sampling
    pub unseen_objects: Vec<String>,
    /// Share of the other trajectories that are not learned from but measured with, in 0..1
    pub held_out_share: f64,
    /// Widths and shapes of the network
    pub network: NetworkConfig,
    /// How it is trained
    pub training: TrainingConfig,
}

impl TrainConfig {
    /// Checks every value but the hand.
    pub(crate) fn check(&self) -> Result<(), CgfError> {
        self.network.check()?;
        self.training.check()?;
        if (0.0..1.0).contains(&self.held_out_share) {
            Ok(())
        } else {
            Err(CgfError::Config {
                key: "held_out_share",
                value: self.held_out_share.to_string(),
                expected: "from 0 to below 1",
            })
        }
    }

    /// Says whether trajectories of this object are read.
    pub(crate) fn takes(&self, object: &str) -> bool {
        self.objects.is_empty() || named(&self.objects, object) || self.is_unseen(object)
    }

    /// Says whether trajectories of this object are kept back.
    pub(crate) fn is_unseen(&self, object: &str) -> bool {
        named(&self.unseen_objects, object)
    }
}

fn named(names: &[String], object: &str) -> bool {
    names.iter().any(|name| name == object)
}
