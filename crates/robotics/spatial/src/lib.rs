//! Frames as types, rigid transforms between them, and the one order of quaternion numbers.
//!
//! ```
//! use nalgebra::{Isometry3, Point3, Vector3};
//! use spatial::{Object, Palm, Pose};
//!
//! let object_from_palm =
//!     Pose::<Object, Palm>::new(Isometry3::new(Vector3::new(0.0, 0.0, 0.1), Vector3::zeros()));
//! let point_in_palm = Point3::origin();
//! assert_eq!(object_from_palm * point_in_palm, Point3::new(0.0, 0.0, 0.1));
//! ```
//!
//! Poses are right-handed and in meters. Quaternions are always `[x, y, z, w]` with `w ≥ 0`, so
//! that equal rotations are equal bytes.
//! This crate does no input or output and knows nothing of robots.

mod frame;
mod pose;
mod pose_segment;
mod rest;
mod rotation;
mod segment;
mod twist;

pub use frame::{Base, Camera, Object, Palm, Table, World};
pub use pose::{InvalidPose, Pose};
pub use pose_segment::{Peaks, PoseSegment, PoseState, quintic};
pub use rest::RestingPose;
pub use rotation::{InvalidRotation, quaternion_xyzw, rot6d, rotation_from_rot6d, xyzw};
pub use segment::{Coefficient, QuinticSegment};
pub use twist::Twist;
