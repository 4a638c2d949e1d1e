//! Controls a hand to a grasp in simulation, by model predictive control with the cross-entropy method.
//!
//! ```
//! use cem_mpc::{ControlOptions, Controller, CrossEntropy, Fingertips, Scenes, Speeds};
//! use motion::{Motion, Step};
//! use nalgebra::{Isometry3, Matrix3, Point3};
//! use rand::SeedableRng;
//! use simulation::{ObjectShape, SceneConfig};
//! use spatial::Pose;
//!
//! // A ball of 1 cm on a slide, and a box of 6 cm and 0.2 kg.
//! let hand = robot::RobotModel::from_urdf(
//!     r#"<robot name="hand"><link name="palm"/><link name="tip">
//!       <inertial><mass value="0.05"/>
//!         <inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial>
//!       <collision><geometry><sphere radius="0.01"/></geometry></collision></link>
//!       <joint name="slide" type="prismatic"><parent link="palm"/><child link="tip"/><axis xyz="1 0 0"/>
//!         <limit lower="0" upper="0.05" effort="5" velocity="1"/></joint></robot>"#,
//! )?;
//! let table = r#"
//!     side = "right"
//!     scale = 1.0
//!     points = [
//!         { keypoint = "wrist", link = "palm", weight = 1.0 },
//!         { keypoint = "index_mcp", link = "palm", offset_m = [0.01, 0.0, 0.0], weight = 1.0 },
//!         { keypoint = "index_tip", link = "tip", weight = 1.0, tip_radius_m = 0.01 },
//!     ]"#;
//! let tips = Fingertips::new(&hand, &table.parse()?)?;
//! let side = |bit: usize, n: usize| if n >> bit & 1 == 0 { -0.03 } else { 0.03 };
//! let corners = (0..8).map(|n| Point3::new(side(0, n), side(1, n), side(2, n)));
//! let shape = ObjectShape {
//!     parts_m: vec![corners.collect()],
//!     surface: None,
//!     mass_kg: 0.2,
//!     center_of_mass_m: Point3::origin(),
//!     inertia_kg_m2: Matrix3::from_diagonal_element(1.2e-4),
//! };
//! let config: SceneConfig = serde_json::from_value(serde_json::json!({
//!     "drive": {"stiffness": 20.0, "damping": 1.0, "torque_limit": 5.0, "armature": 0.001},
//! }))?;
//!
//! // From 20 cm beside the box to 5 cm beside its center.
//! let at = |time_s: f64, x: f64| Step {
//!     time_s,
//!     frame_from_palm: Pose::new(Isometry3::translation(x, 0.0, 0.0)),
//!     q_rad: vec![0.01],
//!     rates: (),
//! };
//! let steps = vec![at(0.0, -0.2), at(0.5, -0.12), at(1.0, -0.05)];
//! let given = Motion::new(&["slide"], steps)?.differentiated()?;
//!
//! let controller = Controller::new(&hand, &tips, ControlOptions {
//!     method: CrossEntropy {
//!         population: 20,
//!         elites: 4,
//!         iterations: 2,
//!         initial_sd: 0.3,
//!         min_sd: 0.05,
//!         smoothing: 0.1,
//!     },
//!     horizon: 3,
//!     memory: 0.2,
//!     speeds: Speeds { palm: 1.0, turn: 1.5, joint: 0.1 },
//!     tip_weight_per_m: 0.1,
//!     object_weight_per_m: 2.0,
//!     table_weight_per_m: 10.0,
//!     tip_tolerance_m: 0.02,
//!     control_step_s: config.control_step_s(),
//!     steps_n: 20,
//! });
//! let lies = Pose::new(Isometry3::translation(0.0, 0.0, 0.03));
//! let scenes = Scenes::new(&config, &hand, &shape, [lies])?;
//! let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
//! let controlled = controller.control(scenes.at(&lies)?, &given, &mut rng)?;
//! assert_eq!(controlled.motion.steps().len(), 21);
//! assert!(controlled.last.tip_error_m < 0.5 * controlled.first.tip_error_m);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! At every control step so many sequences of a few actions are drawn, simulated from the present state, and drawn
//! again about the best of them (R. Y. Rubinstein, *The Cross-Entropy Method for Combinatorial and Continuous
//! Optimization*, 1999); the first action of the mean is executed, and the rest starts the next search. The model is
//! the physics in which motions are screened ([`Scenes`]), copied from the present state bit by bit.
//!
//! - A motion begins at the given one's first step and goes for the fingertips of its last one. The result is the
//!   commands, on the given motion's clock, so that the screen executes the same.
//! - The cost of a motion is its control steps: those of the search, and those that were executed.
//! - Equal arguments, the random numbers among them, give equal motions.
//!
//! The lift is the screen's. There is no input or output: the crate knows nothing of files or the lake.

mod actions;
mod control;
mod cross_entropy;
mod scenes;
mod tips;

pub use actions::Speeds;
pub use control::{ControlError, ControlOptions, ControlledMotion, Controller, GoalDistance};
pub use cross_entropy::CrossEntropy;
pub use scenes::Scenes;
pub use tips::Fingertips;
