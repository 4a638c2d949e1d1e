//! The meshes that a URDF names: where they lie, and the convex parts that a robot collides with.
//!
//! ```no_run
//! let path = std::path::Path::new("my_hand.urdf");
//! let model = robot::RobotModel::from_urdf(&std::fs::read_to_string(path)?)?;
//! let model = robot_meshes::with_mesh_shapes(model, path)?;
//! assert!(model.without_mesh_shape().is_none());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A mesh that a link collides with is found and read, or it is an error: a hand never loses what it
//! touches with. STL (binary and text) and OBJ are read. Meshes that are only drawn are never opened.
//! The parts are those that objects get, too ([`geometry::convex_parts`]); equal bytes give equal parts,
//! and a program makes them once.

mod error;
mod place;
mod shapes;
mod sources;

pub use error::MeshError;
pub use place::find;
pub use shapes::{convex_bodies, with_mesh_shapes};
pub use sources::sources;
