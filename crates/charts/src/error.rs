//! Why there is no chart.

/// Why there is no chart.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ChartError {
    /// No number is left that can be drawn.
    #[error(
        "nothing to draw in the chart `{title}`: no number in it is finite (and positive on a logarithmic axis)"
    )]
    Nothing {
        /// The chart's title.
        title: String,
    },
    /// The values of a series are not as many as their names.
    #[error("the series `{series}` of the chart `{title}` has {found} values for {expected} names")]
    WrongCount {
        /// The chart's title.
        title: String,
        /// The series' name.
        series: String,
        /// How many values it has.
        found: usize,
        /// How many names there are.
        expected: usize,
    },
}
