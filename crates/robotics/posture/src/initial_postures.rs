//! Starting postures of a search without an initial guess, and restarts that leave poor minima.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use spatial::Pose;

use crate::{
    SolverError,
    minimize::{SearchOptions, SearchOutcome, Solver},
    posture::{Posture, RootPose},
    task::{NoTerms, Task, Terms},
};

/// Positions of all joints in the starts tried, as shares of their reach: in the middle, as in the
/// paper, an open and a closed hand.
const BENDS: [f64; 3] = [0.5, 0.25, 0.75];
/// Reach of a joint without limits about 0 in the starts tried, in radians; that of a joint with one
/// limit begins there.
const REACH_RAD: f64 = 1.0;

/// Start of a joint in a restart, as a share of the way from the limit that it ended at to the other.
const FAR_SIDE: f64 = 0.8;
/// Share of the cost below which another minimum replaces the one that follows the motion.
const WORTH_A_JUMP: f64 = 0.995;

impl Solver<'_> {
    /// Returns starting postures for a search without an initial guess: all joints at three bends,
    /// with the root laid so that the points come nearest to their targets.
    ///
    /// # Errors
    ///
    /// Fails if the task does not fit the hand.
    pub fn initial_postures(&mut self, task: &Task<'_>) -> Result<Vec<Posture>, SolverError> {
        let hand = self.hand();
        let bends = BENDS.iter().map(|bend| {
            let mut q = vec![0.0; hand.dof()];
            for (slot, &joint) in hand.layout.joints.iter().enumerate() {
                let (lower, upper) = reach(hand.lower[slot], hand.upper[slot]);
                q[joint] = lower + bend * (upper - lower);
            }
            let posture = Posture {
                root: RootPose::identity(),
                q,
            };
            self.aligned_to_targets(task, posture)
        });
        bends.collect()
    }

    /// Returns the posture with its root laid so that the points come nearest to their targets; as
    /// it is if the root is fixed.
    ///
    /// # Errors
    ///
    /// Fails if the task or the posture does not fit the hand.
    pub fn aligned_to_targets(
        &mut self,
        task: &Task<'_>,
        posture: Posture,
    ) -> Result<Posture, SolverError> {
        self.place(task, &posture, &mut NoTerms)?;
        if self.hand().layout.n_root == 0 {
            return Ok(posture);
        }
        let posed = self.posed();
        let pairs: Vec<(Vector3<f64>, Vector3<f64>, f64)> = task
            .targets
            .iter()
            .filter_map(|target| {
                let from = posed.point(target.point)?;
                Some((from.coords, target.point_in_object.coords, target.weight))
            })
            .collect();
        let (rotation, along) = align(&pairs);
        let moved = Pose::from_parts(along, rotation) * posture.root.pose();
        Ok(Posture::new(&moved, posture.q))
    }

    /// Searches from a posture like [`Solver::minimize`], and then from the other side of each
    /// finger that ended at a limit; keeps the better result.
    ///
    /// Two neighboring joints reach nearly the same place bent either way, as an elbow does. A search
    /// that follows a motion can be left with the worse bend, and then has a joint at its limit.
    ///
    /// # Errors
    ///
    /// Fails if the task or the posture does not fit the hand.
    pub fn minimize_with_flips<T: Terms>(
        &mut self,
        task: &Task<'_>,
        posture: &mut Posture,
        options: &SearchOptions,
        terms: &mut T,
    ) -> Result<SearchOutcome, SolverError> {
        let mut best = self.minimize(task, posture, options, terms)?;
        let hand = self.hand();
        let layout = &hand.layout;
        let mut trial = posture.clone();
        for &(first, len) in &layout.fingers {
            trial.clone_from(posture);
            let mut is_bent = false;
            for slot in first - layout.n_root..first - layout.n_root + len {
                let (joint, lower, upper) =
                    (layout.joints[slot], hand.lower[slot], hand.upper[slot]);
                let q = posture.q[joint];
                // A locked joint has no other side, and an unlimited one no end.
                let range = upper - lower;
                if (q <= lower || q >= upper) && range > 0.0 && range.is_finite() {
                    let near = if q <= lower { lower } else { upper };
                    trial.q[joint] = near + FAR_SIDE * (lower + upper - 2.0 * near);
                    is_bent = true;
                }
            }
            if !is_bent {
                continue;
            }
            let outcome = self.minimize(task, &mut trial, options, terms)?;
            best.iterations += outcome.iterations;
            if outcome.cost < WORTH_A_JUMP * best.cost {
                let iterations = best.iterations;
                best = SearchOutcome {
                    iterations,
                    ..outcome
                };
                posture.clone_from(&trial);
            }
        }
        Ok(best)
    }
}

/// Returns the range of a joint's positions in the starts tried.
fn reach(lower: f64, upper: f64) -> (f64, f64) {
    match (lower.is_finite(), upper.is_finite()) {
        (true, true) => (lower, upper),
        (true, false) => (lower, lower + 2.0 * REACH_RAD),
        (false, true) => (upper - 2.0 * REACH_RAD, upper),
        (false, false) => (-REACH_RAD, REACH_RAD),
    }
}

/// Returns the turn and then the shift that take the first points nearest to the second ones, by
/// weight (Kabsch, "A solution for the best rotation to relate two sets of vectors", 1976).
fn align(pairs: &[(Vector3<f64>, Vector3<f64>, f64)]) -> (UnitQuaternion<f64>, Vector3<f64>) {
    let total: f64 = pairs.iter().map(|(_, _, weight)| weight).sum();
    if total <= 0.0 {
        return (UnitQuaternion::identity(), Vector3::zeros());
    }
    let (mut from_mean, mut to_mean) = (Vector3::zeros(), Vector3::zeros());
    for (from, to, weight) in pairs {
        from_mean += from * (weight / total);
        to_mean += to * (weight / total);
    }
    let mut covariance = Matrix3::zeros();
    for (from, to, weight) in pairs {
        covariance += (to - to_mean) * (from - from_mean).transpose() * *weight;
    }
    let svd = covariance.svd(true, true);
    let rotation = match (svd.u, svd.v_t) {
        (Some(u), Some(v_t)) => {
            // A mirror image is not a rotation: turn the least certain direction around.
            let sign = (u * v_t).determinant().signum();
            let rotation = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t;
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation))
        }
        _ => UnitQuaternion::identity(),
    };
    (rotation, to_mean - rotation * from_mean)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alignment_finds_the_transform_of_moved_points() {
        let (along, turn) = (
            Vector3::new(0.3, -0.2, 0.1),
            UnitQuaternion::new(Vector3::new(1.0, 2.0, -1.5)),
        );
        let points = [
            [0.1, 0.0, 0.0],
            [0.0, 0.1, 0.02],
            [0.0, 0.0, 0.1],
            [0.05, 0.05, 0.0],
        ];
        let pairs: Vec<_> = points
            .into_iter()
            .map(|p| (Vector3::from(p), turn * Vector3::from(p) + along, 0.3))
            .collect();
        let (found_turn, found_along) = align(&pairs);
        assert!((found_along - along).norm() < 1e-12);
        assert!(found_turn.angle_to(&turn) < 1e-9);
    }
}
