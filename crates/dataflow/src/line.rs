//! The lines of `run`: the outcome of an output, in the user's terms.

use std::any::TypeId;

use crate::{
    stage::{Output, Stage},
    summary::{Summarize, Summary, summarize_fn},
};

/// How a report summarizes one output of its stage, e.g. `24 recordings → 23 demonstrations`.
pub struct Line<O: Output>(pub fn(&Summary<O::Metrics>) -> String);

/// The lines of a stage's outputs, one each.
pub type Lines<S> = &'static [&'static dyn LineOf<S>];

/// A [`Line`] of an output of a stage without its type.
pub trait LineOf<S: Stage>: Sync {
    /// The output that it summarizes.
    fn output(&self) -> TypeId;
    /// Returns the function that summarizes stored results.
    fn summarize_fn(&self) -> Summarize;
}

impl<O: Output> LineOf<O::Stage> for Line<O> {
    fn output(&self) -> TypeId {
        TypeId::of::<O>()
    }

    fn summarize_fn(&self) -> Summarize {
        summarize_fn(self.0)
    }
}
