//! Options of the way to a grasp.

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
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ApproachConfig {
    /// Steps of each motion, at equal times, at least 2: as many as `sample` has, the paper's
    #[serde(default = "defaults::steps")]
    pub steps: usize,
    /// Time from the first step to the grasp (s): as in `sample`
    #[serde(default = "defaults::duration_s")]
    pub duration_s: f64,
    /// Share of the time, at the end, in which the hand goes from the pregrasp to the grasp (1): that in which
    /// refined motions close
    #[serde(default = "defaults::closing_share")]
    pub closing_share: f64,
    /// Distance by which the palm is backed off in the pregrasp (m): half an object's width, so that open fingers
    /// pass it
    #[serde(default = "defaults::back_off_m")]
    pub back_off_m: f64,
    /// Angle by which the flexion joints are opened in the pregrasp (rad): opens the fingers by about 3 cm
    #[serde(default = "defaults::opening_rad")]
    pub opening_rad: f64,
    /// Resting orientations of the object: those in which people grasp it
    #[serde(default)]
    pub rests: RestChoice,
}

impl Default for ApproachConfig {
    fn default() -> Self {
        Self {
            steps: defaults::steps(),
            duration_s: defaults::duration_s(),
            closing_share: defaults::closing_share(),
            back_off_m: defaults::back_off_m(),
            opening_rad: defaults::opening_rad(),
            rests: RestChoice::default(),
        }
    }
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

impl ApproachConfig {
    /// Returns the invalid options, each with its key and the reason.
    pub fn faults(&self) -> Vec<(&'static str, String)> {
        let mut faults = dataflow::OptionFaults::default();
        let why = "a motion needs two steps, and the upper limit is ten seconds at 1000 Hz";
        faults.within("steps", self.steps, 2..=MAX_STEPS, why);
        let why = "reaching for an object takes seconds";
        faults.above("duration_s", self.duration_s, 0.0, MAX_DURATION_S, why);
        let why = "it is a share of the motion, and both parts take time";
        faults.within("closing_share", self.closing_share, 0.01..=0.99, why);
        let why = "no hand starts to grasp farther away";
        faults.within("back_off_m", self.back_off_m, 0.0..=MAX_BACK_OFF_M, why);
        let why = "no finger opens farther";
        faults.within("opening_rad", self.opening_rad, 0.0..=MAX_OPENING_RAD, why);
        let found = faults.found().into_iter();
        let keys = [
            "steps",
            "duration_s",
            "closing_share",
            "back_off_m",
            "opening_rad",
        ];
        found
            .filter_map(|fault| {
                let key = keys.into_iter().find(|key| *key == fault.key)?;
                Some((key, fault.problem))
            })
            .collect()
    }
}

/// Values of options that a pipeline file leaves out; the options say why.
#[rustfmt::skip]
mod defaults {
    pub(super) fn steps() -> usize { 40 }
    pub(super) fn duration_s() -> f64 { 1.5 }
    pub(super) fn closing_share() -> f64 { 0.25 }
    pub(super) fn back_off_m() -> f64 { 0.05 }
    pub(super) fn opening_rad() -> f64 { 0.4 }
}

#[cfg(test)]
mod tests {
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
        let keys: Vec<&str> = bad.faults().into_iter().map(|(key, _)| key).collect();
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
