//! Joint positions for a pose of a chain's end.
//!
//! Damped least squares (Nakamura and Hanafusa, *Inverse Kinematic Solutions With Singularity Robustness
//! for Robot Manipulator Control*, 1986; Wampler, *Manipulator Inverse Kinematic Solutions Based on Vector
//! Formulations and Damped Least-Squares Methods*, 1986), with the damping in proportion to the squared
//! residual (Sugihara, *Solvability-Unconcerned Inverse Kinematics by the Levenberg–Marquardt Method*,
//! 2011, §III): far off it goes downhill, near the end it is Newton's method.

use nalgebra::Vector6;
use spatial::{Base, Palm, Pose};

use super::{Chain, KinematicState};

/// Residual of a pose at which the search ends, in meters and in radians.
const TARGET_RESIDUAL: f64 = 1e-12;
/// Largest accepted residual, where rounding keeps it above the target.
const MAX_RESIDUAL: f64 = 1e-10;
/// Maximum number of steps; on a path it takes 2, from anywhere about 12.
const STEPS: usize = 60;
/// Halvings of a step that does not come nearer.
const HALVINGS: usize = 5;
/// Damping per square of the residual, in meters and radians.
const DAMPING: f64 = 0.02;
/// Share of the residual above which a step counts as a stall, and the maximum number of stalls in a
/// row.
const STALL: f64 = 0.98;
const MAX_STALLS: usize = 4;

impl Chain {
    /// Returns joint positions, within the limits or not, with which the end is at `base_from_palm`,
    /// within 10⁻¹⁰ m and rad: those to which damped least squares come from `near`. `None` if they
    /// come to none.
    ///
    /// From near enough that is the solution that `near` passes into as the target moves: on a path,
    /// start from the extrapolated joints, and check that the solution is close to them.
    pub fn inverse_kinematics(
        &self,
        base_from_palm: &Pose<Base, Palm>,
        near: &[f64],
    ) -> Option<Vec<f64>> {
        let mut q = near.to_vec();
        let mut state = self.state(&q).ok()?;
        let mut missing = missing(base_from_palm, &state);
        let mut stalls = 0;
        for _ in 0..STEPS {
            let before = missing.norm();
            if before <= TARGET_RESIDUAL {
                return Some(q);
            }
            let square = state.square(DAMPING * before * before)?;
            let step = state.transposed(&square.solve(&missing));
            let Some(next) = self.downhill(base_from_palm, &q, &step, before) else {
                break;
            };
            (q, state, missing) = next;
            stalls = if missing.norm() > STALL * before {
                stalls + 1
            } else {
                0
            };
            if stalls > MAX_STALLS {
                break;
            }
        }
        (missing.norm() <= MAX_RESIDUAL).then_some(q)
    }

    /// Halves a step until it reduces the residual; `None` if it does not.
    fn downhill(
        &self,
        base_from_palm: &Pose<Base, Palm>,
        q: &[f64],
        step: &[f64],
        before: f64,
    ) -> Option<(Vec<f64>, KinematicState, Vector6<f64>)> {
        let mut share = 1.0;
        for _ in 0..=HALVINGS {
            let there: Vec<f64> = q
                .iter()
                .zip(step)
                .map(|(q, step)| q + share * step)
                .collect();
            let state = self.state(&there).ok()?;
            let missing = missing(base_from_palm, &state);
            if missing.norm() < before {
                return Some((there, state, missing));
            }
            share *= 0.5;
        }
        None
    }
}

/// Returns the error of the end's pose: its displacement in meters, then its rotation in radians, along the
/// base's axes.
fn missing(base_from_palm: &Pose<Base, Palm>, state: &KinematicState) -> Vector6<f64> {
    let found = &state.base_from_palm;
    let moved = base_from_palm.translation.vector - found.translation.vector;
    let turn = (base_from_palm.rotation * found.rotation.inverse()).scaled_axis();
    Vector6::new(moved.x, moved.y, moved.z, turn.x, turn.y, turn.z)
}
