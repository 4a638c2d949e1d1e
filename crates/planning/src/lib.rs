//! From a motion that holds in physics to one that a robot can make.
//!
//! ```
//! use motion::{HandRates, Motion, Step};
//! use nalgebra::Isometry3;
//! use planning::{LimitsConfig, Planner, RatesConfig, Setup};
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
//!     rates: HandRates::still(1),
//! };
//! let motion = Motion::new(&["knuckle"], vec![down(0.0), down(1.0)])?;
//! let limits = LimitsConfig::default();
//! let planner = Planner::new(&Setup {
//!     hand: &hand,
//!     arm: None,
//!     protocol: &protocol,
//!     limits: &limits,
//!     rates: RatesConfig::default(),
//! })?;
//! let planned = planner.plan(&motion, &Pose::identity())?;
//! assert!(planned.grasp.reach_s >= protocol.reach_s);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A [`Planner`] takes a motion of the hand relative to the object as it lies and returns what the
//! controllers are told ([`Feasible`]): the motion's continuous course, timed within the limits of joints and
//! palm, sampled at each controller's rate, from rest at its start to rest at the end of the lift. Where an arm
//! carries the hand, its joints follow from the palm's way, with the object turned on the table as the arm can
//! best reach it.
//!
//! - The palm goes where the motion has it, nowhere faster than it was screened.
//! - Every limit holds at the points that are told, between them, and in differences of positions alone.
//! - The arm keeps clear of the table, of itself and of the hand all the way.
//! - What cannot be made is [`Infeasible`], with its reason; nothing is cut or bent to fit.
//!
//! Equal arguments give equal points. This crate does no input or output: it has never heard of cells, files
//! or the lake, and it seeks no other way than the one that it is given.

mod arm;
mod error;
mod excess;
mod infeasible;
mod limits;
mod planner;
mod rates;
#[cfg(test)]
mod testing;
mod timed;
mod timing;
mod whole;

pub use arm::{ArmConfig, Base};
pub use error::OptionError;
pub use infeasible::{ArmFault, Infeasible, Place};
pub use limits::LimitsConfig;
pub use planner::{ArmSetup, Feasible, Planner, Setup};
pub use rates::{MOST_HZ, RatesConfig};
