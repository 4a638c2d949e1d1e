//! `success`: how often the candidates of each object hold, one partition for all objects, one row per
//! object and generator.
//!
//! | column                      | type | unit | meaning                                              |
//! |-----------------------------|------|------|------------------------------------------------------|
//! | `object`                    | utf8 |      | the object                                           |
//! | `generator`                 | utf8 |      | what drew the candidates                             |
//! | `candidates_n`              | i64  |      | candidates that were screened                        |
//! | `successes_n`               | i64  |      | those that were lifted and held to the end           |
//! | `rate`                      | f64  | 1    | `successes_n` over `candidates_n`; 0 of none         |
//! | `rate_low`, `rate_high`     | f64  | 1    | ends of its 95 % interval, see [`wilson`]            |
//! | `limit_n` … `diverged_n`    | i64  |      | those that failed, by each reason of [`Verdict`]     |
//! | `control_steps_n`           | i64  |      | control steps simulated, for failures too            |
//! | `control_steps_per_success` | f64  | 1    | `control_steps_n` over `successes_n`; 0 without one  |
//! | `spread_palm_m`             | f64  | m    | spread of the successful grasps: the palm's origin   |
//! | `spread_palm_rad`           | f64  | rad  | its orientation                                      |
//! | `spread_q_rad`              | f64  | rad  | joint positions                                      |
//! | `spread_n`                  | i64  |      | successful grasps that have another to be compared with |
//!
//! A grasp is the last step of a candidate, the palm in the object's frame. Spread is the root mean square
//! over successful grasps of the distance from their mean: for the palm's origin √(Σ|p − p̄|²/n), for its
//! orientation √(Σ∠(R, R̄)²/n) with R̄ the rotation of least squared distance as matrices (Markley et al.,
//! *Averaging Quaternions*, 2007), for dof joints √(Σ|q − q̄|²/(n · dof)). Only grasps of an object that lies in
//! the same pose share a mean, and one that lies alone is left out: `spread_n` is n, and with 0 of them
//! every spread is 0.

use arrow_array::RecordBatch;
use arrow_schema::Schema;

use crate::{
    Table,
    columns::{Columns, Reader, SchemaError},
    rollouts::Verdict,
    sampling::GraspDistance,
};

/// Bump on any change to the columns; readers reject every other version.
const VERSION: &str = "success/1";

/// How often the candidates that one generator drew for one object hold.
#[derive(Debug, Clone, PartialEq)]
pub struct Success {
    /// The object's name.
    pub object: String,
    /// What drew the candidates, e.g. `cgf`.
    pub generator: String,
    /// How many candidates ended in each way, in the order of [`Verdict::ALL`].
    pub verdicts_n: [i64; Verdict::ALL.len()],
    /// Control steps simulated for all of them.
    pub control_steps_n: i64,
    /// Root mean square distance of the successful grasps from their mean; 0 if none is compared.
    pub spread: GraspDistance,
    /// Successful grasps that have another one to be compared with.
    pub spread_n: i64,
}

impl Success {
    /// Returns how many candidates were screened.
    pub fn candidates_n(&self) -> i64 {
        self.verdicts_n.iter().sum()
    }

    /// Returns how many ended so.
    pub fn count(&self, verdict: Verdict) -> i64 {
        let mut counts = Verdict::ALL.iter().zip(self.verdicts_n);
        let found = counts.find(|(known, _)| **known == verdict);
        found.map_or(0, |(_, n)| n)
    }

    /// Returns how many held.
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

/// Returns the ends of the 95 % interval of a probability of which `successes` of `n` trials are known
/// (E. B. Wilson, *Probable Inference, the Law of Succession, and Statistical Inference*, 1927); all of
/// 0..=1 without a trial.
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
    // Rounding must not say that what never happened is a little more probable than never.
    let low = if successes == 0.0 { 0.0 } else { middle - half };
    let high = if p < 1.0 { middle + half } else { 1.0 };
    [low, high]
}

/// Name, unit, meaning and value of a column of numbers.
type NumberColumn = (
    &'static str,
    &'static str,
    &'static str,
    fn(&Success) -> f64,
);

/// What follows from the counts.
const RATES: [NumberColumn; 3] = [
    (
        "rate",
        "1",
        "share of the candidates that held; 0 of none",
        Success::rate,
    ),
    (
        "rate_low",
        "1",
        "lower end of its 95 % interval by Wilson",
        |s| s.interval()[0],
    ),
    (
        "rate_high",
        "1",
        "upper end of its 95 % interval by Wilson",
        |s| s.interval()[1],
    ),
];

/// What follows the counts of failures.
const FIGURES: [NumberColumn; 4] = [
    (
        "control_steps_per_success",
        "1",
        "control steps simulated, for failures too, per success; 0 without one",
        Success::control_steps_per_success,
    ),
    (
        "spread_palm_m",
        "m",
        "root mean square distance of the palms of successful grasps from their mean",
        |s| s.spread.palm_m,
    ),
    (
        "spread_palm_rad",
        "rad",
        "root mean square angle of the palms of successful grasps from their mean",
        |s| s.spread.palm_rad,
    ),
    (
        "spread_q_rad",
        "rad",
        "root mean square difference of the joint positions of successful grasps from their mean",
        |s| s.spread.q_rad,
    ),
];

/// Returns the Arrow schema.
fn schema() -> Schema {
    columns(&[]).schema()
}

fn columns(rows: &[Success]) -> Columns {
    let mut c = Columns::new(VERSION);
    c.utf8(
        "object",
        "the object",
        rows.iter().map(|s| s.object.clone()),
    );
    c.utf8(
        "generator",
        "what drew the candidates",
        rows.iter().map(|s| s.generator.clone()),
    );
    c.i64(
        "candidates_n",
        "candidates that were screened",
        rows.iter().map(Success::candidates_n),
    );
    c.i64(
        "successes_n",
        "those that were lifted and held to the end",
        rows.iter().map(Success::successes_n),
    );
    numbers(&mut c, rows, &RATES);
    for (verdict, name) in failures() {
        let about = format!("those that failed by `{}`", verdict.as_str());
        c.i64(&name, &about, rows.iter().map(|s| s.count(verdict)));
    }
    c.i64(
        "control_steps_n",
        "control steps simulated, for failures too",
        rows.iter().map(|s| s.control_steps_n),
    );
    numbers(&mut c, rows, &FIGURES);
    c.i64(
        "spread_n",
        "successful grasps that have another one to be compared with",
        rows.iter().map(|s| s.spread_n),
    );
    c
}

fn numbers(c: &mut Columns, rows: &[Success], columns: &[NumberColumn]) {
    for (name, unit, about, value) in columns {
        c.f64(name, unit, about, rows.iter().map(value));
    }
}

/// The reasons for failure, and the columns that count them.
fn failures() -> impl Iterator<Item = (Verdict, String)> {
    let failures = Verdict::ALL.into_iter();
    failures
        .filter(|verdict| *verdict != Verdict::Held)
        .map(|verdict| (verdict, format!("{}_n", verdict.as_str())))
}

/// Returns one row per object and generator.
///
/// # Errors
///
/// Fails if a number is not finite.
fn to_batch(rows: &[Success]) -> Result<RecordBatch, SchemaError> {
    columns(rows).into_batch()
}

/// Reads what [`to_batch`] wrote.
///
/// # Errors
///
/// Fails if the columns are of another version, or if successes and failures are not all candidates.
fn from_batch(batch: &RecordBatch) -> Result<Vec<Success>, SchemaError> {
    let r = Reader::new(batch, VERSION)?;
    let row = |row: usize| {
        let mut verdicts_n = [0; Verdict::ALL.len()];
        for (n, verdict) in verdicts_n.iter_mut().zip(Verdict::ALL) {
            *n = match verdict {
                Verdict::Held => r.i64("successes_n", row)?,
                failure => r.i64(&format!("{}_n", failure.as_str()), row)?,
            };
        }
        let success = Success {
            object: r.utf8("object", row)?.to_owned(),
            generator: r.utf8("generator", row)?.to_owned(),
            verdicts_n,
            control_steps_n: r.i64("control_steps_n", row)?,
            spread: GraspDistance {
                palm_m: r.f64("spread_palm_m", row)?,
                palm_rad: r.f64("spread_palm_rad", row)?,
                q_rad: r.f64("spread_q_rad", row)?,
            },
            spread_n: r.i64("spread_n", row)?,
        };
        let candidates_n = r.i64("candidates_n", row)?;
        if success.candidates_n() == candidates_n {
            return Ok(success);
        }
        let ended_n = success.candidates_n();
        let message = format!("{candidates_n} candidates, and {ended_n} that held or failed");
        Err(r.invalid("candidates_n", message))
    };
    (0..r.rows()).map(row).collect()
}

/// The rows of one partition.
pub type Successes = Vec<Success>;

impl Table for Successes {
    const NAME: &'static str = "success";
    const VERSION: &'static str = VERSION;

    fn schema() -> Schema {
        schema()
    }

    fn to_batch(&self) -> Result<RecordBatch, SchemaError> {
        to_batch(self)
    }

    fn from_batch(_key: &str, batch: &RecordBatch) -> Result<Self, SchemaError> {
        from_batch(batch)
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
