//! From an object's mesh to what grasping and physics need to know of it: points on its surface, convex parts, mass
//! and inertia, the orientations in which it rests.
//!
//! ```
//! use geometry::solid::{loft, rounded_rectangle};
//! use object_shapes::{MeshedObject, ShapeOptions};
//!
//! let section = |height_m: f64| rounded_rectangle(0.02, 0.03, 0.004, height_m);
//! let carton = MeshedObject {
//!     name: "carton",
//!     mass_kg: 0.2,
//!     mesh: &loft(&[section(-0.05), section(0.05)]),
//!     options: &ShapeOptions { points_n: 512, max_convex_parts_n: 1, part_tolerance_m: 1e-4 },
//!     seed: 7,
//! };
//! let object = carton.unseen()?;
//! // It most often lies on its largest side.
//! let lying = object.rests[0].rest;
//! assert!(lying.up_in_object.x.abs() > 0.99 && (lying.height_m - 0.02).abs() < 1e-6);
//! # Ok::<(), geometry::GeometryError>(())
//! ```
//!
//! Lengths are in meters, in the mesh's own frame, and masses in kilograms.

mod config;
mod objects;
mod rests;

pub use config::ShapeOptions;
pub use objects::{MeshedObject, mesh, mesh_of};
pub use rests::rests;
