//! Shows how often candidates hold, with what confidence, and why the others fail.
//!
//! Two tables and their charts for all objects: `success`, a row for each object, generator and
//! origin of the motions, and `rates`, means over the objects with their intervals. This crate links
//! the stage `screen` and not the other way around: editing it screens nothing again.

mod rates;
mod report;
mod success;

pub use rates::{RatesMetrics, RatesReport};
pub use report::ScreenReport;
pub use success::{SuccessMetrics, SuccessReport};
