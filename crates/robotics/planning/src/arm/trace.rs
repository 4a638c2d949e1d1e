//! Following a path in one posture of the arm.
//!
//! Joints are those of inverse kinematics, started at the extrapolation by velocity and acceleration at
//! the last point. Where the arm is regular they are the one continuation of the posture, as long as
//! each solution is near its start; else the step is halved.

use std::f64::consts::TAU;

use robot::{ChainRates, KinematicState};

use super::{
    Arm,
    palm_path::{PalmPath, Target},
};
use crate::infeasible::{ArmFault, PathPoint};

/// Maximum distance of joints from their extrapolated positions, in radians (meters if prismatic).
const NEAR_Q: f64 = 0.05;
/// Maximum number of halvings of a step.
const HALVINGS: usize = 6;

/// The arm at one point of a path.
#[derive(Debug, Clone)]
pub(crate) struct Knot {
    pub(crate) at: PathPoint,
    /// Joint positions; turns are counted through.
    pub(crate) q: Vec<f64>,
    /// Their derivatives by the point.
    pub(crate) rates: ChainRates,
    /// The palm's Jacobian and pose.
    pub(crate) state: KinematicState,
}

impl Knot {
    /// Returns the joints at a point nearby, extrapolated by their rates.
    pub(crate) fn ahead(&self, at: PathPoint) -> Vec<f64> {
        let step = at.number() - self.at.number();
        let rates = self.rates.velocity.iter().zip(&self.rates.acceleration);
        let joints = self.q.iter().zip(rates);
        joints
            .map(|(q, (velocity, acceleration))| q + step * (velocity + 0.5 * step * acceleration))
            .collect()
    }
}

/// Follows a path.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tracer<'a, 'spline> {
    pub(crate) arm: &'a Arm,
    pub(crate) palm_path: &'a PalmPath<'spline>,
    /// Least singular value that the arm's Jacobian may have.
    pub(crate) least: f64,
}

impl Tracer<'_, '_> {
    /// Returns the arm at the target in the posture `q`, which reaches it.
    pub(crate) fn knot(&self, target: &Target, q: Vec<f64>) -> Result<Knot, ArmFault> {
        let at = target.at;
        let Ok(state) = self.arm.chain.state(&q) else {
            return Err(ArmFault::Jump { at });
        };
        if !state.is_regular(self.least) {
            return Err(ArmFault::Singular {
                value: state.min_singular_value(),
                least: self.least,
                at,
            });
        }
        let rates = state.rates(&target.twist, &target.rate);
        Ok(Knot {
            at,
            q,
            rates: rates.ok_or(ArmFault::Jump { at })?,
            state,
        })
    }

    /// Follows a path over its targets from the arm's posture at the first one; fails with the number of
    /// them that it could follow.
    pub(crate) fn trace(
        &self,
        from: &Knot,
        targets: &[Target],
    ) -> Result<Vec<Knot>, (usize, ArmFault)> {
        let mut knots: Vec<Knot> = Vec::with_capacity(targets.len());
        for target in targets {
            let knot = self
                .next(knots.last().unwrap_or(from), target)
                .and_then(|knot| self.arm.within_limits(knot));
            knots.push(knot.map_err(|fault| (knots.len(), fault))?);
        }
        Ok(knots)
    }

    /// Returns the arm at a target nearby, in the continuation of a posture.
    pub(crate) fn next(&self, from: &Knot, target: &Target) -> Result<Knot, ArmFault> {
        self.halved(from, target, HALVINGS)
    }

    fn halved(&self, from: &Knot, target: &Target, halvings: usize) -> Result<Knot, ArmFault> {
        let sought = from.ahead(target.at);
        let chain = &self.arm.chain;
        let found = chain.inverse_kinematics(&target.base_from_palm, &sought);
        let is_near = |q: &[f64]| {
            let mut pairs = q.iter().zip(&sought);
            pairs.all(|(q, sought)| (q - sought).abs() < NEAR_Q)
        };
        if let Some(q) = found.filter(|q| is_near(q)) {
            return self.knot(target, q);
        }
        let jump = ArmFault::Jump { at: target.at };
        let Some(fewer) = halvings.checked_sub(1) else {
            return Err(jump);
        };
        let middle = self.palm_path.at(from.at.middle(target.at));
        let between = self.halved(from, &middle, fewer)?;
        self.halved(&between, target, fewer)
    }
}

impl Arm {
    /// Refuses a joint beyond limits that are less than a turn apart: no turn brings it back.
    pub(crate) fn within_limits(&self, knot: Knot) -> Result<Knot, ArmFault> {
        for (joint, &q) in self.joints().iter().zip(&knot.q) {
            let is_narrow = joint.upper - joint.lower < TAU;
            if is_narrow && !(q >= joint.lower && q <= joint.upper) {
                return Err(ArmFault::Limit {
                    joint: joint.name.clone(),
                    q,
                    lower: joint.lower,
                    upper: joint.upper,
                    at: knot.at,
                });
            }
        }
        Ok(knot)
    }

    /// Turns the joints that can make a turn or more so that they stay as far inside their limits as can
    /// be, and returns the least distance of one from a limit, in radians (meters if prismatic).
    pub(crate) fn unwind(&self, knots: &mut [Knot]) -> Result<f64, ArmFault> {
        let mut least = f64::INFINITY;
        for (idx, joint) in self.joints().iter().enumerate() {
            if joint.upper.is_infinite() {
                continue;
            }
            let q = |knot: &Knot| knot.q[idx];
            let low = knots.iter().map(q).fold(f64::INFINITY, f64::min);
            let high = knots.iter().map(q).fold(f64::NEG_INFINITY, f64::max);
            let turns = if joint.kind == robot::JointKind::Prismatic {
                0.0
            } else {
                ((0.5 * (joint.lower + joint.upper - low - high)) / TAU).round() * TAU
            };
            for knot in knots.iter_mut() {
                knot.q[idx] += turns;
            }
            let margin = (low + turns - joint.lower).min(joint.upper - high - turns);
            if margin < 0.0 {
                let inside = |knot: &&Knot| (q(knot) - joint.lower).min(joint.upper - q(knot));
                let worst = knots.iter().min_by(|a, b| inside(a).total_cmp(&inside(b)));
                let at = worst.map_or(PathPoint::Reach { time_s: 0.0 }, |knot| knot.at);
                return Err(ArmFault::Limit {
                    joint: joint.name.clone(),
                    q: worst.map_or(f64::NAN, q),
                    lower: joint.lower,
                    upper: joint.upper,
                    at,
                });
            }
            least = least.min(margin);
        }
        Ok(least)
    }
}
