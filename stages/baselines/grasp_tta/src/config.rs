//! Options of `kind = "grasp_tta"`.

use std::path::PathBuf;

use approach::ApproachConfig;
use cgf::grasp_tta::{AdaptationConfig, GraspNetworkConfig, GraspTrainingConfig, TermWeights};
use options::{OptionFaults, options};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Most grasps of one object.
const MAX_GRASPS: usize = 100_000;
/// Fewest and most points of the hand's surface.
const MIN_HAND_POINTS: usize = 32;
const MAX_HAND_POINTS: usize = 100_000;

/// Options of `kind = "grasp_tta"`.
#[options(also = Self::combined_faults)]
pub struct GraspTtaConfig {
    /// File of the robot hand, or its URDF alone; the root link is the palm
    #[option(path)]
    pub hand: PathBuf,
    /// Names of the joints that bend the fingers, each with growing positions
    pub flexion_joints: Vec<String>,
    /// Objects to grasp, by name; empty: all
    #[option(default)]
    pub objects: Vec<String>,
    /// Objects whose demonstrations are not learned from, by name
    #[option(default)]
    pub unseen_objects: Vec<String>,
    /// Grasps per object: the published number
    #[option(default = 200, range = 1..=MAX_GRASPS, why = "each is adapted and simulated")]
    pub per_object: usize,
    /// Points on the hand's surface: about as many as the published hand has vertices
    #[option(
        default = 800, range = MIN_HAND_POINTS..=MAX_HAND_POINTS,
        why = "each is compared with every point of the object"
    )]
    pub hand_points: usize,
    /// Shapes of the networks
    #[option(default, table)]
    pub network: GraspNetworkConfig,
    /// Training of the networks
    #[option(default, table)]
    pub training: GraspTrainingConfig,
    /// Weights of the terms of a grasp's loss
    #[option(default, table)]
    pub terms: TermWeights,
    /// Test-time adaptation of a grasp
    #[option(default, table)]
    pub adaptation: AdaptationConfig,
    /// Whether fingers close on the object after the adaptation: they do not, as published
    #[option(default)]
    pub finish: Finish,
    /// The way to the grasp, and how the object lies
    #[option(default, table)]
    pub approach: ApproachConfig,
}

/// Last step of a grasp, after the adaptation.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(inline)]
pub enum Finish {
    /// Nothing.
    #[default]
    Adapted,
    /// Its fingers close joint by joint until they touch, as those of the other generators of grasps do.
    Closed,
}

impl GraspTtaConfig {
    fn combined_faults(&self, faults: &mut OptionFaults) {
        if self.flexion_joints.is_empty() {
            faults.note(
                "flexion_joints",
                "is empty, and hands touch with what they bend",
            );
        }
    }
}
