//! Draws candidate motions from a trained grasping function, and measures them.
//!
//! One unit per object: the object's feature is computed once per resting orientation; latent codes
//! come from the prior, from about demonstrations, or along a path between two of them; they are
//! decoded at equal times from far to the grasp, with their exact rates, and put into the object's own
//! frame. Joint positions are kept within the hand's limits; nothing else is judged here.
//! How plausible and different the motions are says crate `report-sample`.

mod config;
mod draw;
mod error;
pub mod inputs;
mod motions;
mod recording;
pub mod room;
mod stage;

pub use config::{Epoch, Rests, SampleConfig};
pub use error::SampleError;
pub use stage::{Sample, SampleMetrics};
