//! Figures of each set of motions.

use std::marker::PhantomData;

use cgf::Split;
use dataflow::{Figure, Figures, Gather, MissingFigure};

/// The sets of motions in the order in which figures of them stand.
pub const SPLITS: [Split; 3] = [Split::Training, Split::HeldOut, Split::Unseen];

/// The end of the names of a set's figures.
const ENDS: [&str; 3] = ["", "_held_out", "_unseen"];

/// A figure of each of [`SPLITS`], where it is known, e.g. `loss`, `loss_held_out` and `loss_unseen`.
pub struct BySplit<F>(PhantomData<F>);

impl<F: Figure> Gather for BySplit<F> {
    type Value = [Option<f64>; 3];

    fn write(field: &str, values: &Self::Value, figures: &mut Figures) {
        for (value, end) in values.iter().zip(ENDS) {
            figures.extend(value.map(|value| (format!("{field}{end}"), value)));
        }
    }

    fn read(field: &str, figures: &Figures) -> Result<Self::Value, MissingFigure> {
        Ok(ENDS.map(|end| figures.get(&format!("{field}{end}")).copied()))
    }

    fn gather<'a>(partitions: impl Iterator<Item = &'a Self::Value>) -> Self::Value {
        let partitions: Vec<&Self::Value> = partitions.collect();
        std::array::from_fn(|split| {
            <Option<F> as Gather>::gather(partitions.iter().map(|values| &values[split]))
        })
    }
}
