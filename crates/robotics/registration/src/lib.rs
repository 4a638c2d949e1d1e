//! The pose of an object of known shape, from what depth images show of it.
//!
//! ```
//! use completion::Observation;
//! use depth_view::{Intrinsics, RenderedObject, looking_at, render};
//! use geometry::TriMesh;
//! use nalgebra::{Point3, UnitQuaternion, Vector3};
//! use registration::{KnownShape, RegistrationOptions, mean_surface_distance_m, register};
//! use spatial::{Pose, RestingPose};
//!
//! let mesh = TriMesh::cuboid(Point3::new(-0.02, -0.04, 0.0), Point3::new(0.02, 0.04, 0.1));
//! let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.7);
//! let object = RenderedObject { mesh: &mesh, world_from_object: Pose::from_parts([0.03, 0.01, 0.0], turn) };
//! let camera = looking_at(Point3::new(0.5, 0.1, 0.4), Point3::new(0.0, 0.0, 0.05));
//! let view = render(&object, &Intrinsics::of_field(640, 480, 1.0), &camera).view;
//!
//! let standing = RestingPose { up_in_object: Vector3::z_axis(), height_m: 0.0 };
//! let shape = KnownShape::new(&mesh, &[standing])?;
//! let observation = Observation::new(&[view], None)?;
//! let found = register(&shape, &observation, &RegistrationOptions::default())?;
//! let off_m = mean_surface_distance_m(&mesh, &found.best.world_from_object, &object.world_from_object);
//! assert!(off_m < 0.001);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! [`register()`] starts from every known resting orientation of the object and from yaws all round, and moves each start
//! to where the seen points lie on the surface and no surface lies where a camera saw free space. A bad fit is an error,
//! and so are two different poses that fit alike; poses between which the surface is the same, as of a can turned about its
//! axis, are one. Lengths are in meters. Equal arguments give equal poses.
//!
//! What is not done: objects that touch others, colors, and tables that are not level with the resting orientations by more
//! than a few degrees.

mod error;
mod fit;
mod options;
mod register;
mod shape;

pub use error::RegistrationError;
pub use options::{Ambiguous, Freedom, RegistrationOptions};
pub use register::{FittedPose, Registration, Score, register};
pub use shape::{KnownShape, mean_surface_distance_m};
