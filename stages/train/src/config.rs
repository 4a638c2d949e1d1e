//! Options of `kind = "train"`.

use std::path::PathBuf;

use cgf::{NetworkConfig, TrainingConfig};
use folds::UnseenObjects;
use options::{OptionFaults, Options, options};

/// Largest number of accepted motions of an object that are learned from.
const MAX_ACCEPTED_PER_OBJECT: usize = 10_000;

/// Options of `kind = "train"`.
#[options(also = Self::memory_faults)]
pub struct TrainConfig {
    /// File, or URDF, of the robot hand of the trajectories
    #[option(path)]
    pub hand: PathBuf,
    /// Objects to train on, by name; empty: all
    #[option(default)]
    pub objects: Vec<String>,
    /// The objects that nothing is learned from
    #[option(flatten)]
    pub unseen: UnseenObjects,
    /// Share of the other trajectories that are held out for validation, in 0..1: enough to tell learning from
    /// memorizing; if the training goes on from another function, of those that are new to it
    #[option(default = 0.1, range = 0.0..1.0, why = "it is a share")]
    pub held_out_share: f64,
    /// Accepted motions of each object that is not unseen, the first ones, that are learned from beside its
    /// trajectories where `inputs.candidates` and `inputs.rollouts` are wired (24): about as many as a dataset has
    /// demonstrations
    #[option(default = 24, range = 0..=MAX_ACCEPTED_PER_OBJECT, why = "all of them are in memory")]
    pub accepted_per_object: usize,
    /// Widths and shapes of the network
    #[option(default, table)]
    pub network: NetworkConfig,
    /// Options of the training
    #[option(table)]
    pub training: TrainingConfig,
}

impl TrainConfig {
    fn memory_faults(&self, faults: &mut OptionFaults) {
        if self.network.check().is_ok() && self.training.check().is_ok() {
            let memory = self.training.check_memory(&self.network);
            faults.of_table("training", memory.err());
        }
    }

    /// Says whether trajectories of this object are read.
    pub(crate) fn takes(&self, object: &str) -> bool {
        let mut named = self.objects.iter().chain(&self.unseen.unseen_objects);
        self.objects.is_empty() || named.any(|name| name == object)
    }
}
