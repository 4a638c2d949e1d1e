//! Intervals of means over objects, and a test of paired verdicts.
//!
//! - [`bootstrap_mean`]: the mean of the objects' shares and its interval, by resampling objects.
//!   Motions of one object are alike, so that an interval for independent trials, such as
//!   [`wilson`](schemas::tally::wilson), is right for those of one object, and too narrow for those
//!   of many.
//! - [`mcnemar()`]: whether two settings differ, by their verdicts on the same motions.
//!
//! ```
//! use schemas::tally::wilson;
//! use statistics::bootstrap_mean;
//!
//! // Four objects, 100 motions each: how many of an object hold tells of that object alone.
//! let objects = bootstrap_mean(&[0.95, 0.90, 0.60, 0.15]);
//! let [low, high] = wilson(260.0, 400.0);
//! assert_eq!(objects.mean, 0.65);
//! assert!(objects.low < low && high < objects.high);
//! ```
//!
//! Equal arguments give equal results. This crate does no input or output; no stage links it, so
//! that editing it makes reports alone again.

mod mcnemar;
mod normal;
mod resampling;

pub use mcnemar::mcnemar;
pub use resampling::{MeanInterval, bootstrap_mean};
