//! What a calibration finds.

use nalgebra::Isometry3;
use spatial::{Base, Camera, Pose};

use crate::agreement::Agreement;

/// The frame of a robot's flange, to which a hand, a camera or a board is fixed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flange {}
/// The frame of a calibration board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Board {}

/// A camera's pose, with how well the measurements agree about it.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// The camera's pose.
    pub camera: CameraPose,
    /// The board's pose, if a board was measured.
    pub board: Option<BoardPose>,
    /// Residuals of the measurements, in their order.
    pub residuals: Agreement,
    /// Errors with which the others predict each measurement, in their order; `None` where the others do not
    /// determine the pose. Empty if there are fewer than 4.
    pub held_out: Vec<Option<crate::Residual>>,
}

impl Calibration {
    /// Returns the errors of prediction; `None` if one of the measurements cannot be left out.
    pub fn leave_one_out(&self) -> Option<Agreement> {
        let errors: Option<Vec<_>> = self.held_out.iter().copied().collect();
        errors.filter(|errors| !errors.is_empty()).map(Agreement)
    }

    /// Returns the number, from 1, of the first measurement without which the others do not determine the pose.
    pub fn indispensable(&self) -> Option<usize> {
        let idx = self.held_out.iter().position(Option::is_none);
        idx.map(|idx| idx + 1)
    }
}

/// A camera's pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CameraPose {
    /// Of a camera that stands still: `base_from_camera`.
    Fixed(Pose<Base, Camera>),
    /// Of a camera on the flange: `flange_from_camera`.
    Wrist(Pose<Flange, Camera>),
}

impl CameraPose {
    /// Returns the pose without its frames.
    pub fn pose(&self) -> Isometry3<f64> {
        match self {
            Self::Fixed(base_from_camera) => **base_from_camera,
            Self::Wrist(flange_from_camera) => **flange_from_camera,
        }
    }

    /// Returns its name.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Fixed(_) => "base_from_camera",
            Self::Wrist(_) => "flange_from_camera",
        }
    }
}

/// A calibration board's pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum BoardPose {
    /// Of a board on the flange, which a fixed camera sees: `flange_from_board`.
    OnFlange(Pose<Flange, Board>),
    /// Of a board that stands still, which a camera on the flange sees: `base_from_board`.
    Still(Pose<Base, Board>),
}

impl BoardPose {
    /// Returns the pose without its frames.
    pub fn pose(&self) -> Isometry3<f64> {
        match self {
            Self::OnFlange(flange_from_board) => **flange_from_board,
            Self::Still(base_from_board) => **base_from_board,
        }
    }

    /// Returns its name.
    pub fn name(&self) -> &'static str {
        match self {
            Self::OnFlange(_) => "flange_from_board",
            Self::Still(_) => "base_from_board",
        }
    }
}
