//! Options of the way to a grasp.

use options::{above, options};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Most steps of a motion: ten seconds at a controller's 1000 Hz.
const MAX_STEPS: usize = 10_000;
/// Longest motion, in seconds.
const MAX_DURATION_S: f64 = 3600.0;
/// Farthest pregrasp, in meters.
const MAX_BACK_OFF_M: f64 = 1.0;
/// Widest opening, in radians: half a turn.
const MAX_OPENING_RAD: f64 = std::f64::consts::PI;

/// The way to a grasp, and how the object lies.
#[options]
#[derive(Copy, PartialEq)]
pub struct ApproachConfig {
    /// Steps of each motion, at equal times, at least 2: as many as `sample` has, the paper's
    #[option(
        default = 40, range = 2..=MAX_STEPS,
        why = "a motion needs two steps, and the upper limit is ten seconds at 1000 Hz"
    )]
    pub steps: usize,
    /// Time from the first step to the grasp (s): as in `sample`
    #[option(
        default = 1.5, range = above(0.0, MAX_DURATION_S),
        why = "reaching for an object takes seconds"
    )]
    pub duration_s: f64,
    /// Share of the time, at the end, in which the hand goes from the pregrasp to the grasp (1): that in which
    /// refined motions close
    #[option(
        default = 0.25, range = 0.01..=0.99,
        why = "it is a share of the motion, and both parts take time"
    )]
    pub closing_share: f64,
    /// Distance by which the palm is backed off in the pregrasp (m): half an object's width, so that open fingers
    /// pass it
    #[option(
        default = 0.05, range = 0.0..=MAX_BACK_OFF_M,
        why = "no hand starts to grasp farther away"
    )]
    pub back_off_m: f64,
    /// Angle by which the flexion joints are opened in the pregrasp (rad): opens the fingers by about 3 cm
    #[option(default = 0.4, range = 0.0..=MAX_OPENING_RAD, why = "no finger opens farther")]
    pub opening_rad: f64,
    /// Resting orientations of the object: those in which people grasp it
    #[option(default)]
    pub rests: RestChoice,
}

/// Choice of an object's resting orientations.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RestChoice {
    /// Those of its demonstrations, as often as they were seen; of an object without any, those that are `stable`.
    #[default]
    Seen,
    /// Those that are stable, as probable as they are by the mesh.
    Stable,
}

#[cfg(test)]
mod tests {
    use options::Options;

    use super::*;

    #[test]
    fn options_out_of_bounds_are_named() {
        assert!(ApproachConfig::default().faults().is_empty());
        let bad = ApproachConfig {
            steps: 1,
            duration_s: 0.0,
            closing_share: 1.0,
            back_off_m: -0.1,
            opening_rad: f64::NAN,
            rests: RestChoice::Seen,
        };
        let keys: Vec<String> = bad.faults().into_iter().map(|fault| fault.key).collect();
        assert_eq!(
            keys,
            [
                "steps",
                "duration_s",
                "closing_share",
                "back_off_m",
                "opening_rad"
            ]
        );
    }

    #[test]
    fn options_that_are_left_out_are_the_defaults() {
        let empty: ApproachConfig = serde_json::from_str("{}").unwrap();
        assert_eq!(empty, ApproachConfig::default());
    }
}
