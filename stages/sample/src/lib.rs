//! Draws candidate motions from a trained grasping function, and measures them.
//!
//! One unit per object: the object's feature is computed once per resting orientation; latent codes
//! come from the prior, from about demonstrations, or along a path between two of them; they are
//! decoded at equal times from far to the grasp, with their exact rates, and put into the object's own
//! frame. Joint positions are kept within the hand's limits; nothing else is judged here.
//! A second output says of each motion how plausible it is (limits, depth in object and table) and how
//! far from the object's demonstrations and from the others: where all are one, the function has
//! collapsed. Charts show the same, the spread of what was drawn beside that of the demonstrations.

mod config;
mod draw;
mod error;
mod motions;
mod quality;
mod recording;
mod room;
mod stage;

pub use config::{Epoch, Rests, SampleConfig};
pub use error::SampleError;
pub use stage::Sample;
