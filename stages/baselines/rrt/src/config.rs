//! Options of `kind = "rrt"`.

use std::path::PathBuf;

use dataflow::{OptionFault, OptionFaults};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{configuration::Metric, connect::Growth};

/// Most nodes of both trees: each has 200 bytes, and the nearest of all is searched for each target.
const MAX_NODES: usize = 1_000_000;
/// Most checks of one search: some hours.
const MAX_CHECKS: u64 = 1_000_000_000;
/// Least weight, and least distance in the metric.
const MIN_NUMBER: f64 = 1e-6;
/// Greatest ones.
const MAX_NUMBER: f64 = 1e6;
/// Most attempts to shorten one path.
const MAX_SHORTCUTS: usize = 1_000_000;
/// Greatest depth that is no collision, and the greatest margin of the palm's region, in meters.
const MAX_DISTANCE_M: f64 = 1.0;

/// Options of `kind = "rrt"`.
///
/// Distances have no unit: the palm's way, its rotation and the joints' changes count with their weights.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RrtConfig {
    /// File of the robot hand, or its URDF alone; the root link is the palm.
    #[serde(skip_serializing)]
    pub hand: PathBuf,
    /// The hand's file: its points stay near their positions at the grasp when the hand opens.
    #[serde(skip_serializing)]
    pub hand_table: PathBuf,
    /// Number of nodes of both trees together at which a search ends without a path (10 000): the paper's.
    #[serde(default = "defaults::max_nodes")]
    pub max_nodes: usize,
    /// Number of collision checks at which a search ends without a path (100 000): a trapped tree checks without
    /// growing.
    #[serde(default = "defaults::max_checks")]
    pub max_checks: u64,
    /// Greatest length of an edge; long edges explore with few nodes. The paper's ε is 0.01, in units that it
    /// does not name.
    #[serde(default = "defaults::step")]
    pub step: f64,
    /// Greatest distance between two checked configurations of an edge (0.02): 2 mm of the palm, or 0.02 rad, by which
    /// a fingertip moves 4 mm; with all coordinates at once each moves less.
    #[serde(default = "defaults::check_spacing")]
    pub check_spacing: f64,
    /// Share of the targets that are sampled; the others are the root of the other tree (0.5): the paper's β.
    #[serde(default = "defaults::drawn_share")]
    pub drawn_share: f64,
    /// Weight of a meter of the palm's way (1/m): 10 cm count as one radian, about the length of a finger.
    #[serde(default = "defaults::translation_weight_per_m")]
    pub translation_weight_per_m: f64,
    /// Weight of the palm's rotation (1/rad).
    #[serde(default = "defaults::rotation_weight_per_rad")]
    pub rotation_weight_per_rad: f64,
    /// Weight of a joint's change (1/rad; 1/m if prismatic).
    #[serde(default = "defaults::joint_weight_per_rad")]
    pub joint_weight_per_rad: f64,
    /// Depth in object or table up to which a configuration is free, in meters: fingertips yield by that much, and a
    /// screened hand may start so deep.
    #[serde(default = "defaults::tolerated_depth_m")]
    pub tolerated_depth_m: f64,
    /// Margin of the palm's region beyond start and grasp, along each axis of the object, in meters (0.2): room to go
    /// around an object of a hand's size.
    #[serde(default = "defaults::margin_m")]
    pub margin_m: f64,
    /// Last part of the steps in which the hand closes on a straight line from the pregrasp to the grasp, without
    /// checks (0.25): that in which a screened hand may touch the object.
    #[serde(default = "defaults::closing_share")]
    pub closing_share: f64,
    /// Distance that the hand keeps from object and table at the pregrasp, as far as it can, in meters: palm and
    /// fingers move away from the grasp no farther than that takes. With less, fingers that are late touch the object
    /// one by one.
    #[serde(default = "defaults::clearance_m")]
    pub clearance_m: f64,
    /// Attempts to replace a part of a path by a straight line (0): the roughness of the paper's paths suggests none.
    #[serde(default)]
    pub shortcuts: usize,
}

impl RrtConfig {
    /// Returns the weights of the metric.
    pub(crate) fn metric(&self) -> Metric {
        Metric {
            translation_per_m: self.translation_weight_per_m,
            rotation_per_rad: self.rotation_weight_per_rad,
            joint_per_rad: self.joint_weight_per_rad,
        }
    }

    /// Returns the parameters of the trees' growth.
    pub(crate) fn growth(&self) -> Growth {
        Growth {
            metric: self.metric(),
            step: self.step,
            spacing: self.check_spacing,
            drawn_share: self.drawn_share,
            max_nodes: self.max_nodes,
            max_checks: self.max_checks,
        }
    }

    /// Returns the faults of the options beyond their types.
    pub(crate) fn faults(&self) -> Vec<OptionFault> {
        let mut faults = OptionFaults::default();
        let why = "a tree has a root, and the nearest of all nodes is searched for each target";
        faults.within("max_nodes", self.max_nodes, 2..=MAX_NODES, why);
        let why = "each takes about ten microseconds";
        faults.within("max_checks", self.max_checks, 1..=MAX_CHECKS, why);
        for (key, number) in [
            ("step", self.step),
            ("check_spacing", self.check_spacing),
            ("translation_weight_per_m", self.translation_weight_per_m),
            ("rotation_weight_per_rad", self.rotation_weight_per_rad),
            ("joint_weight_per_rad", self.joint_weight_per_rad),
        ] {
            let why = "smaller and larger ones lose precision in a sum of squares";
            faults.within(key, number, MIN_NUMBER..=MAX_NUMBER, why);
        }
        let why = "it is a share";
        faults.within("drawn_share", self.drawn_share, 0.0..=1.0, why);
        let why = "it is a share of the steps, and the rest is the path";
        faults.within("closing_share", self.closing_share, 0.0..=0.9, why);
        for (key, distance_m) in [
            ("tolerated_depth_m", self.tolerated_depth_m),
            ("margin_m", self.margin_m),
            ("clearance_m", self.clearance_m),
        ] {
            let why = "nothing of a hand's size is larger";
            faults.within(key, distance_m, 0.0..=MAX_DISTANCE_M, why);
        }
        let why = "each checks a straight line";
        faults.within("shortcuts", self.shortcuts, 0..=MAX_SHORTCUTS, why);
        faults.found()
    }
}

/// Values of options that a pipeline file leaves out; the options say why.
#[rustfmt::skip]
mod defaults {
    pub(super) fn max_nodes() -> usize { 10_000 }
    pub(super) fn max_checks() -> u64 { 100_000 }
    pub(super) fn step() -> f64 { 0.2 }
    pub(super) fn check_spacing() -> f64 { 0.02 }
    pub(super) fn drawn_share() -> f64 { 0.5 }
    pub(super) fn translation_weight_per_m() -> f64 { 10.0 }
    pub(super) fn rotation_weight_per_rad() -> f64 { 1.0 }
    pub(super) fn joint_weight_per_rad() -> f64 { 1.0 }
    pub(super) fn tolerated_depth_m() -> f64 { 0.002 }
    pub(super) fn margin_m() -> f64 { 0.2 }
    pub(super) fn closing_share() -> f64 { 0.25 }
    pub(super) fn clearance_m() -> f64 { 0.01 }
}

/// Options with their defaults, for the Allegro.
#[cfg(test)]
pub(crate) fn fixture() -> RrtConfig {
    let data = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../data");
    let options = serde_json::json!({
        "hand": format!("{data}/robots/allegro_right.urdf"),
        "hand_table": format!("{data}/hands/allegro_right.toml"),
    });
    serde_json::from_value(options).unwrap()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_out_of_bounds_are_named() {
        assert_eq!(fixture().faults(), []);
        let config = RrtConfig {
            max_nodes: 1,
            check_spacing: 0.0,
            drawn_share: f64::NAN,
            closing_share: 1.0,
            ..fixture()
        };
        let faults = config.faults();
        let keys: Vec<&str> = faults.iter().map(|fault| fault.key.as_str()).collect();
        let expected = ["max_nodes", "check_spacing", "drawn_share", "closing_share"];
        assert_eq!(keys, expected);
    }
}
