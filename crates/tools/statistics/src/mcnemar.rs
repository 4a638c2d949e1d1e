//! The test of paired verdicts.

/// Returns the two-sided p-value of the exact test that two settings succeed equally often, from
/// their verdicts on the same motions: `only_first` motions succeed with the first setting alone,
/// `only_second` with the second alone.
///
/// Motions that succeed with both or with neither say nothing. If the settings are equal, each of
/// the others is as likely to be in the one count as in the other: the p-value is twice the
/// binomial probability of at most the smaller count, and at most 1 (Q. McNemar, *Note on the
/// Sampling Error of the Difference Between Correlated Proportions or Percentages*, 1947; A.
/// Agresti, *Categorical Data Analysis*, 2002, section 10.1.4).
///
/// # Examples
///
/// Of 6 motions on which two controllers differ, one holds with the first alone:
///
/// ```
/// // 2 · (1 + 6) / 2⁶
/// assert!((statistics::mcnemar(1, 5) - 0.21875).abs() < 1e-12);
/// ```
pub fn mcnemar(only_first: u64, only_second: u64) -> f64 {
    let (least, n) = (only_first.min(only_second), only_first + only_second);
    // The logarithm of each term, which itself would be 0 of more than a thousand motions.
    let mut log_term = -(n as f64) * std::f64::consts::LN_2;
    let mut tail = log_term.exp();
    for k in 0..least {
        log_term += ((n - k) as f64 / (k + 1) as f64).ln();
        tail += log_term.exp();
    }
    (2.0 * tail).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand, 2 · Σ C(n, k) / 2ⁿ; the last three with exact fractions.
    #[test]
    fn values_are_those_of_the_binomial_distribution() {
        for (only_first, only_second, expected) in [
            (0, 0, 1.0),
            (0, 1, 1.0),
            (0, 5, 0.0625),
            (0, 6, 0.03125),
            (2, 8, 0.109_375),
            (3, 3, 1.0),
            (4, 5, 1.0),
            (59, 121, 4.434_449_263_755_176e-6),
            (86, 150, 3.715_936_139_571_442e-5),
            (900, 1100, 8.457_089_535_503_927e-6),
        ] {
            let found = mcnemar(only_first, only_second);
            let near = (found - expected).abs() < 1e-9 * expected;
            assert!(near, "{only_first}, {only_second}: {found}");
            assert_eq!(found, mcnemar(only_second, only_first));
        }
    }
}
