//! Motions of a hand and of joints over time: checked, interpolated, put into other orders and frames.
//!
//! ```
//! use motion::{Motion, Step};
//! use nalgebra::Isometry3;
//! use spatial::{Object, Pose};
//!
//! let step = |time_s: f64| Step {
//!     time_s,
//!     frame_from_palm: Pose::<Object, _>::new(Isometry3::translation(0.0, 0.0, 0.2 - 0.1 * time_s)),
//!     q_rad: vec![0.4 * time_s],
//!     rates: (),
//! };
//! let motion = Motion::new(&["knuckle"], vec![step(0.0), step(1.0)])?;
//! let halfway = motion.at(0.5);
//! assert!((halfway.q_rad[0] - 0.2).abs() < 1e-12);
//! assert!(Motion::new(&["knuckle"], vec![step(1.0), step(0.0)]).is_err());
//! # Ok::<(), motion::MotionError>(())
//! ```
//!
//! A [`Motion`] is a hand over time in one frame: the palm's pose and the joints' positions at each step,
//! and what is known of how fast they change, which is a type: nothing (`()`), the joints' rates
//! ([`JointRates`]), or the palm's too ([`HandRates`]). Its steps are finite, in time order and have one
//! position per joint, or there is no motion.
//! Between two steps it is straight ([`Motion::at`]); one with all rates is also a [`Course`], through
//! them all without a jump in velocity or acceleration.
//! A [`JointTrack`] and [`PalmPoint`]s are what controllers are told: points at each controller's own rate.
//! Times are in seconds, lengths in meters, angles in radians.
//! This crate does no input or output; it knows neither limits nor what a motion is for.

mod course;
mod error;
mod interpolation;
mod motion;
mod rates;
mod track;

pub use course::Course;
pub use error::MotionError;
pub use interpolation::joints_between;
pub use motion::{Motion, Step};
pub use rates::{HandRates, JointRates, Rates};
pub use track::{Carrier, JointPoint, JointTrack, PalmPoint, Timed};
