//! Options of `kind = "sample"`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Options of `kind = "sample"`.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SampleConfig {
    /// Which of the checkpoint's weights are used
    pub epoch: Epoch,
    /// Objects to draw motions for, by name; empty: all
    pub objects: Vec<String>,
    /// Motions per object; paper: 10000
    pub per_object: usize,
    /// Steps of each motion, at equal times, at least 2; paper: 40
    pub steps: usize,
    /// Time from the first step to the grasp, s
    pub duration_s: f64,
    /// Share of the motions whose latent code is drawn about a demonstration of the same object, in
    /// 0..=1, the others from the standard normal distribution; paper: 0
    pub demonstrated_share: f64,
    /// Factor on the standard deviation of what is drawn; paper: 1
    pub spread: f64,
    /// Which resting orientations the object is put in
    pub rests: Rests,
}

/// Which resting orientations an object is put in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Rests {
    /// Those of its demonstrations, as often as they were seen; the most probable one if there are
    /// none.
    Seen,
    /// Those that are stable, as probable as they are by the mesh.
    Stable,
}

/// Which of a checkpoint's weights are used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Epoch {
    /// Those with the least loss on held-out motions.
    Best,
    /// Those after the last epoch.
    Last,
}
