//! The solution with the least squares over all poses.

use nalgebra::{Matrix3, SMatrix, SVector, Translation3, UnitQuaternion, Vector3};

use crate::loops::{Gap, Loop, METERS_PER_RADIAN, Solution, cost};

/// Most steps; a start in closed form needs fewer than ten.
const MAX_STEPS: usize = 100;
/// Largest step that no longer counts, in meters and radians.
const LEAST_STEP: f64 = 1e-13;
/// Damping of the first step, and where the search ends, relative to the diagonal of the normal equations.
const DAMPING: [f64; 2] = [1e-6, 1e6];
/// Largest step from all poses to all but one, in meters and radians, that the normal equations describe.
const LARGEST_STEP: f64 = 0.3;

/// Offset and rotation of x, then of y.
type Step = SVector<f64, 12>;
type Square = SMatrix<f64, 12, 12>;
type Jacobian = SMatrix<f64, 6, 12>;

/// Refines the camera's and the board's pose over all loops (Levenberg–Marquardt).
pub(crate) fn refine(loops: &[Loop], start: Solution) -> Solution {
    let mut solution = start;
    let mut lowest = cost(loops, &solution);
    let [mut damping, most] = DAMPING;
    for _ in 0..MAX_STEPS {
        let (normal, gradient) = normal_equations(loops, &solution);
        let damped = normal + Square::from_diagonal(&(normal.diagonal() * damping));
        let Some(factors) = damped.cholesky() else {
            return solution;
        };
        let step = -factors.solve(&gradient);
        let next = moved(&solution, &step);
        let found = cost(loops, &next);
        if found < lowest {
            (solution, lowest) = (next, found);
            damping *= 0.1;
        } else {
            damping *= 10.0;
        }
        if step.amax() < LEAST_STEP || damping > most {
            return solution;
        }
    }
    solution
}

/// Returns the gap of each loop with the solution of the others, one step of Gauss and Newton from that of all;
/// `None` where the others do not determine it.
pub(crate) fn held_out(loops: &[Loop], solution: &Solution) -> Vec<Option<Gap>> {
    let (normal, _) = normal_equations(loops, solution);
    let without = |it: &Loop| {
        let (jacobian, error) = linearized(it, solution);
        let others = normal - jacobian.tr_mul(&jacobian);
        // At the least squares the gradient of the others is that of this one, negative.
        let step = others.cholesky()?.solve(&jacobian.tr_mul(&error));
        let is_small = step.amax() <= LARGEST_STEP;
        is_small.then(|| it.gap(&moved(solution, &step)))
    };
    loops.iter().map(without).collect()
}

fn moved(solution: &Solution, step: &Step) -> Solution {
    let mut next = *solution;
    for (pose, at) in [(&mut next.x, 0), (&mut next.y, 6)] {
        let offset: Vector3<f64> = step.fixed_rows::<3>(at).into();
        let turn: Vector3<f64> = step.fixed_rows::<3>(at + 3).into();
        pose.translation = Translation3::from(pose.translation.vector + offset);
        pose.rotation *= UnitQuaternion::from_scaled_axis(turn);
        pose.rotation.renormalize();
    }
    next
}

/// Returns half the second derivatives of the cost, without those of the gaps, and half its gradient.
fn normal_equations(loops: &[Loop], solution: &Solution) -> (Square, Step) {
    let (mut normal, mut gradient) = (Square::zeros(), Step::zeros());
    for it in loops {
        let (jacobian, error) = linearized(it, solution);
        normal += jacobian.tr_mul(&jacobian);
        gradient += jacobian.tr_mul(&error);
    }
    (normal, gradient)
}

/// Returns the derivatives of a loop's weighted gap, and the gap.
fn linearized(it: &Loop, solution: &Solution) -> (Jacobian, SVector<f64, 6>) {
    let gap = it.gap(solution);
    let a = *it.a.rotation.to_rotation_matrix().matrix();
    let x = *solution.x.rotation.to_rotation_matrix().matrix();
    let b = *it.b.rotation.to_rotation_matrix().matrix();
    let seen_by_camera = it.b.translation.vector.cross_matrix();
    let right = inverse_right_jacobian(&gap.rotation);
    let left = inverse_right_jacobian(&-gap.rotation);
    let mut jacobian = Jacobian::zeros();
    let mut put = |row: usize, column: usize, block: Matrix3<f64>| {
        let mut view = jacobian.fixed_view_mut::<3, 3>(row, column);
        view += block;
    };
    put(0, 0, a);
    put(0, 3, -(a * x * seen_by_camera));
    put(0, 6, -Matrix3::identity());
    put(3, 3, right * b.transpose() * METERS_PER_RADIAN);
    put(3, 9, -left * METERS_PER_RADIAN);
    let mut error = SVector::<f64, 6>::zeros();
    error.fixed_rows_mut::<3>(0).copy_from(&gap.offset);
    let rotation = gap.rotation * METERS_PER_RADIAN;
    error.fixed_rows_mut::<3>(3).copy_from(&rotation);
    (jacobian, error)
}

/// Returns the derivative of a rotation vector by a small turn on the right (Chirikjian, *Stochastic Models, Information
/// Theory, and Lie Groups*, volume 2, 2012, equation 10.86).
fn inverse_right_jacobian(vector: &Vector3<f64>) -> Matrix3<f64> {
    let angle = vector.norm();
    let cross = vector.cross_matrix();
    let second = if angle < 1e-4 {
        1.0 / 12.0
    } else {
        let half = 0.5 * angle;
        (1.0 - half / half.tan()) / (angle * angle)
    };
    Matrix3::identity() + cross * 0.5 + cross * cross * second
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;

    use super::*;

    fn pose(offset: [f64; 3], turn: [f64; 3]) -> Isometry3<f64> {
        Isometry3::new(offset.into(), turn.into())
    }

    #[test]
    fn derivatives_are_those_of_the_gap() {
        let it = Loop {
            a: pose([0.4, -0.2, 0.6], [0.5, -0.9, 0.3]),
            b: pose([0.1, 0.05, 0.7], [-1.2, 0.4, 0.8]),
        };
        let solution = Solution {
            x: pose([0.02, 0.1, -0.3], [0.1, 2.0, -0.4]),
            y: pose([0.6, 0.0, 0.1], [0.7, 0.2, -0.5]),
        };
        let (jacobian, _) = linearized(&it, &solution);
        let h = 1e-6;
        for column in 0..12 {
            let mut step = Step::zeros();
            step[column] = h;
            let [after, before] = [step, -step].map(|step| {
                let (_, gap) = linearized(&it, &moved(&solution, &step));
                gap
            });
            let numeric = (after - before) / (2.0 * h);
            let analytic = jacobian.column(column);
            assert!((numeric - analytic).amax() < 1e-8, "column {column}");
        }
    }
}
