//! Options of `kind = "train"`.

use std::path::PathBuf;

use cgf::{NetworkConfig, TrainingConfig};
use dataflow::{OptionFault, OptionFaults};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::unseen::Fold;

/// Largest number of accepted motions of an object that are learned from.
const MAX_ACCEPTED_PER_OBJECT: usize = 10_000;

/// Options of `kind = "train"`.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// File, or URDF, of the robot hand of the trajectories
    #[serde(skip_serializing)]
    pub hand: PathBuf,
    /// Objects to train on, by name; empty: all
    #[serde(default)]
    pub objects: Vec<String>,
    /// Objects excluded from training, by name, to be unseen in sampling
    #[serde(default)]
    pub unseen_objects: Vec<String>,
    /// Fold of the objects that is excluded too, e.g. `2/4`: every fourth by name, from the second; with
    /// `--set train.unseen_fold=1/4,2/4,3/4,4/4`, every object is unseen once
    #[serde(default)]
    pub unseen_fold: Option<Fold>,
    /// Share of the other trajectories that are held out for validation, in 0..1: enough to tell
    /// learning from memorizing
    #[serde(default = "defaults::held_out_share")]
    pub held_out_share: f64,
    /// Accepted motions of each object that is not unseen, the first ones, that are learned from beside its
    /// trajectories where `inputs.candidates` and `inputs.rollouts` are wired (24): about as many as a dataset has
    /// demonstrations
    #[serde(default = "defaults::accepted_per_object")]
    pub accepted_per_object: usize,
    /// Widths and shapes of the network
    #[serde(default)]
    pub network: NetworkConfig,
    /// Options of the training
    pub training: TrainingConfig,
}

impl TrainConfig {
    /// Returns what is wrong with every value but the hand.
    pub(crate) fn faults(&self) -> Vec<OptionFault> {
        let mut faults = OptionFaults::default();
        let share = self.held_out_share;
        if !(0.0..1.0).contains(&share) {
            let problem = format!("is {share:?}, and must be from 0 to below 1: it is a share");
            faults.note("held_out_share", problem);
        }
        let accepted = self.accepted_per_object;
        if accepted > MAX_ACCEPTED_PER_OBJECT {
            let problem = format!(
                "is {accepted}, and must be at most {MAX_ACCEPTED_PER_OBJECT}: all of them are in memory"
            );
            faults.note("accepted_per_object", problem);
        }
        let network = self.network.check();
        let training = self.training.check();
        let memory = match (&network, &training) {
            (Ok(()), Ok(())) => self.training.check_memory(&self.network),
            _ => Ok(()),
        };
        for (table, checked) in [
            ("network", network),
            ("training", training),
            ("training", memory),
        ] {
            faults.of_table(table, checked.err().into_iter().collect());
        }
        faults.found()
    }

    /// Says whether trajectories of this object are read.
    pub(crate) fn takes(&self, object: &str) -> bool {
        let mut named = self.objects.iter().chain(&self.unseen_objects);
        self.objects.is_empty() || named.any(|name| name == object)
    }
}

/// Values of options that a pipeline file leaves out; the options say why.
#[rustfmt::skip]
mod defaults {
    pub(super) fn held_out_share() -> f64 { 0.1 }
    pub(super) fn accepted_per_object() -> usize { 24 }
}
