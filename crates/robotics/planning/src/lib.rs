//! Turns a motion that holds in physics into one that is feasible for a robot.
//!
//! ```
//! use motion::{HandRates, Motion, Step};
//! use nalgebra::Isometry3;
//! use planning::{LimitsConfig, Planner, CommandRatesConfig, PlannerConfig};
//! use spatial::Pose;
//!
//! # let protocol: simulation::Protocol = serde_json::from_str(include_str!("../tests/grasp.json"))?;
//! let hand = robot::RobotModel::from_urdf(
//!     r#"<robot name="hand"><link name="palm"/><link name="finger"/>
//!       <joint name="knuckle" type="revolute"><parent link="palm"/><child link="finger"/>
//!         <limit lower="0" upper="1.6" effort="1" velocity="7"/></joint></robot>"#,
//! )?;
//! let down = |time_s: f64| Step {
//!     time_s,
//!     frame_from_palm: Pose::new(Isometry3::translation(0.0, 0.0, 0.3 - 0.1 * time_s)),
//!     q_rad: vec![0.5],
//!     rates: HandRates::zero(1),
//! };
//! let motion = Motion::new(&["knuckle"], vec![down(0.0), down(1.0)])?;
//! let limits = LimitsConfig::default();
//! let planner = Planner::new(&PlannerConfig {
//!     hand: &hand,
//!     arm: None,
//!     protocol: &protocol,
//!     limits: &limits,
//!     rates: CommandRatesConfig::default(),
//! })?;
//! let planned = planner.plan(&motion, &Pose::identity())?;
//! assert!(planned.grasp.reach_s >= protocol.reach_s);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A [`Planner`] takes a motion of the hand relative to the resting object and returns the
//! controllers' commands ([`PlannedMotion`]): the motion's continuous path, timed within the limits of
//! joints and palm, sampled at each controller's rate, from rest at its start to rest at the end of
//! the lift. If an arm carries the hand, inverse kinematics gives its joints, with the object
//! turned on the table to where the arm reaches it best.
//!
//! - The palm follows the motion's path, nowhere faster than in the screen.
//! - Every limit holds at the commanded points, between them, and in differences of positions
//!   alone.
//! - The arm keeps clear of the table, of itself and of the hand throughout.
//! - An infeasible motion is refused with its reason ([`Infeasible`]); nothing is clipped to fit.
//!
//! Equal arguments give equal points. This crate does no input or output: it knows nothing of
//! cells, files or the lake, and it searches for no other path than the given one.

mod arm;
#[cfg(test)]
mod fixture;
mod grasp_motion;
mod infeasible;
mod limit_excess;
mod limits;
mod planner;
mod rates;
mod time_scaling;
mod timing;

pub use arm::ArmConfig;
pub use infeasible::{ArmFault, Infeasible, PathPoint};
pub use limits::LimitsConfig;
pub use planner::{ArmSetup, PlannedMotion, Planner, PlannerConfig};
pub use rates::{CommandRatesConfig, MAX_HZ};
