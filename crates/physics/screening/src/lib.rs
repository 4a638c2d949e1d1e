//! Verdicts on motions that grasp an object, and their robustness, in simulation.
//!
//! ```
//! use motion::{HandRates, Motion, Step};
//! use nalgebra::{Isometry3, Matrix3, Point3};
//! use screening::{PlacedMotion, PoseError, Screening, ScreeningOptions};
//! use simulation::{ObjectShape, Protocol, SceneConfig, SceneRandomization, Verdict};
//! use spatial::Pose;
//!
//! // A finger that slides, waiting beside a cube of 4 cm.
//! let hand = robot::RobotModel::from_urdf(
//!     r#"<robot name="hand"><link name="palm"/>
//!       <link name="tip"><inertial><mass value="0.1"/>
//!         <inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
//!         <collision><geometry><sphere radius="0.01"/></geometry></collision></link>
//!       <joint name="slide" type="prismatic"><parent link="palm"/><child link="tip"/>
//!         <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"#,
//! )?;
//! let ends = [-0.02, 0.02];
//! let corners_m: Vec<[f64; 3]> =
//!     ends.iter().flat_map(|&x| ends.iter().flat_map(move |&y| ends.map(|z| [x, y, z]))).collect();
//! let cube = ObjectShape {
//!     parts_m: vec![corners_m.iter().map(|&corner| Point3::from(corner)).collect()],
//!     surface: None,
//!     mass_kg: 0.1,
//!     center_of_mass_m: Point3::origin(),
//!     inertia_kg_m2: Matrix3::from_diagonal_element(3e-5),
//! };
//! let waits = |time_s: f64| Step {
//!     time_s,
//!     frame_from_palm: Pose::new(Isometry3::translation(0.3, 0.0, 0.1)),
//!     q_rad: vec![0.0],
//!     rates: HandRates::zero(1),
//! };
//! let motion = Motion::new(&["slide"], vec![waits(0.0), waits(1.0)])?;
//! let on_the_table = Pose::new(Isometry3::translation(0.0, 0.0, 0.02));
//!
//! let scene: SceneConfig = serde_json::from_str(
//!     r#"{"drive": {"stiffness": 20.0, "damping": 1.0, "torque_limit": 0.7, "armature": 0.001}}"#,
//! )?;
//! let protocol: Protocol = serde_json::from_str(r#"{"flexion_joints": ["slide"]}"#)?;
//! let options = ScreeningOptions {
//!     scene: &scene,
//!     protocol: &protocol,
//!     max_penetration_m: 0.005,
//!     max_finger_penetration_m: 0.002,
//!     pose_noise: 0.0,
//!     pose_error: PoseError::default(),
//!     seed: 7,
//! };
//! let motions = vec![PlacedMotion { table_from_object: on_the_table, motion: &motion }];
//! let screening = Screening::new(options, &hand, (cube, &corners_m), motions);
//! let (found, _cpu_s) = screening.judge(&screening.build_scenes()?, |_share| {})?;
//! assert_eq!(found[0].map(|found| found.verdict), Some(Verdict::NotGrasped));
//!
//! let tried = screening.trials(&[0], 2, &SceneRandomization::default(), |_share| {})?;
//! assert_eq!(tried[0].verdicts, [Verdict::NotGrasped; 2]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A [`Screening`] is a hand, an object and motions of that hand. The simulated hand executes each motion on the
//! object in the motion's resting pose: reach, close, squeeze, lift, hold. [`Screening::judge`] says of each how it
//! ended, what was measured and how smooth it was; [`Screening::trials`] repeats some under drawn errors of the
//! object's pose, of friction, of its mass and of the fingers' delay; [`Screening::verdicts`] judges some
//! motions alone; [`Screening::rollout`] repeats one with its trace.
//!
//! - Motions are independent: they run on all threads and keep their order, and one alone gives the same rollout.
//! - Equal arguments give equal results. Each motion and each trial draws from a stream of its own.
//! - Lengths are in meters, joints in radians (meters if prismatic), times in seconds. Motions are in the object's
//!   frame.
//!
//! It does not know what made a motion, nor tables, files or recordings.

#[cfg(test)]
mod fixture;
mod pose_error;
mod screening;
mod trials;

pub use pose_error::PoseError;
pub use screening::{Judgment, PlacedMotion, Scenes, Screening, ScreeningOptions};
pub use trials::MotionTrials;
