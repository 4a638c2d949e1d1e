//! Trains the continuous grasping function on robot trajectories.
//!
//! All trajectories of the selected objects form one training set: each is expressed in the table
//! frame, in the object's resting orientation nearest to the recorded one. The network and its losses
//! are those of crate `cgf`; the checkpoint is two files, weights as safetensors and metadata as JSON.
//! Its [`report`] shows how a training went.

mod accepted;
mod by_split;
mod config;
mod error;
pub mod report;
mod resume;
mod train;
pub mod training_set;

pub use by_split::BySplit;
pub use config::TrainConfig;
pub use error::TrainError;
pub use train::{Train, TrainMetrics, hand};
