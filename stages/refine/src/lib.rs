//! Refines candidate motions against object and table before physics.
//!
//! A motion drawn from a function is centimeters off where millimeters decide: links pass through the object,
//! tips end beside its surface. Each motion is moved as little as possible so that its hand keeps out of object and
//! table over the whole reach, keeps clear of the object until it closes, and reaches a grasp with its fingertips on
//! the surface, where their forces balance; over its last tenth it squeezes along these forces. The grasp is refined
//! first, and the approach is rebuilt backward from it.
//!
//! One unit per object. Of every `draws` consecutive motions with the same resting pose the one with the smallest residual stays a candidate,
//! under its own name and source; the others become its refused draws. Nothing is simulated: `screen` judges every
//! generator alike. At no step does a joint leave its limits.

mod balance;
mod config;
mod error;
#[cfg(test)]
mod fixture;
mod grasp;
mod refiner;
mod stage;

pub use config::RefineConfig;
pub use error::RefineError;
pub use stage::{Refine, RefineMetrics};
