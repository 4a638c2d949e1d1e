//! Shows how plausible and how different the motions are that were drawn.
//!
//! One table and its charts for each object (`sampling`): limits, depth in object and table, distance
//! from the demonstrations and from each other. Where all motions are one, the function has
//! collapsed. This crate links the stage `sample` and not the other way around: editing it draws
//! nothing again.

mod charts;
mod measure;
mod report;
mod sampling;

pub use report::SampleReport;
pub use sampling::{SamplingMetrics, SamplingReport};
