//! `checkpoint`: the trained grasping function, one partition.
//!
//! Two files each of the best and of the last epoch: weights (safetensors, `f32`) and everything
//! needed to use them (JSON: widths, normalization, hand, joint names, the objects learned from, latent
//! codes, training curve, sources and terms of the data). `crates/learning/cgf` reads and writes both.

/// Bump on any change to the names or shapes of the tensors or to the JSON's keys.
pub const VERSION: &str = "checkpoint/5";
/// Name of the artifact.
pub const NAME: &str = "checkpoint";
/// Kind of item that one partition holds.
pub const PARTITION: &str = "model";

/// File names of the weights and of their description.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Files {
    /// The weights.
    pub weights: &'static str,
    /// Everything else.
    pub description: &'static str,
}

/// After the epoch with the lowest loss on held-out motions.
pub const BEST: Files = Files {
    weights: "best.safetensors",
    description: "best.json",
};

/// After the last epoch.
pub const LAST: Files = Files {
    weights: "last.safetensors",
    description: "last.json",
};
