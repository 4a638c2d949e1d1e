//! Draws candidate motions from a trained grasping function.
//!
//! One unit per object: the object's feature is computed once per resting orientation, latent codes
//! are drawn from the prior or about a demonstration of the same object, decoded at equal times from
//! far to the grasp, and put into the object's own frame. Joint positions are kept within the hand's
//! limits; nothing else is judged here.

mod config;
mod draw;
mod error;
mod stage;

pub use config::{Epoch, Rests, SampleConfig};
pub use error::SampleError;
pub use stage::Sample;
