//! How well the hand follows at one step.

/// Tracking errors of the hand at a step, and its margins.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tracking {
    /// Distance to each followed landmark as recorded, in meters, in the order of the hand's points that have a weight.
    pub keypoint_errors_m: Vec<f64>,
    /// Those of the fingertips.
    pub tip_errors_m: Vec<f64>,
    /// Signed distance of each fingertip that should touch the surface from it, in meters.
    pub contact_gaps_m: Vec<f64>,
    /// Least distance of a joint to one of its limits, in radians; of a prismatic joint, in meters.
    pub limit_margin_rad: f64,
    /// Greatest depth of a link inside the object, in meters.
    pub penetration_m: f64,
    /// Greatest depth of a link below the table, in meters.
    pub table_penetration_m: f64,
}

impl Tracking {
    /// Returns the root mean square distance to the followed landmarks, in meters.
    pub fn keypoint_error_m(&self) -> f64 {
        let squares = self.keypoint_errors_m.iter().map(|error| error.powi(2));
        let sum: f64 = squares.sum();
        (sum / self.keypoint_errors_m.len().max(1) as f64).sqrt()
    }
}
