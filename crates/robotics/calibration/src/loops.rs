//! The equation that every pair of poses fulfills.

use nalgebra::{Isometry3, Vector3};

/// A loop through base, flange, camera and board: `a * x * b = y`.
///
/// `x` is the camera's pose and `y` the board's. Of a camera on the flange `a` is `base_from_flange`; of a fixed
/// one it is `flange_from_base`. `b` is `camera_from_board`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Loop {
    pub(crate) a: Isometry3<f64>,
    pub(crate) b: Isometry3<f64>,
}

/// The two poses that all loops share.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Solution {
    pub(crate) x: Isometry3<f64>,
    pub(crate) y: Isometry3<f64>,
}

/// Weight of a rotation beside an offset: 0.2° count as 1 mm, as in the pose of a board that a camera sees.
pub(crate) const METERS_PER_RADIAN: f64 = 0.001 * 180.0 / (0.2 * std::f64::consts::PI);

/// By how much a loop does not close.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Gap {
    /// In meters.
    pub(crate) offset: Vector3<f64>,
    /// As a rotation vector, in radians.
    pub(crate) rotation: Vector3<f64>,
}

impl Gap {
    /// Returns the sum of squares, in m².
    pub(crate) fn cost(&self) -> f64 {
        self.offset.norm_squared() + (self.rotation * METERS_PER_RADIAN).norm_squared()
    }
}

impl Loop {
    /// Returns the gap between the board by the camera and by the other poses.
    pub(crate) fn gap(&self, solution: &Solution) -> Gap {
        let seen = self.a * solution.x * self.b;
        Gap {
            offset: seen.translation.vector - solution.y.translation.vector,
            rotation: (solution.y.rotation.inverse() * seen.rotation).scaled_axis(),
        }
    }
}

/// Returns the sum of squares over loops, in m².
pub(crate) fn cost(loops: &[Loop], solution: &Solution) -> f64 {
    loops.iter().map(|it| it.gap(solution).cost()).sum()
}
