//! Finds the poses of objects of known shape in depth images, so that motions are planned for the true meshes where the
//! objects lie.
//!
//! One unit per object of the views; its mesh and the orientations in which it may rest are those of `objects`. The object
//! becomes one that rests only as it was seen, and `completions` says where it lies: what follows reads both as it reads an
//! estimate's.

mod config;
mod register;

pub use config::RegisterConfig;
pub use register::{Register, RegisterMetrics};
