//! Counts by verdict, as figures.

use dataflow::{Figure, Figures, Gather, MissingFigure, Sum};
use schemas::rollouts::Verdict;

/// A count for each of [`Verdict::ALL`], e.g. `held_n`.
#[derive(Debug, Clone, Copy)]
pub enum ByVerdict {}

impl Gather for ByVerdict {
    type Value = [f64; Verdict::ALL.len()];

    fn write(_field: &str, counts: &Self::Value, figures: &mut Figures) {
        figures.extend(Verdict::ALL.map(name).into_iter().zip(*counts));
    }

    fn read(_field: &str, figures: &Figures) -> Result<Self::Value, MissingFigure> {
        let mut counts = Self::Value::default();
        for (count, verdict) in counts.iter_mut().zip(Verdict::ALL) {
            *count = <Sum as Gather>::read(&name(verdict), figures)?;
        }
        Ok(counts)
    }

    fn gather<'a>(partitions: impl Iterator<Item = &'a Self::Value>) -> Self::Value {
        partitions.fold(Self::Value::default(), |mut all, counts| {
            for (all, count) in all.iter_mut().zip(counts) {
                *all = Sum::of([*all, *count].into_iter());
            }
            all
        })
    }
}

fn name(verdict: Verdict) -> String {
    format!("{}_n", verdict.as_str())
}
