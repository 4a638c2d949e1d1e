//! Diversity of the motions for an object: of the candidates, and of those that succeed.
//!
//! ```
//! use diversity::{ComparedMotion, Diversity};
//! use motion::{HandRates, Step};
//! use nalgebra::Isometry3;
//! use spatial::{Object, Pose};
//!
//! let grasp = |x: f64| Step {
//!     time_s: 0.0,
//!     frame_from_palm: Pose::new(Isometry3::translation(x, 0.0, 0.1)),
//!     q_rad: vec![0.5],
//!     rates: HandRates::<Object>::zero(1),
//! };
//! let grasps = [grasp(-0.02), grasp(0.02)];
//! let motions = grasps.each_ref().map(|grasp| ComparedMotion {
//!     table_from_object: Pose::identity(),
//!     steps: vec![grasp],
//! });
//! let spread = Diversity::of(&motions).at_grasp;
//! assert!((spread.palm_m - 0.02).abs() < 1e-12);
//! assert_eq!(spread.q_rad, 0.0);
//! ```
//!
//! Only motions in which the object lies alike are compared. This crate does no input or output.

mod spread;

pub use spread::{ComparedMotion, Diversity, distance};
