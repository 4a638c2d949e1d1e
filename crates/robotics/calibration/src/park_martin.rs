//! A first solution in closed form.

use nalgebra::{Isometry3, Matrix3, Matrix6, Translation3, Vector3, Vector6};

use crate::{
    alignment::align,
    loops::{Loop, Solution},
};

/// Largest rotation of a motion whose axis has a certain sign, in radians: 170°.
const CERTAIN_SIGN_RAD: f64 = 170.0 * std::f64::consts::PI / 180.0;

/// Returns the solution of `A X = X B` over all motions between two loops (Park and Martin, *Robot sensor calibration:
/// solving AX = XB on the Euclidean group*, IEEE Transactions on Robotics and Automation 1994, section IV): the rotation
/// that brings the rotation vectors of the board's motions nearest to those of the robot's, then the offset with the
/// least squares, in which the robot's rotations count: they have less noise than the board's. `None` if there is none.
///
/// Their `(MᵀM)^(-1/2) Mᵀ` is the nearest rotation wherever it is a rotation. Motions of nearly half a turn count only
/// if there is no other: noise turns their vectors around.
pub(crate) fn solve(loops: &[Loop]) -> Option<Solution> {
    let correlation = correlation(loops, CERTAIN_SIGN_RAD);
    let correlation = correlation.unwrap_or_else(|| all_motions(loops));
    let x_rotation = align(&correlation)?.rotation;

    // With the offset of y free, the least squares over all loops are those over all motions.
    let (mut normal, mut right) = (Matrix6::zeros(), Vector6::zeros());
    let mut y_rotation = Matrix3::zeros();
    for it in loops {
        let a = it.a.rotation.to_rotation_matrix();
        let known = it.a.translation.vector + a * (x_rotation * it.b.translation.vector);
        // [A  -I] [x; y] = -known, times [A  -I] transposed.
        let mut upper = normal.fixed_view_mut::<3, 3>(0, 0);
        upper += Matrix3::identity();
        let mut lower = normal.fixed_view_mut::<3, 3>(3, 3);
        lower += Matrix3::identity();
        let mut beside = normal.fixed_view_mut::<3, 3>(0, 3);
        beside -= a.matrix().transpose();
        let mut below = normal.fixed_view_mut::<3, 3>(3, 0);
        below -= a.matrix();
        let mut first = right.fixed_rows_mut::<3>(0);
        first -= a.inverse() * known;
        let mut second = right.fixed_rows_mut::<3>(3);
        second += known;
        let board = it.a.rotation * x_rotation * it.b.rotation;
        y_rotation += board.to_rotation_matrix().matrix();
    }
    let offsets = normal.cholesky()?.solve(&right);
    let pose = |offset: Vector3<f64>, rotation| {
        Isometry3::from_parts(Translation3::from(offset), rotation)
    };
    Some(Solution {
        x: pose(offsets.fixed_rows::<3>(0).into(), x_rotation),
        y: pose(
            offsets.fixed_rows::<3>(3).into(),
            align(&y_rotation)?.rotation,
        ),
    })
}

fn all_motions(loops: &[Loop]) -> Matrix3<f64> {
    correlation(loops, f64::INFINITY).unwrap_or_default()
}

/// Sums `α βᵀ` over motions whose rotations are at most `largest_rad`; `None` if there is none.
fn correlation(loops: &[Loop], largest_rad: f64) -> Option<Matrix3<f64>> {
    let mut sum = Matrix3::zeros();
    let mut n = 0;
    for (idx, i) in loops.iter().enumerate() {
        for j in loops.iter().skip(idx + 1) {
            let alpha = (j.a.rotation.inverse() * i.a.rotation).scaled_axis();
            let beta = (j.b.rotation * i.b.rotation.inverse()).scaled_axis();
            if alpha.norm() <= largest_rad && beta.norm() <= largest_rad {
                sum += alpha * beta.transpose();
                n += 1;
            }
        }
    }
    (n > 0).then_some(sum)
}
