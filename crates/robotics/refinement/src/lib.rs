//! Moves a motion of a hand as little as possible, out of object and table and to a grasp that balances.
//!
//! ```
//! use geometry::{DistanceField, TriMesh};
//! use motion::{Motion, Step};
//! use nalgebra::{Isometry3, Point3, Vector3};
//! use posture::{Environment, Hand};
//! use refinement::{Payload, RefinementConfig, Refiner};
//! use spatial::{Pose, RestingPose};
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
//! // A box of 6 × 8 × 10 cm stands on the table, and the palm goes 10 cm into its side.
//! let corner = Point3::new(0.03, 0.04, 0.05);
//! let field = DistanceField::new(&TriMesh::cuboid(-corner, corner), 0.005, 0.025)?;
//! let rest = RestingPose { up_in_object: Vector3::z_axis(), height_m: 0.05 };
//! let environment = Environment::new(field.ok_or("a box has a surface")?, rest);
//! let step = |time_s: f64| Step {
//!     time_s,
//!     frame_from_palm: Pose::new(Isometry3::translation(-0.23 + 0.2 * time_s, 0.0, 0.05)),
//!     q_rad: hand.mid_range.clone(),
//!     rates: (),
//! };
//! let steps = [0.0, 0.25, 0.5, 0.75, 1.0].map(step);
//! let motion = Motion::new(&hand.model.joint_names(), steps.to_vec())?.differentiated()?;
//!
//! let payload = Payload { center_of_mass_in_object: Point3::origin(), mass_kg: 0.3 };
//! let config = RefinementConfig::default();
//! let refined = Refiner::new(&hand, &config, payload).refine(&environment, &motion)?;
//! assert_eq!(refined.motion.steps().len(), 5);
//! assert!(refined.palm_moved_m > 0.02 && refined.approach_penetration_m < 0.005);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A motion drawn from a function is centimeters off where millimeters decide: links pass through the object,
//! tips end beside its surface. A [`Refiner`] moves it so that its hand keeps out of object and table over the whole
//! reach, keeps clear of the object until it closes, and reaches a grasp with its fingertips on the surface, where
//! their forces balance; over its last tenth it squeezes along these forces. The grasp is refined first, and the
//! approach is rebuilt backward from it. [`Refined::residual_m2`] says how well that succeeded, and [`choose`] picks the
//! best of several draws by it.
//!
//! - Everything is computed in the object's frame, in `f64`, in meters, seconds, radians and newtons.
//! - At no step does a joint leave its limits.
//! - Equal arguments give equal motions, whatever a refiner refined before.
//!
//! This crate does no input or output and simulates nothing: it knows nothing of tables or files.

mod balance;
mod choice;
mod config;
mod error;
#[cfg(test)]
mod fixture;
mod grasp;
mod refiner;

pub use choice::{Choice, choose};
pub use config::RefinementConfig;
pub use error::RefinementError;
pub use refiner::{Payload, Refined, Refiner};
