//! `checkpoint`: the trained grasping function, one partition.
//!
//! Two files: `checkpoint.safetensors` (weights, `f32`) and `checkpoint.json` (everything needed to
//! use them: widths, normalization, hand, joint names, training curve). `crates/cgf` reads and
//! writes both.

/// Bump on any change to the names or shapes of the tensors or to the JSON's keys.
pub const VERSION: &str = "checkpoint/1";

/// File name of the weights.
pub const WEIGHTS: &str = "checkpoint.safetensors";

/// File name of the description.
pub const DESCRIPTION: &str = "checkpoint.json";
