//! Turns the landmarks of a person's hand over time into a motion of a robot hand.
//!
//! ```
//! use geometry::TriMesh;
//! use nalgebra::{Point3, Vector3};
//! use posture::{Environment, Hand, KEYPOINTS};
//! use retargeting::{LandmarkStep, RetargetingConfig, retarget, settled, survey};
//! use spatial::RestingPose;
//!
//! let urdf = include_str!("../../../../data/robots/allegro_right.urdf");
//! let table = r#"
//!     side = "right"
//!     scale = 1.1
//!     points = [
//!         { keypoint = "thumb_tip", link = "link_15.0_tip", weight = 1.0, tip_radius_m = 0.012 },
//!         { keypoint = "index_tip", link = "link_3.0_tip", weight = 1.0, tip_radius_m = 0.012 },
//!         { keypoint = "wrist", link = "base_link", offset_m = [0.0, 0.0, -0.095], weight = 0.3 },
//!     ]
//! "#;
//! let hand = Hand::new(robot::RobotModel::from_urdf(urdf)?, &table.parse()?)?;
//!
//! // A box of 6 × 8 × 10 cm stands on the table, recorded with a tilt of 3°.
//! let corner = Point3::new(0.03, 0.04, 0.05);
//! let object = survey(&TriMesh::cuboid(-corner, corner), 0.005)?.ok_or("a box has a surface")?;
//! let recorded = RestingPose {
//!     up_in_object: nalgebra::Unit::new_normalize(Vector3::new(0.05, 0.0, 1.0)),
//!     height_m: 0.05,
//! };
//! let rest = settled(&object.hull_in_object, &object.center_of_mass_in_object, &recorded);
//! assert!(rest.up_in_object.angle(&Vector3::z_axis()) < 1e-3);
//! let environment = Environment::new(object.field, rest);
//!
//! // A hand comes from the side: its wrist, and fingers of 9 cm ahead of it.
//! let step = |time_s: f64| {
//!     let mut keypoints_m = [[-0.16 + 0.1 * time_s, 0.0, 0.02]; KEYPOINTS];
//!     for (idx, keypoint) in keypoints_m.iter_mut().enumerate().skip(1) {
//!         keypoint[0] += 0.03 * ((idx - 1) % 4) as f64;
//!         keypoint[1] = 0.04 - 0.02 * ((idx - 1) / 4) as f64;
//!     }
//!     LandmarkStep { time_s, keypoints_m }
//! };
//! let steps = [0.0, 0.1, 0.2].map(step);
//! let config = RetargetingConfig::default();
//! let retargeted = retarget(&hand, &environment, &config, &steps)?.ok_or("there are steps")?;
//! assert_eq!(retargeted.motion.steps().len(), 3);
//! for (q, joint) in retargeted.motion.grasp().q_rad.iter().zip(hand.model.joints()) {
//!     assert!((joint.lower..=joint.upper).contains(q));
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Each step becomes a pose of the robot's palm and a vector of joint positions ([`retarget()`]),
//! by the position-based retargeting of Ye et al., "Learning Continuous Grasping Function with a
//! Dexterous Hand from Human Demonstrations" (RA-L 2023, §III-A): points of the robot follow
//! landmarks of the human hand, within the joint limits, and change little from step to step.
//! Further terms, not in the paper, keep links out of the object and above the table, keep them clear
//! of the object until the hand closes, and draw fingertips to the surface where the person's touched
//! it. Weight 0 disables a term ([`RetargetingConfig`]).
//!
//! Steps are solved backward from the grasp, as in the paper's time, so that the grasp, which matters
//! most, does not depend on the steps before it. [`survey()`] computes what a step asks of the object, once for
//! each, and [`settled`] how it lies without the recording's errors.
//!
//! - Everything is computed in the object frame, in `f64`, in meters, seconds and radians.
//! - Positions never leave the joint limits.
//! - Equal arguments give equal motions.
//!
//! This crate does no input or output: it knows nothing of recordings, tables or files, and it judges no motion.

mod config;
mod error;
#[cfg(test)]
mod fixture;
mod follow;
mod goal;
mod landmarks;
mod live;
#[cfg(test)]
mod other_hands;
mod retarget;
mod settle;
mod smoothing;
mod survey;
mod tracking;

pub use config::{Loss, RetargetingConfig, Wrist};
pub use error::RetargetingError;
pub use landmarks::LandmarkStep;
pub use live::{LivePosture, LiveRetargeting};
pub use retarget::{Retargeted, retarget, tracking};
pub use settle::settled;
pub use survey::{Survey, survey};
pub use tracking::Tracking;
