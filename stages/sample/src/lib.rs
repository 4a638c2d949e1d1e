//! Draws candidate motions from a trained grasping function, and measures them.
//!
//! One unit per object: the stage reads the checkpoint and the object, and [`sampling`] draws the motions. With
//! `draws` above 1, a motion whose hand is too deep in object or table is drawn again. A kept motion is a row of
//! `candidates`; every draw is a row of `draws`, a refused one with its reason. Its [`report`] measures the motions'
//! plausibility and diversity.

mod config;
mod error;
pub mod inputs;
mod recording;
pub mod report;
mod rows;
mod sample;

pub use config::{CheckpointWeights, RestingPoses, SampleConfig, SeenShape};
pub use error::SampleError;
pub use rows::sampled_object;
pub use sample::{Drawing, Sample, SampleMetrics};
