//! Recipe of the synthetic recordings: every number of the generator that one may want to change.

use serde::Deserialize;

use crate::DemonstratorError;

/// A recipe for recordings.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Seed of every random choice.
    pub seed: u64,
    /// Recordings of each object.
    pub sequences_per_object: usize,
    /// People; recordings are dealt out to them in turn.
    pub subjects: usize,
    /// One recording in this many is of a left hand; 0: none.
    pub left_every: usize,
    /// Share of recordings in which an object that can lie otherwise does, from 0 to 1.
    pub lying_share: f64,
    /// Frames per second, in hertz.
    pub rate_hz: f64,
    /// Fewest and most other objects on the table.
    pub distractors: [usize; 2],
    /// Most frames without a hand at the start.
    pub empty_frames_max: usize,
    /// Shortest and longest reach, in seconds.
    pub reach_time_s: [f64; 2],
    /// Shortest and longest way of the wrist to the grasp, in meters.
    pub reach_distance_m: [f64; 2],
    /// Shortest and longest pause between grasp and lift, in seconds.
    pub hold_time_s: [f64; 2],
    /// Lowest and highest lift, in meters.
    pub lift_height_m: [f64; 2],
    /// Shortest and longest lift, in seconds.
    pub lift_time_s: [f64; 2],
    /// Shortest and longest way of the hand-over after the lift, in meters.
    pub handover_distance_m: [f64; 2],
    /// Duration of the hand-over, in seconds.
    pub handover_time_s: f64,
    /// Standard deviation of the hand's size, as a share.
    pub hand_size_sd: f64,
    /// Standard deviation of each bone beyond the hand's size, as a share.
    pub bone_length_sd: f64,
    /// Standard deviation of the tracked wrist along each axis, in meters.
    pub wrist_noise_m: f64,
    /// Standard deviation of the tracked wrist's orientation about each axis, in radians.
    pub wrist_noise_rad: f64,
    /// Standard deviation of each tracked finger joint, in radians.
    pub joint_noise_rad: f64,
    /// Frequency above which the tracker's noise fades, in hertz.
    pub noise_cutoff_hz: f64,
    /// Approaches drawn for each recording, of which the most promising are solved for.
    pub grasp_draws: usize,
    /// Grasps solved for in each recording, of which the best is shown.
    pub grasp_tries: usize,
}

impl Recipe {
    /// Reads and checks a recipe.
    ///
    /// # Errors
    ///
    /// Fails if the text is not TOML, a key is missing or unknown, or a number makes no sense.
    pub fn from_toml(text: &str) -> Result<Self, DemonstratorError> {
        let recipe: Self = toml_edit::de::from_str(text)
            .map_err(|err| DemonstratorError::Recipe(Box::new(err)))?;
        recipe.check()?;
        Ok(recipe)
    }

    fn check(&self) -> Result<(), DemonstratorError> {
        let fail = |option, problem| Err(DemonstratorError::Option { option, problem });
        let counts = [
            ("sequences_per_object", self.sequences_per_object),
            ("subjects", self.subjects),
            ("grasp_draws", self.grasp_draws),
            ("grasp_tries", self.grasp_tries),
        ];
        for (option, count) in counts {
            if !(1..=10_000).contains(&count) {
                return fail(option, "is not between 1 and 10000");
            }
        }
        if self.distractors[0] > self.distractors[1] || self.distractors[1] > 4 {
            return fail("distractors", "is not a range within 0 to 4");
        }
        if self.empty_frames_max > 100 {
            return fail("empty_frames_max", "is more than 100");
        }
        if !(0.0..=1.0).contains(&self.lying_share) {
            return fail("lying_share", "is not between 0 and 1");
        }
        if !(5.0..=240.0).contains(&self.rate_hz) {
            return fail("rate_hz", "is not between 5 and 240");
        }
        let ranges = [
            ("reach_time_s", self.reach_time_s, [0.3, 5.0]),
            ("reach_distance_m", self.reach_distance_m, [0.15, 0.6]),
            ("hold_time_s", self.hold_time_s, [0.0, 5.0]),
            ("lift_height_m", self.lift_height_m, [0.02, 0.5]),
            ("lift_time_s", self.lift_time_s, [0.2, 5.0]),
            ("handover_distance_m", self.handover_distance_m, [0.0, 0.5]),
        ];
        for (option, [low, high], [least, most]) in ranges {
            if !(least <= low && low <= high && high <= most) {
                return fail(option, "is not a range of a sensible size");
            }
        }
        let sizes = [
            ("handover_time_s", self.handover_time_s, 5.0),
            ("hand_size_sd", self.hand_size_sd, 0.1),
            ("bone_length_sd", self.bone_length_sd, 0.1),
            ("wrist_noise_m", self.wrist_noise_m, 0.005),
            ("wrist_noise_rad", self.wrist_noise_rad, 0.1),
            ("joint_noise_rad", self.joint_noise_rad, 0.1),
        ];
        for (option, size, most) in sizes {
            if !(0.0..=most).contains(&size) {
                return fail(option, "is negative or too large");
            }
        }
        if !(0.01..=1000.0).contains(&self.noise_cutoff_hz) {
            return fail("noise_cutoff_hz", "is not between 0.01 and 1000");
        }
        Ok(())
    }
}
