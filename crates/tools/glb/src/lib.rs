//! Motions of a robot and an object as glTF 2.0 animations in one binary file, `.glb`.
//!
//! ```
//! use glb::{Moment, MotionScene, ObjectMesh};
//! use robot::RobotModel;
//! use spatial::Pose;
//!
//! let hand = RobotModel::from_urdf(
//!     "<robot name='r'><link name='palm'><collision><geometry><sphere radius='0.03'/></geometry></collision></link></robot>",
//! )?;
//! let object = ObjectMesh { vertices_m: vec![[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]], triangles: vec![[0, 1, 2]] };
//! let moment = |time_s: f64| Moment {
//!     table_from_object: Pose::from_parts([0.0, 0.0, time_s], nalgebra::UnitQuaternion::identity()),
//!     ..Moment::still(time_s)
//! };
//! let scene = MotionScene { name: "lift", robot: &hand, object: &object, about: &[] };
//! let bytes = scene.to_glb(&[moment(0.0), moment(1.0)])?;
//! let player = glb::Player::read(&bytes)?;
//! assert!((player.table_from("object", 0.5).unwrap().translation.z - 0.5).abs() < 1e-6);
//! assert!(ObjectMesh::of_robot(&hand, &[])?.vertices_m.iter().flatten().all(|x| x.abs() < 0.031));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Lengths are meters, times seconds since the first moment. Equal arguments give equal bytes: there
//! is no clock, no path and no version in a file. Between key frames a viewer interpolates; they are
//! chosen so that every moment is shown within [`TOLERANCE_M`]. glTF is as in Khronos, *glTF 2.0
//! Specification* (ISO/IEC 12113:2022).
//!
//! It opens no file, knows no lake and judges nothing.

mod contacts;
mod error;
mod file;
mod keyframes;
mod motion;
mod play;
mod scene;
mod shapes;
mod simplify;
mod write;

pub use contacts::{CONTACTS_N, Contact};
pub use error::GlbError;
pub use keyframes::TOLERANCE_M;
pub use motion::{Moment, MotionScene, ObjectMesh};
pub use play::Player;
pub use simplify::simplified;
