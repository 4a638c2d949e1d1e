//! `grasp_networks`: what grasp synthesis with test-time adaptation learned, one partition.
//!
//! Two files: weights (safetensors, `f32`) of the generator of grasps and of the contact network, and everything needed
//! to use them (JSON: widths, normalization, joint names, training curves). `crates/cgf` reads and writes both.

/// Bump on any change to the names or shapes of the tensors or to the JSON's keys.
pub const VERSION: &str = "grasp_networks/1";
/// Name of the artifact.
pub const NAME: &str = "grasp_networks";
/// What one partition stands for.
pub const PARTITION: &str = "model";

/// The weights.
pub const WEIGHTS: &str = "networks.safetensors";
/// Everything else.
pub const DESCRIPTION: &str = "networks.json";
