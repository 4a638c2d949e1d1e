//! The palm's path that an arm has to follow: to the grasp and straight up from it, in the frame of the
//! arm's base.

use motion::{MotionSpline, Step};
use nalgebra::{UnitQuaternion, Vector3};
use spatial::{Base, Object, Palm, Pose, Table, Twist};

use super::Arm;
use crate::infeasible::PathPoint;

/// The palm's path for one yaw of the object.
#[derive(Debug, Clone)]
pub(crate) struct PalmPath<'a> {
    spline: &'a MotionSpline<Object>,
    pub(crate) table_from_object: Pose<Table, Object>,
    base_from_object: Pose<Base, Object>,
    /// The table's vertical in the frame of the arm's base.
    up_in_base: Vector3<f64>,
}

/// The palm at one point of its path, in the frame of the arm's base.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Target {
    pub(crate) at: PathPoint,
    pub(crate) base_from_palm: Pose<Base, Palm>,
    /// Derivative by the point (s or m).
    pub(crate) twist: Twist<Base>,
    /// Second derivative.
    pub(crate) rate: Twist<Base>,
}

impl<'a> PalmPath<'a> {
    /// Puts the object where it stands, turned about the vertical by an angle in radians.
    pub(crate) fn new(
        arm: &Arm,
        spline: &'a MotionSpline<Object>,
        table_from_object: &Pose<Table, Object>,
        yaw_rad: f64,
    ) -> Self {
        let [x, y] = arm.config.object_m;
        let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad);
        let place = [x, y, table_from_object.translation.z];
        let table_from_object = Pose::from_parts(place, yaw * table_from_object.rotation);
        Self {
            spline,
            table_from_object,
            base_from_object: arm.base_from_table * table_from_object,
            up_in_base: arm.base_from_table * Vector3::z(),
        }
    }

    /// Returns where the palm is at a point, and how it moves.
    pub(crate) fn at(&self, at: PathPoint) -> Target {
        match at {
            PathPoint::Reach { time_s } => self.of(at, &self.spline.at(time_s)),
            PathPoint::Lift { height_m } => {
                let grasp = self.spline.grasp();
                let base_from_palm = self.base_from_object * grasp.frame_from_palm;
                let up = self.up_in_base;
                Target {
                    at,
                    base_from_palm: base_from_palm.translated(&(up * height_m)),
                    twist: Twist::new(up, Vector3::zeros()),
                    rate: Twist::zero(),
                }
            }
        }
    }

    /// Returns where the palm is at a step of the motion.
    pub(crate) fn of(&self, at: PathPoint, hand: &Step<Object>) -> Target {
        let (base_from_object, rates) = (&self.base_from_object, &hand.rates);
        Target {
            at,
            base_from_palm: *base_from_object * hand.frame_from_palm,
            twist: rates.palm_velocity.expressed_in(base_from_object),
            rate: rates.palm_acceleration.expressed_in(base_from_object),
        }
    }

    /// The table's vertical in the frame of the arm's base.
    pub(crate) fn up_in_base(&self) -> &Vector3<f64> {
        &self.up_in_base
    }
}

impl PathPoint {
    /// Seconds or meters: by what derivatives are taken.
    pub(crate) fn number(self) -> f64 {
        match self {
            Self::Reach { time_s } => time_s,
            Self::Lift { height_m } => height_m,
        }
    }

    /// Returns the point in the middle of two of one kind.
    pub(crate) fn middle(self, other: Self) -> Self {
        let middle = 0.5 * (self.number() + other.number());
        match self {
            Self::Reach { .. } => Self::Reach { time_s: middle },
            Self::Lift { .. } => Self::Lift { height_m: middle },
        }
    }
}
