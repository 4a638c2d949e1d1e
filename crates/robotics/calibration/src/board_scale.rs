//! Whether the board has the size that its detector assumes.

use nalgebra::{Matrix3, SMatrix, SVector};

use crate::{
    error::CalibrationError,
    loops::{Loop, Solution},
};

/// Factor by which another size of the board must lower the residual.
const FAR_BETTER: f64 = 5.0;
/// Least difference of a board's size from the assumed one, as a fraction, that is not taken for noise.
const LEAST_CHANGE: f64 = 0.01;
/// Residual below which no other size is considered, in meters.
const GOOD_M: f64 = 5e-4;
/// Fewest poses that say something of the size.
const LEAST_N: usize = 4;

/// Refuses poses that agree far better if the board is larger or smaller: with a wrong size of its squares, every
/// distance from the camera is wrong by the same factor.
pub(crate) fn check_board_scale(loops: &[Loop], start: &Solution) -> Result<(), CalibrationError> {
    let Some((factor, rms_m)) = best_scale(loops, start) else {
        return Ok(());
    };
    let squares: f64 = loops
        .iter()
        .map(|it| it.gap(start).offset.norm_squared())
        .sum();
    let given_m = (squares / loops.len().max(1) as f64).sqrt();
    let differs = (factor - 1.0).abs() > LEAST_CHANGE && factor > 0.0;
    if loops.len() >= LEAST_N && given_m > GOOD_M && differs && rms_m * FAR_BETTER < given_m {
        return Err(CalibrationError::BoardScale {
            factor,
            given_m,
            rms_m,
        });
    }
    Ok(())
}

/// Returns the factor of the board's distances with the least squares of offsets, beside both offsets, and their root
/// mean square.
fn best_scale(loops: &[Loop], start: &Solution) -> Option<(f64, f64)> {
    let equations = loops.iter().map(|it| {
        let a = it.a.rotation.to_rotation_matrix();
        let mut left = SMatrix::<f64, 3, 7>::zeros();
        left.fixed_view_mut::<3, 3>(0, 0).copy_from(a.matrix());
        left.fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&-Matrix3::identity());
        let seen = a * (start.x.rotation * it.b.translation.vector);
        left.fixed_view_mut::<3, 1>(0, 6).copy_from(&seen);
        (left, -it.a.translation.vector)
    });
    let mut normal = SMatrix::<f64, 7, 7>::zeros();
    let mut right = SVector::<f64, 7>::zeros();
    for (left, known) in equations.clone() {
        normal += left.tr_mul(&left);
        right += left.tr_mul(&known);
    }
    let found = normal.cholesky()?.solve(&right);
    let squares: f64 = equations
        .map(|(left, known)| (left * found - known).norm_squared())
        .sum();
    let factor = *found.get(6)?;
    Some((factor, (squares / loops.len() as f64).sqrt()))
}
