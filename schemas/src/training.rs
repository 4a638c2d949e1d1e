//! `training`: how a training went, one partition per model, one row per epoch and set of motions that
//! was measured in it.
//!
//! Losses are means over motions, before they are weighted; `total` is the weighted sum of those before
//! `prior`. `training` is as the motions were seen, turned and with noise; the others as they were
//! recorded, after the epoch, decoded from their mean codes.

use serde::{Deserialize, Serialize};

use crate::{
    columns::{columns, words},
    table::table,
};

columns! {
    /// The losses of one set of motions in one epoch.
    #[derive(Debug, Clone, PartialEq)]
    pub struct EpochLosses {
        epoch: i64 => "number of the epoch, from 1",
        split: Split => "training, held_out or unseen",
        learning_rate: f64 ["1"] => "the optimizer's",
        total: f64 ["1"] => "weighted sum of the losses",
        q: f64 ["1"] => "squared errors of the outputs, in the network's units",
        translation: f64 ["1"] => "the part of q that is the translation's",
        origins_m2: f64 ["m²"] => "squared distances of the links' origins",
        rotations: f64 ["1"] => "squared errors of two columns of the links' rotations",
        kl_nats: f64 ["nat"] => "divergence of the latent codes from the standard normal",
        contact_m2: f64 ["m²"] => "squared distances of the finger tips from contact",
        penetration_m2: f64 ["m²"] => "squared depths of the links in object and table",
        coarse: f64 ["1"] => "squared errors of the first decoder's grasp, in the network's units; 0 without a second decoder",
        prior: Option<f64> ["1"] => "squared errors of the flow's velocity, not in total; null without a flow, and for motions not learned from",
    }
}

/// The losses of one training.
pub type Training = Vec<EpochLosses>;
table! {"training", 3, per "model", rows: EpochLosses}

words! {
    /// Whether a motion is learned from, or what it is kept back for.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum Split: "split" {
        /// It is learned from.
        Training = "training",
        /// It is kept back; other motions with its object are learned from.
        HeldOut = "held_out",
        /// It is kept back with all motions of its object.
        Unseen = "unseen",
    }
}
