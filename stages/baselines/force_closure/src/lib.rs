//! Fingertip grasps by optimization: the baseline without any demonstration in its grasps.
//!
//! From a random palm about the object whose fingers close on it, the hand is moved so that its fingertips touch the
//! object where the min-weight metric of their contacts is greatest (Li, Culbertson, Burdick and Ames, *`FRoGGeR`: Fast
//! Robust Grasp Generation via the Min-Weight Metric*, 2023), with no link inside the object or the table and every
//! joint within its limits; a search that ends without such a grasp begins anew from another palm. With
//! `max_iterations = 0` nothing is searched: random palms whose fingers close, what every search is compared with.
//!
//! One unit per object. The way to each grasp is the script of [`approach`]; demonstrations give no more than its
//! start. Nothing is simulated: `screen` judges every generator alike.

mod config;
mod contacts;
mod error;
#[cfg(test)]
mod fixture;
mod force_closure;
mod min_weight;
mod search;
mod simplex;

pub use config::ForceClosureConfig;
pub use error::ForceClosureError;
pub use force_closure::{ForceClosure, ForceClosureMetrics};
