//! Depth images: what a camera sees of an object on a table, and what follows from it.
//!
//! A [`DepthView`] is an image of depths with the camera's intrinsics, its pose and the pixels of one object.
//! [`render()`] makes one of a mesh, [`StereoNoise`] gives it the errors of a stereo camera; [`table_plane()`] finds the
//! table, [`largest_object`] the pixels of an object on it, [`cloud()`] cleaned points of the object with their normals.
//!
//! ```
//! use depth_view::{Intrinsics, RenderedObject, cloud, looking_at, render, table_plane};
//! use geometry::TriMesh;
//! use nalgebra::Point3;
//! use spatial::Pose;
//!
//! let mesh = TriMesh::cuboid(Point3::new(-0.03, -0.03, 0.0), Point3::new(0.03, 0.03, 0.1));
//! let object = RenderedObject { mesh: &mesh, world_from_object: Pose::identity() };
//! let camera = looking_at(Point3::new(0.5, 0.0, 0.4), Point3::new(0.0, 0.0, 0.05));
//! let rendered = render(&object, &Intrinsics::of_field(320, 240, 1.0), &camera);
//! let table = table_plane(&rendered.view)?;
//! assert!(table.height_m.abs() < 1e-6 && table.up.z > 1.0 - 1e-6);
//! assert!(cloud(&rendered.view).iter().all(|seen| seen.point_in_world.z < 0.101));
//! # Ok::<(), depth_view::ViewError>(())
//! ```
//!
//! The camera's frame has x right, y down and z forward; a pixel's depth is along z, in meters, and its center has whole
//! coordinates. The world's frame is any that is fixed; in a rendered one the table is z = 0. Lens distortion is not
//! modeled: images are rectified. Everything is a pure function of its arguments.

mod cloud;
mod error;
mod noise;
mod render;
mod segment;
mod table;
mod view;

pub use cloud::{SeenPoint, cloud};
pub use error::ViewError;
pub use noise::StereoNoise;
pub use render::{Rendered, RenderedObject, looking_at, render};
pub use segment::largest_object;
pub use table::{TablePlane, table_plane};
pub use view::{DepthView, Intrinsics};
