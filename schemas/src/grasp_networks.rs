//! `grasp_networks`: trained networks of grasp synthesis with test-time adaptation, one partition.
//!
//! Two files: weights (safetensors, `f32`) of the generator of grasps and of the contact network, and everything needed
//! to use them (JSON: widths, normalization, joint names, training curves). `crates/learning/cgf` reads and writes both.

/// Bump on any change to the names or shapes of the tensors or to the JSON's keys.
pub const VERSION: &str = "grasp_networks/1";
/// Name of the artifact.
pub const NAME: &str = "grasp_networks";
/// Kind of item that one partition holds.
pub const PARTITION: &str = "model";

/// The weights.
pub const WEIGHTS: &str = "networks.safetensors";
/// Everything else.
pub const DESCRIPTION: &str = "networks.json";
