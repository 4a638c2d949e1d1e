//! The arm's joints over a motion, as a continuous function.

use motion::JointRates;
use spatial::{Object, Pose, Table};

use super::{
    Arm,
    palm_path::PalmPath,
    trace::{Knot, Tracer},
};
use crate::infeasible::{ArmFault, Infeasible, PathPoint};

/// The arm's joints over a motion and the lift from its end.
#[derive(Debug, Clone)]
pub(crate) struct ArmPath<'a> {
    /// Pose of the object on the table for this path.
    pub(crate) table_from_object: Pose<Table, Object>,
    arm: &'a Arm,
    palm_path: PalmPath<'a>,
    /// From the path's start to the grasp.
    to_grasp: Vec<Knot>,
    /// From there up.
    lift: Vec<Knot>,
}

/// The arm's joints at a point of the path, in the order of [`Arm::joint_names`].
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ArmPoint {
    /// Positions in radians (meters if prismatic).
    pub(crate) q: Vec<f64>,
    /// Derivatives by the motion's time in seconds, or by the lift's height in meters.
    pub(crate) rates: JointRates,
}

impl<'a> ArmPath<'a> {
    pub(super) fn new(
        arm: &'a Arm,
        palm_path: PalmPath<'a>,
        to_grasp: Vec<Knot>,
        lift: Vec<Knot>,
    ) -> Self {
        Self {
            table_from_object: palm_path.table_from_object,
            arm,
            palm_path,
            to_grasp,
            lift,
        }
    }

    /// Returns the arm.
    pub(crate) fn arm(&self) -> &Arm {
        self.arm
    }

    /// Returns the joints at a time of the motion, in seconds after its first step; before that and after
    /// its last they are as there.
    ///
    /// They are those of inverse kinematics at that very time, within 10⁻¹⁰ m and rad.
    pub(crate) fn at(&self, motion_s: f64) -> Result<ArmPoint, Infeasible> {
        let time_s = motion_s.clamp(0.0, end(&self.to_grasp));
        self.moving(&self.to_grasp, PathPoint::Reach { time_s })
    }

    /// Returns the joints with the palm this high above the grasp, in meters; below and beyond the lift
    /// they are as at its ends.
    pub(crate) fn lifted(&self, height_m: f64) -> Result<ArmPoint, Infeasible> {
        let height_m = height_m.clamp(0.0, end(&self.lift));
        self.moving(&self.lift, PathPoint::Lift { height_m })
    }

    /// Seeks the joints from the nearest knot.
    fn moving(&self, knots: &[Knot], at: PathPoint) -> Result<ArmPoint, Infeasible> {
        let number = at.number();
        let after = knots.partition_point(|knot| knot.at.number() < number);
        let near = [after.checked_sub(1), Some(after)].into_iter().flatten();
        let nearest = near.filter_map(|idx| knots.get(idx)).min_by(|a, b| {
            let far = |knot: &Knot| (knot.at.number() - number).abs();
            far(a).total_cmp(&far(b))
        });
        let nearest = nearest.ok_or(ArmFault::Jump { at })?;
        let tracer = Tracer {
            arm: self.arm,
            palm_path: &self.palm_path,
            // The path was traced before: between two knots there is no bound on the singular value.
            least: 0.0,
        };
        let knot = tracer.next(nearest, &self.palm_path.at(at))?;
        Ok(ArmPoint {
            q: knot.q,
            rates: JointRates {
                velocity: knot.rates.velocity,
                acceleration: knot.rates.acceleration,
            },
        })
    }
}

/// Returns the time or the height of the last knot.
fn end(knots: &[Knot]) -> f64 {
    knots.last().map_or(0.0, |knot| knot.at.number())
}
