//! Values of each split of the motions, and their aggregation over partitions.

use std::ops::Index;

use dataflow::{Aggregate, MetricValues, MissingMetric, ScalarAggregate};
use schemas::training::Split;

/// A value of each [`Split`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BySplit<T>([T; Split::ALL.len()]);

impl<T> BySplit<T> {
    /// Returns the values that `value` returns.
    pub fn of(value: impl FnMut(Split) -> T) -> Self {
        Self(Split::ALL.map(value))
    }
}

impl<T> Index<Split> for BySplit<T> {
    type Output = T;

    fn index(&self, split: Split) -> &T {
        &self.0[split as usize]
    }
}

/// A figure of each split in which it is known, e.g. `loss`, `loss_held_out` and `loss_unseen`.
impl<F: ScalarAggregate> Aggregate for BySplit<F> {
    type Value = BySplit<Option<f64>>;

    fn write(field: &str, values: &Self::Value, figures: &mut MetricValues) {
        for split in Split::ALL {
            figures.extend(values[split].map(|value| (name(field, split), value)));
        }
    }

    fn read(field: &str, figures: &MetricValues) -> Result<Self::Value, MissingMetric> {
        let figure = |split| figures.get(&name(field, split)).copied();
        Ok(BySplit::of(figure))
    }

    fn aggregate<'a>(partitions: impl Iterator<Item = &'a Self::Value>) -> Self::Value {
        let partitions: Vec<&Self::Value> = partitions.collect();
        BySplit::of(|split| {
            <Option<F> as Aggregate>::aggregate(partitions.iter().map(|values| &values[split]))
        })
    }
}

fn name(field: &str, split: Split) -> String {
    match split {
        Split::Training => field.to_owned(),
        Split::HeldOut | Split::Unseen => format!("{field}_{}", split.as_str()),
    }
}
