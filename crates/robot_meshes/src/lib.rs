//! The meshes that a URDF names: their paths, and their convex parts for collision.
//!
//! ```no_run
//! let path = std::path::Path::new("my_hand.urdf");
//! let model = robot::RobotModel::from_urdf(&std::fs::read_to_string(path)?)?;
//! let model = robot_meshes::with_mesh_shapes(model, path)?;
//! assert!(model.without_mesh_shape().is_none());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A collision mesh that cannot be found and read is an error: a hand never loses its contact
//! geometry silently. STL (binary and text) and OBJ are read. Visual meshes are never opened.
//! Objects get the same convex parts ([`geometry::convex_parts`]); equal bytes give equal parts,
//! and a process computes them once.

mod error;
mod place;
mod shapes;
mod sources;

pub use error::MeshError;
pub use place::find;
pub use shapes::{convex_bodies, with_mesh_shapes};
pub use sources::sources;
