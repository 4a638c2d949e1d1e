//! Reads recordings of people grasping objects: the stage `ingest`.
//!
//! It takes a dataset, as it lies on disk, and makes three artifacts: `shapes`, one per object, with
//! all that follows from its mesh and its mass; `demonstrations`, one per recording, each the reach
//! of a hand up to the last image before the object moves; and `objects`, one per object, its shape
//! with the orientations in which it was seen to lie.
//!
//! Everything comes out in the object's own frame. What cannot be used is skipped with its reason;
//! outside bytes are checked before memory is reserved for them, so that no file can exhaust it.
//!
//! A dataset's reader turns files into one struct of parsed frames; all that follows knows no
//! dataset: where the object rests and leaves, the table, the reach, the mirror image.
//! `DexYCB` (Chao et al., *DexYCB: A Benchmark for Capturing Hand Grasping of Objects*, 2021) and
//! plain tracks have one.
//!
//! Landmarks are those that the dataset annotates, or those of a hand model of the user's
//! ([`ManoModel`]). This crate does not look at images and does not retarget.

mod aftermath;
mod config;
mod dexycb;
mod error;
mod film;
#[cfg(test)]
mod fixture;
mod folders;
mod fuse;
mod labels;
mod mano;
mod mirror;
mod npz;
mod objects;
mod place;
mod reach;
pub mod read;
mod reader;
mod recording;
mod rests;
mod selection;
mod stage;
mod still;
mod table;
mod tracks;
mod yaml;
mod ycb;

pub use config::{AddedMesh, Format, IngestConfig, Landmarks, ReachRule, TableRule};
pub use error::{IngestError, Unusable};
pub use mano::{ManoError, ManoModel, ShapedHand};
pub use npz::NpzError;
pub use selection::Split;
pub use stage::{
    Agreement, DemonstrationMetrics, Demonstrations, Ingest, Objects, ShapeMetrics, Shapes,
};
pub use yaml::YamlError;
