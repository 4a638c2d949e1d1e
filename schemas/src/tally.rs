//! Numbers of motions by outcome, and the success rate.

use std::collections::BTreeMap;

use crate::{
    SchemaError,
    columns::{Reader, Row, Writer},
};

/// Possible outcomes of a motion.
pub trait OutcomeClass: Copy + Ord + 'static {
    /// All of them, in the order of their columns; success is first.
    const ALL: &'static [Self];
    /// Name and meaning of the total's column.
    const TOTAL: [&'static str; 2];
    /// Meaning of the rate's column.
    const RATE: &'static str;

    /// Returns the word of this outcome; its column is called `WORD_n`.
    fn word(self) -> &'static str;

    /// Returns the meaning of this outcome's column.
    fn about(self) -> String;

    /// Whether the total counts motions with this outcome.
    fn is_trial(self) -> bool {
        true
    }
}

/// Numbers of motions by outcome.
///
/// # Examples
///
/// ```
/// use schemas::{rollouts::Verdict, tally::Tally};
///
/// let tally: Tally<Verdict> = [(Verdict::Held, 1), (Verdict::Slipped, 2), (Verdict::Held, 1)]
///     .into_iter()
///     .collect();
/// assert_eq!((tally.success_count(), tally.total_count(), tally.rate()), (2, 4, Some(0.5)));
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tally<E>(BTreeMap<E, i64>);

/// Adds up the numbers of each outcome.
impl<E: OutcomeClass> FromIterator<(E, i64)> for Tally<E> {
    fn from_iter<I: IntoIterator<Item = (E, i64)>>(endings: I) -> Self {
        let mut counts: BTreeMap<E, i64> = E::ALL.iter().map(|&ending| (ending, 0)).collect();
        for (ending, n) in endings {
            *counts.entry(ending).or_default() += n;
        }
        Self(counts)
    }
}

impl<E: OutcomeClass> Tally<E> {
    /// Returns every outcome with its number of motions.
    pub fn iter(&self) -> impl Iterator<Item = (E, i64)> {
        self.0.iter().map(|(&ending, &n)| (ending, n))
    }

    /// Returns the number of motions with this outcome.
    pub fn count(&self, ending: E) -> i64 {
        self.0.get(&ending).copied().unwrap_or(0)
    }

    /// Returns the number of motions that are trials.
    pub fn total_count(&self) -> i64 {
        let trials = self.iter().filter(|(ending, _)| ending.is_trial());
        trials.map(|(_, n)| n).sum()
    }

    /// Returns the number of motions that succeeded.
    pub fn success_count(&self) -> i64 {
        self.count(E::ALL[0])
    }

    /// Returns the share of the trials that succeeded, in 0..=1; none without a trial.
    pub fn rate(&self) -> Option<f64> {
        share(self.success_count(), self.total_count())
    }

    /// Returns the 95 % interval of that share.
    pub fn interval(&self) -> [f64; 2] {
        wilson(self.success_count() as f64, self.total_count() as f64)
    }

    fn write_rates(rows: &[&Self], to: &mut Writer) {
        let rates: Vec<Option<f64>> = rows.iter().map(|row| row.rate()).collect();
        to.computed("rate", Some("1"), E::RATE, &rates);
        for (column, end, idx) in [("rate_low", "lower", 0), ("rate_high", "upper", 1)] {
            let about = format!("{end} end of its 95 % interval by Wilson");
            let ends: Vec<f64> = rows.iter().map(|row| row.interval()[idx]).collect();
            to.computed(column, Some("1"), &about, &ends);
        }
    }

    fn column(ending: E) -> String {
        if ending == E::ALL[0] {
            return "successes_n".to_owned();
        }
        format!("{}_n", ending.word())
    }
}

/// The total, the successes, the rate with its interval, and the number of each other outcome.
impl<E: OutcomeClass> Row for Tally<E> {
    fn write(rows: &[&Self], to: &mut Writer) {
        let totals: Vec<i64> = rows.iter().map(|row| row.total_count()).collect();
        let [total, about] = E::TOTAL;
        to.computed(total, None, about, &totals);
        for &ending in E::ALL {
            let counts: Vec<i64> = rows.iter().map(|row| row.count(ending)).collect();
            to.computed(&Self::column(ending), None, &ending.about(), &counts);
            if ending == E::ALL[0] {
                Self::write_rates(rows, to);
            }
        }
    }

    fn read(from: &Reader<'_>, row: usize) -> Result<Self, SchemaError> {
        let count = |&ending: &E| Ok((ending, from.cell(&Self::column(ending), row)?));
        let tally: Self = E::ALL
            .iter()
            .map(count)
            .collect::<Result<_, SchemaError>>()?;
        let [total, _] = E::TOTAL;
        match (from.cell::<i64>(total, row)?, tally.total_count()) {
            (total_n, ended_n) if total_n == ended_n => Ok(tally),
            (total_n, ended_n) => Err(SchemaError::invalid(
                total,
                format!("{total_n}, and {ended_n} by how they ended"),
            )),
        }
    }
}

/// Returns the share of `n` that succeeded; none of none.
pub(crate) fn share(successes_n: i64, n: i64) -> Option<f64> {
    (n > 0).then(|| successes_n as f64 / n as f64)
}

/// Returns the 95 % confidence interval of a probability from `successes` in `n` trials (E. B.
/// Wilson, *Probable Inference, the Law of Succession, and Statistical Inference*, 1927); 0..=1
/// without a trial.
///
/// # Examples
///
/// ```
/// let [low, high] = schemas::tally::wilson(5.0, 10.0);
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
