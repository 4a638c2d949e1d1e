//! Plans a hand's way around object and table to a grasp, by RRT-Connect.
//!
//! ```
//! use geometry::{DistanceField, TriMesh};
//! use motion::{Motion, Step};
//! use nalgebra::{Isometry3, Point3};
//! use posture::{Environment, Hand};
//! use rand::SeedableRng;
//! use rrt_connect::{Growth, Metric, RrtOptions, RrtOutcome, RrtPlanner};
//! use spatial::{Pose, RestingPose};
//!
//! // A ball of 1 cm on a slide.
//! let urdf = r#"<robot name="hand"><link name="palm"/><link name="tip"><collision>
//!     <geometry><sphere radius="0.01"/></geometry></collision></link>
//!     <joint name="slide" type="prismatic"><parent link="palm"/><child link="tip"/>
//!     <axis xyz="1 0 0"/><limit lower="0" upper="0.02" effort="1" velocity="1"/></joint></robot>"#;
//! let table = r#"
//!     side = "right"
//!     scale = 1.0
//!     points = [
//!         { keypoint = "wrist", link = "palm", weight = 1.0 },
//!         { keypoint = "index_tip", link = "tip", weight = 1.0 },
//!         { keypoint = "thumb_tip", link = "tip", offset_m = [0.0, 0.01, 0.0], weight = 1.0 },
//!     ]"#;
//! let hand = Hand::new(robot::RobotModel::from_urdf(urdf)?, &table.parse()?)?;
//!
//! // A box of 10 cm on a table: the grasp is on the far side, so that the straight line leads through it.
//! let corner = Point3::new(0.05, 0.05, 0.05);
//! let field = DistanceField::new(&TriMesh::cuboid(-corner, corner), 0.0025, 0.025)?.unwrap();
//! let rest = RestingPose::of(&Pose::new(Isometry3::translation(0.0, 0.0, 0.05)));
//! let environment = Environment::new(field, rest);
//! let at = |time_s: f64, x: f64| Step {
//!     time_s,
//!     frame_from_palm: Pose::new(Isometry3::translation(x, 0.0, 0.0)),
//!     q_rad: vec![0.0],
//!     rates: (),
//! };
//! let steps = (0..=20).map(|n| f64::from(n) / 20.0).map(|share| at(share, 0.2 - 0.26 * share));
//! let given = Motion::new(&["slide"], steps.collect())?.differentiated()?;
//!
//! let mut planner = RrtPlanner::new(&hand, RrtOptions {
//!     growth: Growth {
//!         metric: Metric { translation_per_m: 10.0, rotation_per_rad: 1.0, joint_per_rad: 1.0 },
//!         step: 0.2,
//!         spacing: 0.02,
//!         drawn_share: 0.5,
//!         max_nodes: 10_000,
//!         max_checks: 100_000,
//!     },
//!     tolerated_depth_m: 0.002,
//!     margin_m: 0.2,
//!     closing_share: 0.25,
//!     clearance_m: 0.01,
//!     shortcuts: 0,
//! });
//! let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
//! let plan = planner.plan(&environment, &given, &mut rng)?;
//! assert_eq!(plan.outcome, RrtOutcome::Found);
//! assert!(plan.depth_m < 0.004);
//! assert_eq!(plan.motion.grasp().frame_from_palm, given.grasp().frame_from_palm);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A motion's first step is where the hand starts, its last step the grasp. Between them two trees grow in the space of
//! the palm's pose and the joints' positions until they meet (Kuffner and LaValle, *RRT-Connect: An Efficient Approach
//! to Single-Query Path Planning*, 2000). The grasp touches the object and is in no free space, so the second tree
//! grows from a pregrasp, from which the hand closes on a straight line.
//!
//! - The planned motion has the given one's ends and times. Where no path is found it leads to the node that is nearest
//!   to the pregrasp; without a free start or pregrasp it stays at its start.
//! - The cost of a plan is its collision checks, each one configuration of the hand against object and table.
//! - Equal arguments, the random numbers among them, give equal motions.
//!
//! Nothing is simulated, fingers do not collide with each other, and there is no input or output: the crate knows
//! nothing of files or the lake.

mod collision;
mod configuration;
mod connect;
mod path;
mod planner;
mod pregrasp;
mod tree;

pub use configuration::Metric;
pub use connect::Growth;
pub use planner::{RrtError, RrtOptions, RrtOutcome, RrtPlan, RrtPlanner};
