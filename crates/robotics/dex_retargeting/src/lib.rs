//! Retargets a person's hand by the configuration files of dex-retargeting, unchanged: the same objectives, solved to
//! their minima.
//!
//! ```
//! use dex_retargeting::{Config, Follower, Problem};
//!
//! let config: Config = "
//! retargeting:
//!   type: vector
//!   urdf_path: allegro_right.urdf
//!   target_origin_link_names: [ base_link, base_link ]
//!   target_task_link_names: [ link_15.0_tip, link_3.0_tip ]
//!   target_link_human_indices: [ [ 0, 0 ], [ 4, 8 ] ]
//!   scaling_factor: 1.0
//!   low_pass_alpha: 0.2
//! "
//! .parse()?;
//! let urdf = include_str!("../../../../data/robots/allegro_right.urdf");
//! let problem = Problem::new(&config, urdf)?;
//! let mut follower = Follower::new(&problem);
//! // The index finger straight, 12 cm ahead, and the thumb bent before the palm.
//! let mut landmarks_m = [[0.0; 3]; 21];
//! landmarks_m[4] = [0.06, 0.05, 0.03];
//! landmarks_m[8] = [0.0, 0.03, 0.12];
//! let followed = follower.step(&landmarks_m)?;
//! assert_eq!(followed.posture.q.len(), problem.model().dof());
//! assert!(followed.error_m < 0.03, "{}", followed.error_m);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A [`Config`] is a file as the library reads it; a [`Problem`] is what it says of a robot; a [`Follower`] solves one
//! frame after the other, from the frame before. The objectives are those of version 0.5.0 of the library
//! (Qin et al., "`AnyTeleop`: A General Vision-Based Dexterous Robot Arm-Hand Teleoperation System", 2023; its
//! `dexpilot` after Handa et al., "`DexPilot`: Vision Based Teleoperation of Dexterous Robotic Hand-Arm System", 2020):
//!
//! | type | follows | loss, by the distance in meters |
//! | --- | --- | --- |
//! | `position` | landmarks, with the origins of links | smooth L1 by axis, mean over axes and links |
//! | `vector` | scaled vectors between landmarks, with those between links | smooth L1 of the length, mean over vectors |
//! | `dexpilot` | vectors between fingertips, and from the wrist to each | the same, weighted; a pinch is closed |
//!
//! To each is added `normal_delta` times the squared motion of all coordinates since the frame before. The library
//! stops its search early, since the value that it watches leaves this term out, while its gradient has it; here every
//! search ends where no more than 0.4 µm of the objective is to be gained. A hand with a free root that is followed far
//! worse than usual is searched afresh, and moves to a better minimum if that pays for the motion within a few frames.
//!
//! - Meters and radians; positions are those of the robot's independent joints, in its model's order.
//! - No position leaves its limits in the URDF; the library widens them by 1e-3, and so does
//!   [`Problem::with_limit_slack`]. Limits of joints that mimic others are passed over, as in the library.
//! - Without `add_dummy_free_joint` the root link stands still, and landmarks are along its axes: [`wrist_axes`] are
//!   those that the library's detector gives them. With it, the root is placed in the landmarks' frame.
//! - A joint that `target_joint_names` leaves out, and that mimics none, stays where it is nearest to 0; the library
//!   asks for its position at each frame.
//!
//! The crate reads no file: `urdf_path` is for the caller to find.

mod aim;
mod config;
mod error;
mod follower;
mod objective;
mod pinch;
mod problem;
mod sequence;
mod wrist;

pub use config::Config;
pub use error::{ConfigError, ProblemError};
pub use follower::{Followed, Follower};
pub use objective::{LinkVector, Objective, ObjectiveKind};
pub use problem::Problem;
pub use sequence::{Sequence, Showing, retarget};
pub use wrist::wrist_axes;

/// Number of landmarks: the wrist; thumb, index, middle, ring and little finger, four each from base to tip.
pub const LANDMARKS: usize = posture::KEYPOINTS;
