//! Levenberg-Marquardt within joint limits.

use nalgebra::{Cholesky, DMatrix, DVector};

use crate::{
    hand::Posture,
    objective::{Evaluation, Memory, Objective, Quadratic},
};

/// Damping at the start, relative to the Hessian's diagonal.
const FIRST_DAMPING: f64 = 1e-4;
/// Damping below which steps are as good as undamped.
const LEAST_DAMPING: f64 = 1e-9;
/// Damping above which no step of any size helps.
const MOST_DAMPING: f64 = 1e6;
/// Stiffness added to every unknown, in m² per m² or rad²: keeps an unknown without a say in place.
const FLOOR: f64 = 1e-9;
/// Relative decrease below which an iteration counts as one that found nothing.
const LEAST_DECREASE: f64 = 1e-5;
/// Decrease in m² below which nothing visible is left to find: a hundredth of a millimeter.
const LEAST_DECREASE_M2: f64 = 1e-10;
/// Iterations in a row that may find nothing before the search ends.
const PATIENCE: usize = 2;

/// Minimizes the objective from a posture, keeping every joint within its limits.
///
/// Each iteration minimizes the quadratic model over the box of joint limits by an active set
/// (Nocedal and Wright, *Numerical Optimization*, 2006, §16.5), with Marquardt's damping.
pub(crate) fn minimize(
    objective: &Objective<'_>,
    start: &Posture,
    max_iterations: usize,
    memory: &mut Memory,
) -> Evaluation {
    let (lower, upper) = (&objective.hand.lower, &objective.hand.upper);
    let inside = start.moved(&vec![0.0; objective.dim()], lower, upper);
    let mut best = objective.evaluate(inside, memory);
    let mut quadratic = objective.expand(&best);
    let mut damping = FIRST_DAMPING;
    let mut n_idle = 0;
    for _ in 0..max_iterations {
        let Some(step) = boxed_step(&quadratic, damping, &best.posture, lower, upper) else {
            damping *= 10.0;
            if damping > MOST_DAMPING {
                break;
            }
            continue;
        };
        let trial = objective.evaluate(best.posture.moved(step.as_slice(), lower, upper), memory);
        let decrease = best.cost - trial.cost;
        if decrease > 0.0 {
            let is_idle = decrease < (LEAST_DECREASE * best.cost).max(LEAST_DECREASE_M2);
            n_idle = if is_idle { n_idle + 1 } else { 0 };
            best = trial;
            damping = (damping * 0.2).max(LEAST_DAMPING);
            if n_idle >= PATIENCE {
                break;
            }
            quadratic = objective.expand(&best);
        } else {
            damping *= 8.0;
            let predicted =
                -(2.0 * quadratic.gradient.dot(&step) + (&quadratic.hessian * &step).dot(&step));
            if damping > MOST_DAMPING || predicted < LEAST_DECREASE_M2 {
                break;
            }
        }
    }
    best
}

/// Returns the step that minimizes the damped quadratic with every joint kept within its limits;
/// `None` if the numbers do not allow one.
fn boxed_step(
    quadratic: &Quadratic,
    damping: f64,
    posture: &Posture,
    lower: &[f64],
    upper: &[f64],
) -> Option<DVector<f64>> {
    let dim = quadratic.gradient.len();
    let mut hessian = quadratic.hessian.clone();
    for i in 0..dim {
        hessian[(i, i)] += damping * hessian[(i, i)] + FLOOR;
    }
    // The room that each unknown has: none of the palm's has an end.
    let room: Vec<(f64, f64)> = (0..dim)
        .map(|i| {
            let joint = i.checked_sub(6);
            joint
                .and_then(|j| {
                    Some((
                        lower.get(j)? - posture.q.get(j)?,
                        upper.get(j)? - posture.q.get(j)?,
                    ))
                })
                .unwrap_or((f64::NEG_INFINITY, f64::INFINITY))
        })
        .collect();
    let mut step = DVector::zeros(dim);
    let mut is_held = vec![false; dim];
    for (i, &(below, above)) in room.iter().enumerate() {
        let slope = quadratic.gradient[i];
        is_held[i] = (below >= 0.0 && slope > 0.0) || (above <= 0.0 && slope < 0.0);
    }
    // Each turn holds at least one more unknown, so that it ends.
    for _ in 0..=dim {
        let free: Vec<usize> = (0..dim).filter(|&i| !is_held[i]).collect();
        solve_free(&hessian, &quadratic.gradient, &free, &mut step)?;
        let mut is_inside = true;
        for &i in &free {
            let (below, above) = room[i];
            if step[i] < below || step[i] > above {
                step[i] = step[i].clamp(below, above);
                is_held[i] = true;
                is_inside = false;
            }
        }
        if is_inside {
            break;
        }
    }
    step.iter().all(|number| number.is_finite()).then_some(step)
}

/// Solves for the free unknowns with the others held where `step` has them.
fn solve_free(
    hessian: &DMatrix<f64>,
    gradient: &DVector<f64>,
    free: &[usize],
    step: &mut DVector<f64>,
) -> Option<()> {
    let mut held = step.clone();
    for &i in free {
        held[i] = 0.0;
    }
    let pull = gradient + hessian * held;
    let matrix = DMatrix::from_fn(free.len(), free.len(), |r, c| hessian[(free[r], free[c])]);
    let right = DVector::from_iterator(free.len(), free.iter().map(|&i| -pull[i]));
    let solution = Cholesky::new(matrix)?.solve(&right);
    for (&i, &value) in free.iter().zip(solution.iter()) {
        step[i] = value;
    }
    Some(())
}
