//! Shows how often candidates hold, with what confidence, and why the others fail.
//!
//! One table and its chart for all objects (`success`): a row for each object and generator. This
//! crate links the stage `screen` and not the other way around: editing it screens nothing again.

mod report;
mod success;

pub use report::ScreenReport;
pub use success::{SuccessMetrics, SuccessReport};
