//! Choice of the object's yaw and the arm's posture.

use std::{cmp::Ordering, f64::consts::TAU};

use motion::{MotionSpline, Step};
use spatial::{Object, Pose, Table};

use super::{
    Arm,
    clearance::LinkPoses,
    palm_path::{PalmPath, Target},
    path::ArmPath,
    trace::{Knot, Tracer},
};
use crate::infeasible::{ArmFault, Infeasible, PathPoint};

/// Places of the reach at which inverse kinematics is solved, besides its start.
const REACH_N: usize = 120;
/// Places of the lift.
const LIFT_N: usize = 20;
/// Times that differ by less than this share of the motion are the same.
const SAME_TIME: f64 = 0.01;

/// The hand at evenly spaced times of a motion, and the height of the lift from its end, in meters.
struct SampledHand {
    moving: Vec<(f64, Step<Object>)>,
    /// Its joint positions at the same times.
    fingers: Vec<Vec<f64>>,
    lift_m: f64,
}

/// Progress of a posture along the path, from least to most.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Progress {
    /// Not even the grasp is within the limits.
    Nothing,
    /// The grasp, and this many points from there.
    Points(usize),
    /// The whole path, but something collides on it.
    Whole,
}

/// A posture in which the arm can follow.
struct Choice<'a> {
    palm_path: PalmPath<'a>,
    /// From the path's start to the grasp.
    to_grasp: Vec<Knot>,
    /// From there up.
    lift: Vec<Knot>,
    /// Slowdown factor; see [`Choice::compare`].
    slowdown: f64,
    margin: f64,
}

/// Failures of the postures tried so far.
#[derive(Default)]
struct Failures {
    postures: usize,
    /// Progress and fault of the posture that came farthest.
    best: Option<(Progress, ArmFault)>,
}

impl Arm {
    /// Finds the arm's joints over a motion and straight up from its end by `lift_m`, with the object at
    /// `arm.object_m` on the table, turned by each of `arm.turns` angles.
    ///
    /// `fingers` gives the hand's joint positions at a time of the motion; on the lift they are those of its
    /// end. Of all directions and postures
    /// that keep the limits and are regular, that one is taken that keeps clear of the table, the arm
    /// itself and the hand, and takes the least time at the joints' largest speeds and the motion's own
    /// pace; of equal ones, within 1 % of the motion, the one in which the product of the distance from
    /// the nearest joint limit and the least singular value is greatest; then the least turn.
    ///
    /// # Errors
    ///
    /// Fails if no posture does. The fault is that of the posture that comes farthest: all the way but
    /// for a collision, or part of the path, or to the grasp.
    pub(crate) fn follow<'a>(
        &'a self,
        spline: &'a MotionSpline<Object>,
        table_from_object: &Pose<Table, Object>,
        fingers: impl Fn(f64) -> Vec<f64>,
        lift_m: f64,
    ) -> Result<ArmPath<'a>, Infeasible> {
        let turns = self.config.turns;
        let lift_m = lift_m.max(0.0);
        let hands = hands(spline);
        let fingers: Vec<Vec<f64>> = hands.iter().map(|(time_s, _)| fingers(*time_s)).collect();
        let hand = SampledHand {
            moving: hands,
            fingers,
            lift_m,
        };
        let mut failures = Failures::default();
        let mut choices = Vec::new();
        for turn in 0..turns {
            let angle = TAU * turn as f64 / turns as f64;
            let palm_path = PalmPath::new(self, spline, table_from_object, angle);
            self.gather(&palm_path, &hand, &mut choices, &mut failures);
        }
        choices.sort_by(Choice::compare);
        for choice in choices {
            let knots = choice.to_grasp.iter().chain(&choice.lift);
            match self.clear(&choice.palm_path, knots, &hand.fingers) {
                Ok(()) => {
                    return Ok(ArmPath::new(
                        self,
                        choice.palm_path,
                        choice.to_grasp,
                        choice.lift,
                    ));
                }
                Err(fault) => failures.add(Progress::Whole, fault),
            }
        }
        Err(failures.infeasible(turns).unwrap_or_else(|| {
            let palm_path = PalmPath::new(self, spline, table_from_object, 0.0);
            let grasp = palm_path.at(PathPoint::Lift { height_m: 0.0 });
            Infeasible::Reach {
                palm_in_base_m: grasp.base_from_palm.translation.vector.into(),
                turns,
            }
        }))
    }

    /// Adds the postures in which the arm can follow a path.
    fn gather<'a>(
        &self,
        palm_path: &PalmPath<'a>,
        hand: &SampledHand,
        choices: &mut Vec<Choice<'a>>,
        failures: &mut Failures,
    ) {
        let mut to_start: Vec<Target> = hand
            .moving
            .iter()
            .rev()
            .map(|(time_s, hand)| palm_path.of(PathPoint::Reach { time_s: *time_s }, hand))
            .collect();
        if to_start.is_empty() {
            return;
        }
        let grasp = to_start.remove(0);
        let up: Vec<Target> = (0..=LIFT_N)
            .map(|k| hand.lift_m * k as f64 / LIFT_N as f64)
            .map(|height_m| palm_path.at(PathPoint::Lift { height_m }))
            .collect();
        let closed = hand.fingers.last().map_or(&[][..], std::slice::from_ref);
        let tracer = Tracer {
            arm: self,
            palm_path,
            least: self.config.min_singular_value,
        };
        for q in self.chain.ik_solutions(&grasp.base_from_palm) {
            failures.postures += 1;
            // Most that cannot be followed do not even stand free at the grasp.
            let found = tracer
                .knot(&grasp, q)
                .and_then(|knot| self.within_limits(knot))
                .map_err(|fault| (Progress::Nothing, fault))
                .and_then(|knot| match self.clear(palm_path, [&knot], closed) {
                    Ok(()) => Ok(knot),
                    Err(fault) => Err((Progress::Points(0), fault)),
                })
                .and_then(|knot| {
                    let found = self.posture(tracer, knot, &to_start, &up);
                    found.map_err(|(n, fault)| (Progress::Points(n), fault))
                });
            match found {
                Ok(choice) => choices.push(choice),
                Err((progress, fault)) => failures.add(progress, fault),
            }
        }
    }

    /// Follows a path from the arm's posture at the grasp: back to its start, and up. A fault comes with the
    /// number of points that were followed.
    fn posture<'a>(
        &self,
        tracer: Tracer<'_, 'a>,
        at_grasp: Knot,
        to_start: &[Target],
        up: &[Target],
    ) -> Result<Choice<'a>, (usize, ArmFault)> {
        let mut all = tracer.trace(&at_grasp, to_start)?;
        all.reverse();
        let to_grasp_n = all.len() + 1;
        all.push(at_grasp.clone());
        let (first, rest) = up
            .split_first()
            .ok_or((to_grasp_n, ArmFault::Jump { at: at_grasp.at }))?;
        let below = tracer.knot(first, at_grasp.q);
        let below = below.map_err(|fault| (to_grasp_n, fault))?;
        let lifted = tracer.trace(&below, rest);
        let lifted = lifted.map_err(|(n, fault)| (to_grasp_n + n, fault))?;
        all.push(below);
        all.extend(lifted);
        let margin = self.unwind(&mut all).map_err(|fault| (all.len(), fault))?;
        let singular = all.iter().map(|knot| knot.state.min_singular_value());
        let singular = singular.fold(f64::INFINITY, f64::min);
        let lift = all.split_off(to_grasp_n);
        Ok(Choice {
            palm_path: tracer.palm_path.clone(),
            slowdown: self.slowdown(&all),
            margin: margin * singular,
            to_grasp: all,
            lift,
        })
    }

    /// Returns the slowdown factor of the reach at the joints' largest speeds, relative to the request, where
    /// it is faster nowhere.
    fn slowdown(&self, to_grasp: &[Knot]) -> f64 {
        let (mut requested_s, mut takes_s) = (0.0, 0.0);
        for pair in to_grasp.windows(2) {
            let [from, to] = pair else { continue };
            let step_s = to.at.number() - from.at.number();
            let joints = from.q.iter().zip(&to.q).zip(&self.limits);
            let needed = joints.map(|((from, to), limits)| (to - from).abs() / limits.max_velocity);
            requested_s += step_s;
            takes_s += needed.fold(step_s, f64::max);
        }
        takes_s / requested_s
    }

    /// Checks that the arm keeps clear of the table, itself and the hand; beyond the last of the hand's
    /// joint positions these stay as they are.
    fn clear<'b>(
        &self,
        palm_path: &PalmPath<'_>,
        knots: impl IntoIterator<Item = &'b Knot>,
        fingers: &[Vec<f64>],
    ) -> Result<(), ArmFault> {
        let last = fingers.last().into_iter().cycle();
        let link_poses: Vec<LinkPoses> = knots
            .into_iter()
            .zip(fingers.iter().chain(last))
            .map(|(knot, fingers)| {
                Ok(LinkPoses {
                    at: knot.at,
                    base_from_links: self.links(&knot.q, fingers)?,
                })
            })
            .collect::<Result<_, ArmFault>>()?;
        let base_height_m = self.base_from_table.inverse().translation.z;
        self.clearance
            .check(&link_poses, palm_path.up_in_base(), base_height_m)
    }
}

impl Choice<'_> {
    /// Orders choices, the best one first.
    fn compare(&self, other: &Self) -> Ordering {
        let steps = |choice: &Self| (choice.slowdown / SAME_TIME).round();
        let by_time = steps(self).total_cmp(&steps(other));
        by_time.then(other.margin.total_cmp(&self.margin))
    }
}

impl Failures {
    fn add(&mut self, progress: Progress, fault: ArmFault) {
        if self.best.as_ref().is_none_or(|(best, _)| progress > *best) {
            self.best = Some((progress, fault));
        }
    }

    fn infeasible(self, turns: usize) -> Option<Infeasible> {
        let postures = self.postures;
        self.best.map(|(_, fault)| Infeasible::Arm {
            postures,
            turns,
            fault,
        })
    }
}

/// Returns the hand at evenly spaced times of a motion.
fn hands(spline: &MotionSpline<Object>) -> Vec<(f64, Step<Object>)> {
    (0..=REACH_N)
        .map(|k| {
            let time_s = spline.duration_s() * k as f64 / REACH_N as f64;
            (time_s, spline.at(time_s))
        })
        .collect()
}
