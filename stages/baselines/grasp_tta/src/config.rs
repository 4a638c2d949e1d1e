//! Options of `kind = "grasp_tta"`.

use std::path::PathBuf;

use approach::ApproachConfig;
use cgf::grasp_tta::{AdaptationConfig, GraspNetworkConfig, GraspTrainingConfig, TermWeights};
use dataflow::{OptionFault, OptionFaults};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Most grasps of one object.
const MAX_GRASPS: usize = 100_000;
/// Fewest and most points of the hand's surface.
const MIN_HAND_POINTS: usize = 32;
const MAX_HAND_POINTS: usize = 100_000;

/// Options of `kind = "grasp_tta"`.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GraspTtaConfig {
    /// File of the robot hand, or its URDF alone; the root link is the palm
    #[serde(skip_serializing)]
    pub hand: PathBuf,
    /// Names of the joints that bend the fingers, each with growing positions
    pub flexion_joints: Vec<String>,
    /// Objects to grasp, by name; empty: all
    #[serde(default)]
    pub objects: Vec<String>,
    /// Objects whose demonstrations are not learned from, by name
    #[serde(default)]
    pub unseen_objects: Vec<String>,
    /// Grasps per object: the published number
    #[serde(default = "defaults::per_object")]
    pub per_object: usize,
    /// Points on the hand's surface: about as many as the published hand has vertices
    #[serde(default = "defaults::hand_points")]
    pub hand_points: usize,
    /// Shapes of the networks
    #[serde(default)]
    pub network: GraspNetworkConfig,
    /// Training of the networks
    #[serde(default)]
    pub training: GraspTrainingConfig,
    /// Weights of the terms of a grasp's loss
    #[serde(default)]
    pub terms: TermWeights,
    /// Test-time adaptation of a grasp
    #[serde(default)]
    pub adaptation: AdaptationConfig,
    /// Whether fingers close on the object after the adaptation: they do not, as published
    #[serde(default)]
    pub finish: Finish,
    /// The way to the grasp, and how the object lies
    #[serde(default)]
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
    /// Returns the faults of the options beyond their types.
    pub(crate) fn faults(&self) -> Vec<OptionFault> {
        let mut faults = OptionFaults::default();
        let why = "each is adapted and simulated";
        faults.within("per_object", self.per_object, 1..=MAX_GRASPS, why);
        let why = "each is compared with every point of the object";
        let bounds = MIN_HAND_POINTS..=MAX_HAND_POINTS;
        faults.within("hand_points", self.hand_points, bounds, why);
        if self.flexion_joints.is_empty() {
            faults.note(
                "flexion_joints",
                "is empty, and hands touch with what they bend",
            );
        }
        for (table, checked) in [
            ("network", self.network.check()),
            ("training", self.training.check()),
            ("terms", self.terms.check()),
            ("adaptation", self.adaptation.check()),
        ] {
            faults.of_table(table, checked.err().into_iter().collect());
        }
        faults.of_table("approach", self.approach.faults());
        faults.found()
    }
}

/// Values of options that a pipeline file leaves out; the options say why.
#[rustfmt::skip]
mod defaults {
    pub(super) fn per_object() -> usize { 200 }
    pub(super) fn hand_points() -> usize { 800 }
}
