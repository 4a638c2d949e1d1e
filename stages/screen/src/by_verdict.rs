//! Counts by verdict, as figures.

use dataflow::{Aggregate, MetricValues, MissingMetric, Sum};
use schemas::{rollouts::Verdict, tally::Tally};

/// A [`Tally`] by verdict, e.g. `held_n`.
#[derive(Debug, Clone, Copy)]
pub enum ByVerdict {}

impl Aggregate for ByVerdict {
    type Value = Tally<Verdict>;

    fn write(_field: &str, tally: &Self::Value, figures: &mut MetricValues) {
        figures.extend(tally.iter().map(|(verdict, n)| (name(verdict), n as f64)));
    }

    fn read(_field: &str, figures: &MetricValues) -> Result<Self::Value, MissingMetric> {
        let count = |verdict: Verdict| {
            let n = <Sum as Aggregate>::read(&name(verdict), figures)?;
            #[expect(clippy::cast_possible_truncation, reason = "it was a count")]
            let n = n as i64;
            Ok((verdict, n))
        };
        Verdict::ALL.into_iter().map(count).collect()
    }

    fn aggregate<'a>(partitions: impl Iterator<Item = &'a Self::Value>) -> Self::Value {
        partitions.flat_map(Tally::iter).collect()
    }
}

fn name(verdict: Verdict) -> String {
    format!("{}_n", verdict.as_str())
}
