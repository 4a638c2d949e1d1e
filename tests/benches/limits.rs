//! Limits of a bench: printed beside the figures, and reported by the exit code.

use std::{
    ops::{Bound, RangeBounds},
    process::ExitCode,
};

/// The limits of a bench, and the number of those missed.
pub(crate) struct Limits {
    /// Relative difference of figures of equal programs from run to run.
    noise: f64,
    n_missed: usize,
}

impl Limits {
    /// Returns a bench without limits yet, whose figures differ by a share from run to run.
    pub(crate) fn with_noise(noise: f64) -> Self {
        Self { noise, n_missed: 0 }
    }

    /// Requires a figure to be within limits: `least..` or `..=most`.
    #[expect(clippy::print_stdout, reason = "a bench prints what it measured")]
    pub(crate) fn keep(&mut self, what: &str, found: f64, within: impl RangeBounds<f64>) {
        // NaN is within no limits.
        let (limit, is_kept) = match (within.start_bound(), within.end_bound()) {
            (Bound::Included(least), _) => (
                format!("at least {least}"),
                found >= least * (1.0 - self.noise),
            ),
            (_, Bound::Included(most)) => (
                format!("at most {most}"),
                found <= most * (1.0 + self.noise),
            ),
            _ => ("any".to_owned(), true),
        };
        let verdict = if is_kept { "" } else { ": MISSED" };
        self.n_missed += usize::from(!is_kept);
        println!("limit  {what:<52} {found:>9.2}, {limit}{verdict}");
    }

    /// Returns the exit code: 1 if a limit is missed by more than noise.
    #[expect(clippy::print_stdout, reason = "a bench prints what it measured")]
    pub(crate) fn end(self) -> ExitCode {
        if self.n_missed == 0 {
            return ExitCode::SUCCESS;
        }
        println!(
            "{} limits missed by more than the {:.0} % that runs differ by",
            self.n_missed,
            100.0 * self.noise
        );
        ExitCode::FAILURE
    }
}
