//! Reads recordings of people grasping objects: the stage `ingest`.
//!
//! It takes a dataset in `DexYCB`'s layout (Chao et al., *DexYCB: A Benchmark for Capturing Hand
//! Grasping of Objects*, 2021) and makes two artifacts: `demonstrations`, one per recording, each
//! the reach of a right hand up to the last image before the object moves; and `objects`, one per
//! object that was grasped, with its mesh, mass and resting orientations.
//!
//! Everything comes out in the object's own frame. What cannot be used is skipped with its reason;
//! outside bytes are checked before memory is reserved for them, so that no file can exhaust it.
//!
//! Hand landmarks are those that the dataset annotates; this crate does not evaluate hand models,
//! does not look at images and does not retarget.

mod config;
mod dataset;
mod demonstrations;
mod dexycb;
mod error;
mod film;
mod labels;
mod mano;
mod npz;
mod objects;
pub mod read;
mod recording;
mod rests;
mod stage;
mod still;
mod yaml;
mod ycb;

pub use config::{Hand, IngestConfig};
pub use error::{IngestError, Unusable};
pub use mano::{ManoError, ManoModel, ManoSide, ShapedHand};
pub use npz::NpzError;
pub use stage::Ingest;
pub use yaml::YamlError;
