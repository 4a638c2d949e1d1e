//! `rates`: how often candidates succeed over all objects, one partition for all of them, one row per
//! generator, origin of the motions and split of the objects.
//!
//! Every rate is given by candidate (c) and by draw (d): with N candidates, D draws of the row's
//! origin, refused ones included, and S that succeed, c = S/N and d = S/D. Pooled, the sums are over all
//! objects; their mean is that of the objects' own rates, each of equal weight, with a 95 % interval
//! by resampling objects (crate `statistics`). Motions of one object are alike, so that no interval
//! is given for the pooled rates.

use crate::{candidates::ObjectSplit, columns::columns, table::table, tally::share};

/// The origin of a row of motions of all origins together.
pub const ALL_ORIGINS: &str = "all";

columns! {
    /// The success rates of one generator's motions of one origin, for the objects of one split.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Rate {
        generator: String => "what drew the candidates",
        origin: String => "where the motions come from, as in `candidates`; `all` for all origins together",
        object_split: Option<ObjectSplit> => "split of the objects, as in `candidates`",
        protocol: String => "name of the protocol, e.g. `table_lift`",
        approach: String => "what the hand did before the squeeze: `follow`, `open` or `at_grasp`",
        squeeze_rad: f64 ["rad"] => "how far beyond their final positions the joints squeezed, by this option",
        friction: f64 ["1"] => "friction coefficient of hand and object",
        torque_limit_nm: f64 ["N m"] => "largest torque of a finger's drive",
        object_mass: String => "the objects' masses: `measured`, or the protocol's mass or density",
        objects_n: i64 => "objects with a draw",
        candidates_n: i64 => "candidates that were screened",
        draws_n: i64 => "draws of this origin, refused ones included",
        successes_n: i64 => "those that were lifted and held to the end",
        + candidate_rate: Option<f64> ["1"] = |row| share(row.successes_n, row.candidates_n)
            => "share of all candidates that held; null of none",
        + draw_rate: Option<f64> ["1"] = |row| share(row.successes_n, row.draws_n)
            => "share of all draws that held; null of none",
        candidate_rate_mean: Option<f64> ["1"]
            => "mean over objects of the share of candidates that held; objects without one left out, null if all are",
        candidate_rate_low: Option<f64> ["1"]
            => "lower end of its 95 % interval by resampling objects; null without it",
        candidate_rate_high: Option<f64> ["1"]
            => "upper end of its 95 % interval by resampling objects; null without it",
        draw_rate_mean: f64 ["1"] => "mean over objects of the share of draws that held",
        draw_rate_low: f64 ["1"] => "lower end of its 95 % interval by resampling objects",
        draw_rate_high: f64 ["1"] => "upper end of its 95 % interval by resampling objects",
    }
}

impl Rate {
    /// Returns the mean over objects of the share of candidates that held, with the lower and the upper end of its
    /// interval; none if no object has a candidate.
    pub fn by_candidate(&self) -> Option<[f64; 3]> {
        let ends = self.candidate_rate_low.zip(self.candidate_rate_high);
        let (mean, (low, high)) = self.candidate_rate_mean.zip(ends)?;
        Some([mean, low, high])
    }

    /// Returns the mean over objects of the share of draws that held, with the lower and the upper end of its
    /// interval.
    pub fn by_draw(&self) -> [f64; 3] {
        [self.draw_rate_mean, self.draw_rate_low, self.draw_rate_high]
    }
}

/// The rates of a screening.
pub type SuccessRates = Vec<Rate>;
table! {"rates", 3, per "screening", rows: Rate}
