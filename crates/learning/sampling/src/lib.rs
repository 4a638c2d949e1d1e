//! Samples motions of a robot hand towards an object from a continuous grasping function (Ye et al.,
//! *Learning Continuous Grasping Function with a Dexterous Hand from Human Demonstrations*, 2023, section III).
//!
//! ```
//! use cgf::{NetworkConfig, TrainingConfig, TrainingMotion, TrainingSet};
//! use motion::{Motion, Step};
//! use nalgebra::{Isometry3, Point3, Vector3};
//! use sampling::{Orientation, Orientations, PlacedFunction, SampledObject, SamplingOptions, SamplingTask};
//! use spatial::{Pose, RestingPose};
//!
//! let hand = std::sync::Arc::new(robot::RobotModel::from_urdf(
//!     r#"<robot name="hand"><link name="palm"/><link name="finger"/>
//!       <joint name="knuckle" type="revolute"><parent link="palm"/><child link="finger"/>
//!         <limit lower="0" upper="1.6" effort="1" velocity="7"/></joint></robot>"#,
//! )?);
//! let surface: Vec<[f64; 3]> = (0..64)
//!     .map(|k| 0.1 * f64::from(k))
//!     .map(|turn| [0.03 * turn.cos(), 0.03 * turn.sin(), 0.01 * turn])
//!     .collect();
//! let rest = RestingPose { up_in_object: Vector3::z_axis(), height_m: 0.0 };
//! # let above = |time_s: f64| Step {
//! #     time_s,
//! #     frame_from_palm: Pose::new(Isometry3::translation(0.0, 0.0, 0.3 - 0.1 * time_s)),
//! #     q_rad: vec![0.5 * time_s],
//! #     rates: (),
//! # };
//! # let track = TrainingMotion {
//! #     name: "reach".to_owned(),
//! #     scene: 0,
//! #     split: schemas::training::Split::Training,
//! #     code: None,
//! #     motion: Motion::new(&["knuckle"], vec![above(0.0), above(0.5), above(1.0)])?,
//! # };
//! # let set = TrainingSet {
//! #     scenes: vec![cgf::RestingObject {
//! #         object: "can".to_owned(),
//! #         rest,
//! #         points_in_object: surface.iter().map(|&point| Point3::from(point)).collect(),
//! #     }],
//! #     tracks: vec![track.clone(), track],
//! #     distances: Default::default(),
//! # };
//! # let network = NetworkConfig { points: 64, ..NetworkConfig::default() };
//! # let mut training: TrainingConfig = serde_json::from_str(r#"{"tips": ["finger"], "tip_radius_m": 0.0}"#)?;
//! # (training.epochs, training.penetration_weight) = (1, 0.0);
//! # let function = cgf::train(&set, &hand, &network, &training, 7, |_| {})?.best;
//! let options = SamplingOptions {
//!     n: 3,
//!     steps: 10,
//!     duration_s: 1.5,
//!     posterior_share: 0.5,
//!     demonstrations: Vec::new(),
//!     spread: 1.0,
//!     path: None,
//!     orientations: Orientations::Seen,
//!     point_noise: 0.0,
//! };
//! let object = SampledObject {
//!     name: "can",
//!     points_m: &surface,
//!     vertices_m: &surface,
//!     orientations: vec![Orientation { rest, seen_n: 1, probability: 1.0 }],
//! };
//! let sampled = sampling::sample(&SamplingTask {
//!     options: &options,
//!     cgf: &function,
//!     object: object.clone(),
//!     shown: None,
//!     redraws: None,
//!     seed: 7,
//!     is_canceled: &|| false,
//! })?;
//! assert_eq!(sampled.motions.len(), 3);
//! let motion = &sampled.motions[0].motion;
//! assert_eq!((motion.first().time_s, motion.grasp().time_s), (0.0, 1.5));
//! assert!((0.0..=1.6).contains(&motion.grasp().q_rad[0]));
//!
//! // The same code at other times.
//! let placed = PlacedFunction::new(&function, &object, rest)?;
//! let decoded = placed.decode(&[sampled.motions[0].latent.clone()], &[0.3, 1.5], 1.5, &|| false)?;
//! assert!((decoded[0].grasp().q_rad[0] - motion.grasp().q_rad[0]).abs() < 1e-6);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A latent code comes from the prior, from the posterior of a demonstration, or from the line between two of them.
//! [`sample`] decodes it at equal time steps from far to the grasp, with exact rates, in the object's own
//! frame; a [`PlacedFunction`] decodes codes at any times.
//!
//! - Joint positions are clamped to the hand's limits; the greatest excess is reported.
//! - With [`Redraws`] a motion whose hand is too deep in object or table is drawn again; the shallowest is kept, and
//!   the refused draws are reported.
//! - Every motion has its own random numbers: equal arguments give equal motions, on any number of threads.
//!
//! A [`PenetrationProbe`] measures depth. Times are in seconds, lengths in meters, angles in radians. This crate does
//! no input or output: it knows nothing of files, tables or the lake, and it judges no motion in physics.

mod codes;
mod error;
mod motions;
mod options;
mod penetration;

pub use codes::CodeOrigin;
pub use error::SamplingError;
pub use motions::{Draw, PlacedFunction, SampledMotion, SampledMotions, SamplingTask, sample};
pub use options::{Orientation, Orientations, Redraws, SampledObject, SamplingOptions};
pub use penetration::{CollisionModel, PenetrationProbe};
