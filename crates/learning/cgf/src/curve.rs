//! Learning curve: losses by epoch.

use schemas::training::Split;
use serde::{Deserialize, Serialize};

use crate::Losses;

/// One pass over the motions that are learned from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Epoch {
    /// Its number, from 1.
    pub epoch: usize,
    /// Adam's learning rate.
    pub learning_rate: f64,
    /// Losses of the motions that were learned from, turned and with noise as they were seen.
    pub training: Losses,
    /// Losses of the held-out motions after the epoch, as recorded, decoded from their mean codes; none
    /// if they were not measured.
    pub held_out: Option<Losses>,
    /// The same of motions with unseen objects.
    pub unseen: Option<Losses>,
}

impl Epoch {
    /// Returns the losses of a split; `None` if they were not measured.
    pub fn losses(&self, split: Split) -> Option<&Losses> {
        match split {
            Split::Training => Some(&self.training),
            Split::HeldOut => self.held_out.as_ref(),
            Split::Unseen => self.unseen.as_ref(),
        }
    }
}
