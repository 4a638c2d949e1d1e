//! `success`: success rates of the candidates of each object, one partition for all objects, one
//! row per object and generator.
//!
//! A grasp is the last step of a candidate, the palm in the object's frame. Spread is the root mean
//! square over successful grasps of the distance from their mean: for the palm's origin √(Σ|p −
//! p̄|²/n), for its orientation √(Σ∠(R, R̄)²/n) with R̄ the rotation of least squared distance as
//! matrices (Markley et al., *Averaging Quaternions*, 2007), for dof joints √(Σ|q − q̄|²/(n ·
//! dof)). Only grasps with the same resting pose of the object share a mean, and one without others
//! is left out: `spread_n` is n, and with 0 of them every spread is 0.

use crate::{
    SchemaError,
    columns::{Flatten, columns},
    rollouts::Verdict,
    sampling::GraspDistance,
    table::table,
};

/// The success rate of one generator's candidates for one object.
#[derive(Debug, Clone, PartialEq)]
pub struct Success {
    /// The object's name.
    pub object: String,
    /// Generator of the candidates, e.g. `cgf`.
    pub generator: String,
    /// Number of candidates per verdict, in the order of [`Verdict::ALL`].
    pub verdicts_n: [i64; Verdict::ALL.len()],
    /// Control steps simulated for all of them.
    pub control_steps_n: i64,
    /// Root mean square distance of the successful grasps from their mean; 0 if `spread_n` is 0.
    pub spread: GraspDistance,
    /// Number of successful grasps in the spread: those with another one of the same resting pose.
    pub spread_n: i64,
}

impl Success {
    /// Returns the number of screened candidates.
    pub fn candidates_n(&self) -> i64 {
        self.verdicts_n.iter().sum()
    }

    /// Returns the number of candidates with this verdict.
    pub fn count(&self, verdict: Verdict) -> i64 {
        let mut counts = Verdict::ALL.iter().zip(self.verdicts_n);
        let found = counts.find(|(known, _)| **known == verdict);
        found.map_or(0, |(_, n)| n)
    }

    /// Returns the number of candidates that held.
    pub fn successes_n(&self) -> i64 {
        self.count(Verdict::Held)
    }

    /// Returns the share that held, in 0..=1; 0 of none.
    pub fn rate(&self) -> f64 {
        self.successes_n() as f64 / self.candidates_n().max(1) as f64
    }

    /// Returns the 95 % interval of the share that held.
    pub fn interval(&self) -> [f64; 2] {
        wilson(self.successes_n() as f64, self.candidates_n() as f64)
    }

    /// Returns the control steps simulated for each success, failures included; 0 without a success.
    pub fn control_steps_per_success(&self) -> f64 {
        match self.successes_n() {
            0 => 0.0,
            n => self.control_steps_n as f64 / n as f64,
        }
    }
}

/// The success of the candidates of all objects.
pub type Successes = Vec<Success>;
table! {"success", 2, rows: Success}

/// Returns the 95 % confidence interval of a probability from `successes` in `n` trials (E. B.
/// Wilson, *Probable Inference, the Law of Succession, and Statistical Inference*, 1927); 0..=1
/// without a trial.
///
/// # Examples
///
/// ```
/// let [low, high] = schemas::success::wilson(5.0, 10.0);
/// assert!((low - 0.2366).abs() < 1e-4 && (high - 0.7634).abs() < 1e-4);
/// ```
pub fn wilson(successes: f64, n: f64) -> [f64; 2] {
    /// The standard normal distribution's 97.5th percentile.
    const Z: f64 = 1.959_963_984_540_054;
    if n <= 0.0 {
        return [0.0, 1.0];
    }
    let p = successes / n;
    let z2 = Z * Z;
    let middle = (p + z2 / (2.0 * n)) / (1.0 + z2 / n);
    let half = Z * (p * (1.0 - p) / n + z2 / (4.0 * n * n)).sqrt() / (1.0 + z2 / n);
    // Rounding must not make the lower bound of zero successes positive.
    let low = if successes == 0.0 { 0.0 } else { middle - half };
    let high = if p < 1.0 { middle + half } else { 1.0 };
    [low, high]
}

columns! {
    /// The columns of a [`Success`].
    pub(crate) struct Flat {
        object: String => "the object",
        generator: String => "what drew the candidates",
        candidates_n: i64 => "candidates that were screened",
        successes_n: i64 => "those that were lifted and held to the end",
        rate: f64 ["1"] => "share of the candidates that held; 0 of none",
        rate_low: f64 ["1"] => "lower end of its 95 % interval by Wilson",
        rate_high: f64 ["1"] => "upper end of its 95 % interval by Wilson",
        limit_n: i64 => "those that failed by `limit`",
        table_n: i64 => "those that failed by `table`",
        early_contact_n: i64 => "those that failed by `early_contact`",
        knocked_over_n: i64 => "those that failed by `knocked_over`",
        not_grasped_n: i64 => "those that failed by `not_grasped`",
        slipped_n: i64 => "those that failed by `slipped`",
        dropped_n: i64 => "those that failed by `dropped`",
        too_deep_n: i64 => "those that failed by `too_deep`",
        diverged_n: i64 => "those that failed by `diverged`",
        control_steps_n: i64 => "control steps simulated, for failures too",
        control_steps_per_success: f64 ["1"]
            => "control steps simulated, for failures too, per success; 0 without one",
        spread_palm_m: f64 ["m"]
            => "root mean square distance of the palms of successful grasps from their mean",
        spread_palm_rad: f64 ["rad"]
            => "root mean square angle of the palms of successful grasps from their mean",
        spread_q_rad: f64 ["rad"]
            => "root mean square difference of the joint positions of successful grasps from their mean",
        spread_n: i64 => "successful grasps that have another one to be compared with",
    }
}

impl Flatten for Success {
    type Flat = Flat;

    fn flat(&self) -> Flat {
        let [rate_low, rate_high] = self.interval();
        Flat {
            object: self.object.clone(),
            generator: self.generator.clone(),
            candidates_n: self.candidates_n(),
            successes_n: self.successes_n(),
            rate: self.rate(),
            rate_low,
            rate_high,
            limit_n: self.count(Verdict::Limit),
            table_n: self.count(Verdict::Table),
            early_contact_n: self.count(Verdict::EarlyContact),
            knocked_over_n: self.count(Verdict::KnockedOver),
            not_grasped_n: self.count(Verdict::NotGrasped),
            slipped_n: self.count(Verdict::Slipped),
            dropped_n: self.count(Verdict::Dropped),
            too_deep_n: self.count(Verdict::TooDeep),
            diverged_n: self.count(Verdict::Diverged),
            control_steps_n: self.control_steps_n,
            control_steps_per_success: self.control_steps_per_success(),
            spread_palm_m: self.spread.palm_m,
            spread_palm_rad: self.spread.palm_rad,
            spread_q_rad: self.spread.q_rad,
            spread_n: self.spread_n,
        }
    }

    fn from_flat(flat: Flat) -> Result<Self, SchemaError> {
        let success = Self {
            object: flat.object,
            generator: flat.generator,
            verdicts_n: Verdict::ALL.map(|verdict| match verdict {
                Verdict::Held => flat.successes_n,
                Verdict::Limit => flat.limit_n,
                Verdict::Table => flat.table_n,
                Verdict::EarlyContact => flat.early_contact_n,
                Verdict::KnockedOver => flat.knocked_over_n,
                Verdict::NotGrasped => flat.not_grasped_n,
                Verdict::Slipped => flat.slipped_n,
                Verdict::Dropped => flat.dropped_n,
                Verdict::TooDeep => flat.too_deep_n,
                Verdict::Diverged => flat.diverged_n,
            }),
            control_steps_n: flat.control_steps_n,
            spread: GraspDistance {
                palm_m: flat.spread_palm_m,
                palm_rad: flat.spread_palm_rad,
                q_rad: flat.spread_q_rad,
            },
            spread_n: flat.spread_n,
        };
        match (flat.candidates_n, success.candidates_n()) {
            (candidates_n, ended_n) if candidates_n == ended_n => Ok(success),
            (candidates_n, ended_n) => Err(SchemaError::invalid(
                "candidates_n",
                format!("{candidates_n} candidates, and {ended_n} that held or failed"),
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// To four digits. The first four are those of R. G. Newcombe, *Two-Sided Confidence Intervals for the
    /// Single Proportion: Comparison of Seven Methods*, 1998, table I, method 3; the last is the mirror
    /// image of that of 0 of 10.
    #[test]
    fn intervals_are_the_published_ones() {
        for (successes, n, expected) in [
            (81, 263, [0.2553, 0.3662]),
            (15, 148, [0.0624, 0.1605]),
            (0, 20, [0.0, 0.1611]),
            (1, 29, [0.0061, 0.1718]),
            (0, 10, [0.0, 0.2775]),
            (5, 10, [0.2366, 0.7634]),
            (10, 10, [0.7225, 1.0]),
        ] {
            let found = wilson(f64::from(successes), f64::from(n));
            for (found, expected) in found.into_iter().zip(expected) {
                assert!(
                    (found - expected).abs() < 6e-5,
                    "{successes} of {n}: {found} {expected}"
                );
            }
        }
        assert_eq!(wilson(0.0, 10.0)[0], 0.0);
        assert_eq!(wilson(10.0, 10.0)[1], 1.0);
        assert_eq!(wilson(0.0, 0.0), [0.0, 1.0]);
    }

    #[test]
    fn every_end_lies_within_0_and_1_and_about_the_rate() {
        for n in [1, 2, 3, 64, 10_000, 1_000_000].map(f64::from) {
            let share = |by: f64| (n / by).floor();
            for successes in [0.0, 1.0, share(3.0), share(2.0), n - 1.0, n] {
                let [low, high] = wilson(successes, n);
                let rate = successes / n;
                assert!((0.0..=rate).contains(&low), "{successes} of {n}: {low}");
                assert!((rate..=1.0).contains(&high), "{successes} of {n}: {high}");
            }
        }
    }
}
