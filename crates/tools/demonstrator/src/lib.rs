//! Synthetic recordings of people grasping objects, in DexYCB's layout on disk.
//!
//! ```no_run
//! use demonstrator::{SampleOutcome, ensure_sample};
//!
//! // Makes what `data/sample/recipe.toml` says, once.
//! match ensure_sample("data/sample".as_ref(), "version 1")? {
//!     SampleOutcome::Written { sequences, frames } => assert!(sequences > 0 && frames > sequences),
//!     SampleOutcome::Kept | SampleOutcome::NoRecipe => {}
//! }
//! # Ok::<(), demonstrator::DemonstratorError>(())
//! ```
//!
//! A recording shows one of fourteen objects among others on a table: a hand approaches, opens, closes
//! on it, lifts it and hands it over. Each grasp is fitted to the object's mesh by least squares over
//! the wrist and the joints, and the best of many fits is used.
//! Lengths are in meters, angles in radians; the table's frame has z up and z = 0 on its surface.
//! Equal recipes give equal bytes, on any number of threads.
//!
//! No person was recorded, and no model of a real hand or scan of a real object is used. There are no
//! images, and the hand is not MANO's.

mod approach;
mod archive;
mod body;
mod camera;
mod error;
mod files;
mod fit;
mod grasp;
mod hand;
mod noise;
mod objects;
mod reach;
mod recipe;
mod sample;
mod scene;

pub use error::DemonstratorError;
pub use objects::object_meshes;
pub use recipe::Recipe;
pub use sample::{RECIPE_FILE, SampleOutcome, ensure_sample};
