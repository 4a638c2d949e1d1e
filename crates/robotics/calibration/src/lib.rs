//! Poses of cameras relative to a robot, from measurements of a lab.
//!
//! ```
//! let file = br#"{"points": [
//!     {"in_base_m": [0.5, 0.0, 0.0], "in_camera_m": [0.0, 0.0, 0.5]},
//!     {"in_base_m": [0.6, 0.0, 0.0], "in_camera_m": [0.1, 0.0, 0.5]},
//!     {"in_base_m": [0.5, 0.1, 0.0], "in_camera_m": [0.0, -0.1, 0.5]},
//!     {"in_base_m": [0.6, 0.1, 0.1], "in_camera_m": [0.1, -0.1, 0.4]}
//! ]}"#;
//! let found = calibration::Measurements::parse(file)?.calibrate()?;
//! let camera = found.camera.pose();
//! assert!((camera.translation.vector - nalgebra::Vector3::new(0.5, 0.0, 0.5)).norm() < 1e-9);
//! assert!(found.residuals.rms().offset_m < 1e-9);
//! # Ok::<(), calibration::CalibrationError>(())
//! ```
//!
//! Two kinds of measurements give a pose: the same points in the frames of base and camera ([`calibrate_by_points`]),
//! and poses of the flange with those of a calibration board in the camera's frame ([`calibrate_by_poses`]).
//! Every calibration has the residual of each measurement, and the error with which the others predict it. Measurements
//! that do not determine a pose, or that another convention explains far better, are refused with the reason.
//!
//! Positions are in meters, rotations in radians; measurements are counted from 1 in messages.
//! This crate detects no boards, calibrates no lenses, and reads no files.

mod agreement;
mod alignment;
mod board_scale;
mod calibrated;
mod checks;
mod conventions;
mod error;
mod hand_eye;
mod loops;
mod measurements;
mod numbers;
mod park_martin;
mod refine;
mod rotations;
mod touched_points;

pub use agreement::{Agreement, Residual};
pub use calibrated::{Board, BoardPose, Calibration, CameraPose, Flange};
pub use conventions::Reading;
pub use error::{CalibrationError, Field};
pub use hand_eye::{CameraMount, PosePair, calibrate_by_poses};
pub use measurements::{MAX_FILE_BYTES, MAX_MEASUREMENTS, Measurements};
pub use touched_points::{PointPair, calibrate_by_points};
