//! Closed shapes of objects from depth images.
//!
//! [`Observation`] gathers what one or several views say of an object on a table: its cleaned points, and which space is
//! free. [`complete()`] closes the shape on the side that no camera saw.
//!
//! ```
//! use completion::{Completion, Observation, complete};
//! use depth_view::{Intrinsics, RenderedObject, looking_at, render};
//! use geometry::TriMesh;
//! use nalgebra::Point3;
//! use spatial::Pose;
//!
//! let mesh = TriMesh::cuboid(Point3::new(-0.03, -0.03, 0.0), Point3::new(0.03, 0.03, 0.1));
//! let object = RenderedObject { mesh: &mesh, world_from_object: Pose::identity() };
//! let camera = looking_at(Point3::new(0.5, 0.1, 0.4), Point3::new(0.0, 0.0, 0.05));
//! let view = render(&object, &Intrinsics::of_field(640, 480, 1.0), &camera).view;
//! let observation = Observation::new(&[view], None)?;
//! let shape = complete(&observation, Completion::Symmetry)?;
//! assert!((shape.mesh.volume_m3() / mesh.volume_m3() - 1.0).abs() < 0.1);
//! # Ok::<(), completion::CompletionError>(())
//! ```
//!
//! The object's frame is one that a view alone defines: z up, its origin on the table below the middle of the shape, x
//! along the first camera's direction over the table. Lengths are in meters.

mod complete;
mod error;
mod observation;
mod superquadric;
mod symmetry;

pub use complete::{CompletedShape, Completion, complete};
pub use error::CompletionError;
pub use observation::Observation;
