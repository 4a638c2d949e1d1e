//! Shows how often motions succeed at a robot cell.
//!
//! One table for all objects (`trials`): a row for each object and cell. This crate links the stage
//! `dispatch` and not the other way around: editing it sends nothing again.

mod report;
mod trials;

pub use report::DispatchReport;
pub use trials::{TrialsMetrics, TrialsReport};
