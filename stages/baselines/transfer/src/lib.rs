//! Carries retargeted demonstrations to other objects: baselines for a learned generator.
//!
//! One unit per object. A demonstration of another object is carried over in the frame of the objects' boxes on the
//! table: box center to box center, long side to long side. Or, of the object's own demonstrations, the mean for each
//! resting orientation. Nothing is adapted to the object's shape and nothing is judged here: `refine` and `screen`
//! treat these candidates as any others.

mod config;
mod error;
mod footprint;
mod mean;
mod transfer;

pub use config::{TransferConfig, TransferSource};
pub use error::TransferError;
pub use transfer::{Transfer, TransferMetrics};
