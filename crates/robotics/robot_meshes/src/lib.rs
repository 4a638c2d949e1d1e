//! Robots loaded from their files: a URDF, and the meshes that it names, as convex parts.
//!
//! ```no_run
//! let path = std::path::Path::new("my_hand.urdf");
//! let hand = robot_meshes::load(path)?;
//! assert!(hand.model.without_mesh_shape().is_none());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A collision mesh that cannot be found and read is an error: a hand never loses its contact
//! geometry silently. STL (binary and text) and OBJ are read. Visual meshes are never opened.
//! Objects get the same convex parts ([`geometry::convex_parts`]); equal bytes give equal parts,
//! and a process computes them once.

mod error;
mod hand_mismatch;
mod load;
mod place;
mod shapes;
mod sources;

pub use error::LoadError;
pub use hand_mismatch::HandMismatch;
pub use load::{LoadedRobot, load};
pub use place::find;
pub use shapes::{convex_bodies, with_mesh_shapes};
pub use sources::{MODEL_FORM, URDF_FORM, sources};
