//! Trains the continuous grasping function on robot trajectories.
//!
//! All trajectories of the chosen objects are gathered into one training set: each is expressed above
//! the table on which its object lay, in the resting orientation of the object that is nearest to the
//! recorded one. The network and its losses are those of crate `cgf`; the checkpoint is two files,
//! weights as safetensors and everything else as JSON. What shows how the training went is in crate
//! `report-train`.

mod by_split;
mod config;
mod error;
mod resume;
pub mod set;
mod stage;

pub use by_split::{BySplit, SPLITS};
pub use config::TrainConfig;
pub use error::TrainError;
pub use stage::{Train, TrainMetrics, hand};
