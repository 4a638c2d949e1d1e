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
    /// The physical scene.
    pub scene: SceneConfig,
    /// What is done with a motion, and what counts as success.
    pub protocol: Protocol,
}
