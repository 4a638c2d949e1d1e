//! Draws candidate motions from a trained grasping function, and measures them.
//!
//! One unit per object: the object's feature is computed once per resting orientation; latent codes
//! come from the prior, from the posteriors of demonstrations, or along a path between two of them;
//! they are decoded at equal time steps from far to the grasp, with exact rates, and transformed to
//! the object's own frame. Joint positions are clamped to the hand's limits. With `draws`
//! above 1, a motion whose hand is too deep in object or table is drawn again; every draw is a row of
//! `draws`, a refused one with its reason. Its [`report`] measures
//! the motions' plausibility and diversity.

mod config;
mod draw;
mod error;
pub mod inputs;
mod motions;
pub mod penetration;
mod recording;
pub mod report;
mod stage;

pub use config::{CheckpointWeights, RestingPoses, SampleConfig, SeenShape};
pub use error::SampleError;
pub use stage::{Sample, SampleMetrics};
