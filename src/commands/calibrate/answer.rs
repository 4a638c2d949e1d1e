//! A calibration for display.

use calibration::{Agreement, Calibration, CameraPose, Residual};
use nalgebra::Isometry3;
use serde::Serialize;
use spatial::xyzw;

use crate::report;

/// A calibration as it is printed.
#[derive(Serialize)]
pub(super) struct Answer {
    /// Pose of a camera that stands still.
    #[serde(skip_serializing_if = "Option::is_none")]
    base_from_camera: Option<PoseNumbers>,
    /// Pose of a camera on the flange.
    #[serde(skip_serializing_if = "Option::is_none")]
    flange_from_camera: Option<PoseNumbers>,
    /// Pose of a board on the flange.
    #[serde(skip_serializing_if = "Option::is_none")]
    flange_from_board: Option<PoseNumbers>,
    /// Pose of a board that stands still.
    #[serde(skip_serializing_if = "Option::is_none")]
    base_from_board: Option<PoseNumbers>,
    /// Number of measurements.
    measurements: usize,
    pub(super) residual: Errors,
    /// Errors with which the others predict each measurement; `None` if one cannot be left out.
    leave_one_out: Option<Errors>,
    /// Rotation from the base's frame to that of a camera that stands still, row by row.
    #[serde(rename = "cam_R_w2c", skip_serializing_if = "Option::is_none")]
    pub(super) camera_r_w2c: Option<[f64; 9]>,
    /// Offset of the same transform, in millimeters.
    #[serde(rename = "cam_t_w2c", skip_serializing_if = "Option::is_none")]
    camera_t_w2c: Option<[f64; 3]>,
}

#[derive(Serialize)]
struct PoseNumbers {
    position_m: [f64; 3],
    quaternion_xyzw: [f64; 4],
}

/// Errors of all measurements.
#[derive(Serialize)]
pub(super) struct Errors {
    pub(super) rms_mm: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    rms_deg: Option<f64>,
    /// That with the largest distance.
    pub(super) largest: Option<Error>,
    /// Of each measurement, in the order of the file.
    each: Vec<Error>,
}

/// Error of a measurement.
#[derive(Serialize)]
pub(super) struct Error {
    /// The measurement, from 1.
    pub(super) number: usize,
    pub(super) mm: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    deg: Option<f64>,
}

impl Answer {
    pub(super) fn of(found: &Calibration) -> Self {
        let pose = PoseNumbers::of(&found.camera.pose());
        let (fixed, wrist) = match found.camera {
            CameraPose::Fixed(_) => (Some(pose), None),
            CameraPose::Wrist(_) => (None, Some(pose)),
        };
        let board = found.board.map(|board| PoseNumbers::of(&board.pose()));
        let (on_flange, still) = if fixed.is_some() {
            (board, None)
        } else {
            (None, board)
        };
        let world_to_camera = fixed.is_some().then(|| found.camera.pose().inverse());
        Self {
            base_from_camera: fixed,
            flange_from_camera: wrist,
            flange_from_board: on_flange,
            base_from_board: still,
            measurements: found.residuals.0.len(),
            residual: Errors::of(&found.residuals),
            leave_one_out: found.leave_one_out().as_ref().map(Errors::of),
            camera_r_w2c: world_to_camera.map(|pose| rows(&pose)),
            camera_t_w2c: world_to_camera.map(|pose| (pose.translation.vector * 1e3).into()),
        }
    }

    /// Returns it as text for people.
    pub(super) fn text(&self) -> String {
        let mut rows = Vec::new();
        for (name, pose) in [
            ("base_from_camera", &self.base_from_camera),
            ("flange_from_camera", &self.flange_from_camera),
            ("flange_from_board", &self.flange_from_board),
            ("base_from_board", &self.base_from_board),
        ] {
            if let Some(pose) = pose {
                rows.push(row(name, "position_m", listed(&pose.position_m)));
                rows.push(row("", "quaternion_xyzw", listed(&pose.quaternion_xyzw)));
            }
        }
        let n = self.measurements;
        rows.push(row(
            "residual",
            "RMS",
            format!("{} of {n} measurements", self.residual.rms()),
        ));
        if let Some(largest) = &self.residual.largest {
            let text = format!("{} of measurement {}", largest.text(), largest.number);
            rows.push(row("", "largest", text));
        }
        if let Some(errors) = &self.leave_one_out {
            let text = format!("{} of each by the others", errors.rms());
            rows.push(row("leave one out", "RMS", text));
        }
        report::columns(&rows, &[])
    }
}

fn row(name: &str, what: &str, text: String) -> Vec<String> {
    vec![name.to_owned(), what.to_owned(), text]
}

fn listed(numbers: &[f64]) -> String {
    let numbers: Vec<String> = numbers
        .iter()
        .map(|number| format!("{number:.6}"))
        .collect();
    format!("[{}]", numbers.join(", "))
}

/// Returns the nine numbers of a pose's rotation, row by row.
fn rows(pose: &Isometry3<f64>) -> [f64; 9] {
    let matrix = pose.rotation.to_rotation_matrix();
    let by_rows = matrix.matrix().transpose();
    let mut numbers = [0.0; 9];
    numbers.copy_from_slice(by_rows.as_slice());
    numbers
}

impl PoseNumbers {
    fn of(pose: &Isometry3<f64>) -> Self {
        Self {
            position_m: pose.translation.vector.into(),
            quaternion_xyzw: xyzw(&pose.rotation),
        }
    }
}

impl Errors {
    fn of(agreement: &Agreement) -> Self {
        let rms = agreement.rms();
        let errors = agreement.0.iter().enumerate();
        Self {
            rms_mm: rms.offset_m * 1e3,
            rms_deg: rms.rotation_rad.map(f64::to_degrees),
            largest: agreement
                .largest()
                .map(|(number, residual)| Error::of(number, residual)),
            each: errors
                .map(|(idx, residual)| Error::of(idx + 1, *residual))
                .collect(),
        }
    }

    fn rms(&self) -> String {
        in_words(self.rms_mm, self.rms_deg)
    }
}

impl Error {
    fn of(number: usize, residual: Residual) -> Self {
        Self {
            number,
            mm: residual.offset_m * 1e3,
            deg: residual.rotation_rad.map(f64::to_degrees),
        }
    }

    fn text(&self) -> String {
        in_words(self.mm, self.deg)
    }
}

fn in_words(mm: f64, deg: Option<f64>) -> String {
    let angle = deg.map_or_else(String::new, |deg| format!(" and {deg:.2}°"));
    format!("{mm:.2} mm{angle}")
}
