//! Options of `kind = "rrt"`.

use std::path::PathBuf;

use options::options;
use rrt_connect::{Growth, Metric, RrtOptions};

/// Most nodes of both trees: each has 200 bytes, and the nearest of all is searched for each target.
const MAX_NODES: usize = 1_000_000;
/// Most checks of one search: some hours.
const MAX_CHECKS: u64 = 1_000_000_000;
/// Least weight, and least distance in the metric.
const MIN_NUMBER: f64 = 1e-6;
/// Greatest ones.
const MAX_NUMBER: f64 = 1e6;
/// Reason for both.
const PRECISION: &str = "smaller and larger ones lose precision in a sum of squares";
/// Most attempts to shorten one path.
const MAX_SHORTCUTS: usize = 1_000_000;
/// Greatest depth that is no collision, and the greatest margin of the palm's region, in meters.
const MAX_DISTANCE_M: f64 = 1.0;

/// Options of `kind = "rrt"`.
///
/// Distances have no unit: the palm's way, its rotation and the joints' changes count with their weights.
#[options]
pub struct RrtConfig {
    /// File of the robot hand, or its URDF alone; the root link is the palm.
    #[option(path)]
    pub hand: PathBuf,
    /// The hand's file: its points stay near their positions at the grasp when the hand opens.
    #[option(path)]
    pub hand_table: PathBuf,
    /// Number of nodes of both trees together at which a search ends without a path (10 000): the paper's.
    #[option(
        default = 10_000, range = 2..=MAX_NODES,
        why = "a tree has a root, and the nearest of all nodes is searched for each target"
    )]
    pub max_nodes: usize,
    /// Number of collision checks at which a search ends without a path (100 000): a trapped tree checks without
    /// growing.
    #[option(default = 100_000, range = 1..=MAX_CHECKS, why = "each takes about ten microseconds")]
    pub max_checks: u64,
    /// Greatest length of an edge; long edges explore with few nodes. The paper's ε is 0.01, in units that it
    /// does not name.
    #[option(default = 0.2, range = MIN_NUMBER..=MAX_NUMBER, why = PRECISION)]
    pub step: f64,
    /// Greatest distance between two checked configurations of an edge (0.02): 2 mm of the palm, or 0.02 rad, by which
    /// a fingertip moves 4 mm; with all coordinates at once each moves less.
    #[option(default = 0.02, range = MIN_NUMBER..=MAX_NUMBER, why = PRECISION)]
    pub check_spacing: f64,
    /// Share of the targets that are sampled; the others are the root of the other tree (0.5): the paper's β.
    #[option(default = 0.5, range = 0.0..=1.0, why = "it is a share")]
    pub drawn_share: f64,
    /// Weight of a meter of the palm's way (1/m): 10 cm count as one radian, about the length of a finger.
    #[option(default = 10.0, range = MIN_NUMBER..=MAX_NUMBER, why = PRECISION)]
    pub translation_weight_per_m: f64,
    /// Weight of the palm's rotation (1/rad).
    #[option(default = 1.0, range = MIN_NUMBER..=MAX_NUMBER, why = PRECISION)]
    pub rotation_weight_per_rad: f64,
    /// Weight of a joint's change (1/rad; 1/m if prismatic).
    #[option(default = 1.0, range = MIN_NUMBER..=MAX_NUMBER, why = PRECISION)]
    pub joint_weight_per_rad: f64,
    /// Depth in object or table up to which a configuration is free, in meters: fingertips yield by that much, and a
    /// screened hand may start so deep.
    #[option(
        default = 0.002, range = 0.0..=MAX_DISTANCE_M,
        why = "nothing of a hand's size is larger"
    )]
    pub tolerated_depth_m: f64,
    /// Margin of the palm's region beyond start and grasp, along each axis of the object, in meters (0.2): room to go
    /// around an object of a hand's size.
    #[option(
        default = 0.2, range = 0.0..=MAX_DISTANCE_M,
        why = "nothing of a hand's size is larger"
    )]
    pub margin_m: f64,
    /// Last part of the steps in which the hand closes on a straight line from the pregrasp to the grasp, without
    /// checks (0.25): that in which a screened hand may touch the object.
    #[option(
        default = 0.25, range = 0.0..=0.9,
        why = "it is a share of the steps, and the rest is the path"
    )]
    pub closing_share: f64,
    /// Distance that the hand keeps from object and table at the pregrasp, as far as it can, in meters: palm and
    /// fingers move away from the grasp no farther than that takes. With less, fingers that are late touch the object
    /// one by one.
    #[option(
        default = 0.01, range = 0.0..=MAX_DISTANCE_M,
        why = "nothing of a hand's size is larger"
    )]
    pub clearance_m: f64,
    /// Attempts to replace a part of a path by a straight line (0): the roughness of the paper's paths suggests none.
    #[option(default, range = 0..=MAX_SHORTCUTS, why = "each checks a straight line")]
    pub shortcuts: usize,
}

impl RrtConfig {
    /// Returns the parameters of the planner.
    pub(crate) fn planner(&self) -> RrtOptions {
        RrtOptions {
            growth: Growth {
                metric: Metric {
                    translation_per_m: self.translation_weight_per_m,
                    rotation_per_rad: self.rotation_weight_per_rad,
                    joint_per_rad: self.joint_weight_per_rad,
                },
                step: self.step,
                spacing: self.check_spacing,
                drawn_share: self.drawn_share,
                max_nodes: self.max_nodes,
                max_checks: self.max_checks,
            },
            tolerated_depth_m: self.tolerated_depth_m,
            margin_m: self.margin_m,
            closing_share: self.closing_share,
            clearance_m: self.clearance_m,
            shortcuts: self.shortcuts,
        }
    }
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
    use options::Options;

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
