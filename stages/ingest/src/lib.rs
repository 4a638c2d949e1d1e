//! Reads recordings of people grasping objects: the stage `ingest`.
//!
//! It reads a dataset from disk and makes three artifacts: `shapes`, one per object, with its geometry
//! and inertia; `demonstrations`, one per recording, each the reach of a hand up to the last image
//! before the object moves; and `objects`, one per object, its shape with the resting orientations
//! observed.
//!
//! Output is in the object's own frame. Unusable recordings are skipped with their reason; sizes in
//! input files are checked before memory is allocated, so that no file can exhaust it.
//!
//! A dataset's reader turns files into one struct of parsed frames; the rest is independent of the
//! dataset: the object's rest and departure, the table, the reach, the mirror image.
//! `DexYCB` (Chao et al., *DexYCB: A Benchmark for Capturing Hand Grasping of Objects*, 2021), `HO-Cap`
//! (Wang et al., *HO-Cap: A Capture System and Dataset for 3D Reconstruction and Pose Tracking of
//! Hand-Object Interaction*, 2024) and plain tracks have readers.
//!
//! Landmarks come from the dataset's labels or from the user's hand model ([`ManoModel`]). This crate
//! does not read images and does not retarget.

mod after_grasp;
mod config;
mod demonstration_recording;
mod departure;
mod dexycb;
mod error;
#[cfg(test)]
mod fixture;
mod folders;
mod fuse;
mod hocap;
mod ingest;
mod labels;
mod mano;
mod mirror;
mod npz;
mod place;
mod reach;
pub mod read;
mod reader;
mod recording;
pub mod report;
mod selection;
mod table_pose;
mod terms;
mod tracks;
mod yaml;
mod ycb;

pub use config::{AddedMesh, Format, IngestConfig, Landmarks, ReachRule, TableRule};
pub use error::{IngestError, RecordingError};
pub use ingest::{
    Agreement, DemonstrationMetrics, Demonstrations, Ingest, Objects, ShapeMetrics, Shapes,
};
pub use mano::{ManoError, ManoModel, ShapedHand};
pub use npz::NpzError;
pub use selection::Split;
pub use yaml::YamlError;
