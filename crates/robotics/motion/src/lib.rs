//! Motions of a hand and of joints over time: checked, interpolated, reordered and transformed.
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
//! A [`Motion`] is a hand over time in one frame: the palm's pose and the joints' positions at each
//! step, and their known rates of change, which are a type: none (`()`), the joints'
//! ([`JointRates`]), or the palm's too ([`HandRates`]). Its steps are finite, in time order and
//! have one position per joint; the constructor refuses all others. Between two steps it is linear
//! ([`Motion::at`]); one with all rates is also a [`MotionSpline`], through all steps with continuous
//! velocity and acceleration. A [`JointTrack`] and [`PalmPoint`]s are controller commands: points
//! at each controller's own rate. A [`HandState`] is a hand at one time, of a motion or not;
//! [`smoothness()`] measures a series of them.
//! Times are in seconds, lengths in meters, angles in radians.
//! This crate does no input or output; it knows neither limits nor a motion's purpose.

mod differentiation;
mod error;
mod hand_state;
mod interpolation;
mod motion;
mod rates;
mod smoothness;
mod spline;
mod track;

pub use differentiation::palm_acceleration;
pub use error::MotionError;
pub use hand_state::HandState;
pub use interpolation::joints_between;
pub use motion::{Motion, Step};
pub use rates::{HandRates, JointRates, Rates};
pub use smoothness::{Smoothness, Variation, Variations, smoothness};
pub use spline::MotionSpline;
pub use track::{JointPoint, JointTrack, PalmPoint, PalmTrajectory, Timed};
