//! Options of `kind = "screen"`.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use simulation::{Protocol, SceneConfig};

/// Options of `kind = "screen"`.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScreenConfig {
    /// URDF of the robot hand; its root link is the palm.
    #[serde(skip_serializing)]
    pub hand: PathBuf,
    /// Accepted rollouts per object that are recorded for a viewer (1).
    pub recorded_per_object: usize,
    /// By how much the object's place is mistaken, for a study: each motion is carried out as if the
    /// object were shifted by normally distributed lengths, whose deviation along each axis of the
    /// object is this share of its extent there (0); paper: 0 to 0.1
    #[serde(default)]
    pub pose_noise: f64,
    /// The physical scene.
    pub scene: SceneConfig,
    /// What is done with a motion, and what counts as success.
    pub protocol: Protocol,
}
