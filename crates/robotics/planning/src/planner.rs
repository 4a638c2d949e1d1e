//! The planner of one hand's motions.

use motion::{JointTrack, Motion, MotionSpline, PalmTrajectory};
use nalgebra::Vector3;
use options::OptionFault;
use robot::{Joint, JointKind, RobotModel};
use simulation::{Approach, Flexion, Protocol};
use spatial::{Object, Palm, Pose, Table};

use crate::{
    ArmConfig, CommandRatesConfig, Infeasible, LimitsConfig, arm::Arm, grasp_motion::Fingers,
    limits::Limits, time_scaling::whole_ticks,
};

/// Excess of a position over a limit attributed to rounding, in radians (meters if prismatic).
const ROUNDING_RAD: f64 = 1e-6;

/// Plans the motions of one hand.
pub struct Planner<'a> {
    pub(crate) hand: &'a RobotModel,
    pub(crate) protocol: &'a Protocol,
    pub(crate) limits: Limits,
    pub(crate) rates: CommandRatesConfig,
    flexion: Flexion,
    arm: Option<Arm>,
}

/// Configuration of a [`Planner`].
#[derive(Debug, Clone, Copy)]
pub struct PlannerConfig<'a> {
    /// The hand; its root link is the palm.
    pub hand: &'a RobotModel,
    /// The arm that carries it; without one the hand is free-flying.
    pub arm: Option<ArmSetup<'a>>,
    /// Execution and success criteria of a motion.
    pub protocol: &'a Protocol,
    /// Limits on the speeds of palm and joints.
    pub limits: &'a LimitsConfig,
    /// Command rates of the controllers.
    pub rates: CommandRatesConfig,
}

/// An arm with a hand on it.
#[derive(Debug, Clone, Copy)]
pub struct ArmSetup<'a> {
    /// Its options.
    pub config: &'a ArmConfig,
    /// Arm and hand; the root link is the arm's base.
    pub robot: &'a RobotModel,
}

/// A feasible motion, as the commands of the controllers.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedMotion {
    /// Pose of the object on the table; for an arm, where the arm grasps it.
    pub table_from_object: Pose<Table, Object>,
    /// Trajectory of the palm or arm, from rest to rest, to the end of the lift.
    pub carrier: PalmTrajectory,
    /// Trajectory of the fingers, to the end of the squeeze.
    pub fingers: JointTrack,
    /// The protocol, with the durations that the motion needs.
    pub grasp: Protocol,
}

impl<'a> Planner<'a> {
    /// Creates the planner of a robot.
    ///
    /// # Errors
    ///
    /// Fails if an option is invalid, in itself or for this robot.
    pub fn new(config: &PlannerConfig<'a>) -> Result<Self, OptionFault> {
        let PlannerConfig {
            hand,
            arm,
            protocol,
            limits,
            rates,
        } = *config;
        let arm = arm.map(|arm| Arm::new(arm.config, arm.robot, hand));
        let arm = arm.transpose()?;
        let limits = Limits::new(limits, hand)?;
        let flexion = Flexion::new(protocol, hand)
            .map_err(|err| OptionFault::new("protocol.flexion_joints", err.to_string()))?;
        if let Some(fault) = protocol.cell_fault() {
            return Err(fault);
        }
        let path_s = protocol.path_s();
        if !(path_s.is_finite() && path_s > 0.0) {
            let problem = format!("it leaves the palm {path_s} s for its path");
            return Err(OptionFault::new("protocol.reach_s", problem));
        }
        Ok(Self {
            hand,
            protocol,
            limits,
            rates,
            flexion,
            arm,
        })
    }

    /// Plans a feasible motion; its joints are in the order of the hand's.
    ///
    /// It follows the given motion's path from rest to rest, nowhere faster than in the screen, and
    /// slower where a limit requires it.
    ///
    /// # Errors
    ///
    /// Fails with the reason why the motion is infeasible.
    pub fn plan(
        &self,
        motion: &Motion<Object>,
        table_from_object: &Pose<Table, Object>,
    ) -> Result<PlannedMotion, Infeasible> {
        let spline = MotionSpline::through(motion.reordered(&self.hand.joint_names())?)?;
        self.check_spline(&spline, table_from_object)?;
        let grasp = spline.grasp().q_rad;
        let fingers = Fingers {
            opened: match self.protocol.approach {
                Approach::Follow | Approach::AtGrasp => None,
                Approach::Open => Some(self.flexion.flexed(&grasp, -self.protocol.open_rad)),
            },
            squeezed: self.flexion.flexed(&grasp, self.protocol.squeeze_rad),
            grasp,
        };
        let stands = |motion_s: f64| {
            let opened = fingers.opened.clone();
            opened.unwrap_or_else(|| spline.at(motion_s).q_rad)
        };
        let lift_m = self.protocol.lift_m;
        let arm = self.arm.as_ref();
        let arm = arm.map(|arm| arm.follow(&spline, table_from_object, stands, lift_m));
        self.time_scaled(
            &spline,
            &fingers,
            arm.transpose()?.as_ref(),
            table_from_object,
        )
    }

    /// Refuses a motion with a joint outside its limits, or with the hand deeper below the table
    /// than the protocol allows.
    fn check_spline(
        &self,
        spline: &MotionSpline<Object>,
        table_from_object: &Pose<Table, Object>,
    ) -> Result<(), Infeasible> {
        let places = (spline.duration_s() * self.rates.palm_hz).ceil().max(1.0);
        let places = whole_ticks(places).ok_or(Infeasible::Slow {
            slower: f64::INFINITY,
            max: self.limits.config.max_slowdown,
        })?;
        for place in 0..=places {
            let time_s = spline.duration_s() * place as f64 / places as f64;
            let hand = spline.at(time_s);
            self.check_joints(&hand.q_rad, time_s)?;
            let table_from_palm = *table_from_object * hand.frame_from_palm;
            self.check_table(&table_from_palm, &hand.q_rad, time_s)?;
        }
        Ok(())
    }

    fn check_joints(&self, q: &[f64], time_s: f64) -> Result<(), Infeasible> {
        let tolerance = self.protocol.limit_tolerance_rad;
        for (joint, &q) in self.hand.joints().iter().zip(q) {
            check_joint(joint, [q, q], tolerance, time_s)?;
        }
        Ok(())
    }

    fn check_table(
        &self,
        table_from_palm: &Pose<Table, Palm>,
        q: &[f64],
        time_s: f64,
    ) -> Result<(), Infeasible> {
        let palm_from_links = self.hand.forward_kinematics(q)?;
        for (link, palm_from_link) in self.hand.links().iter().zip(&palm_from_links) {
            for collision in &link.collisions {
                let table_from_shape =
                    *table_from_palm * *palm_from_link * collision.link_from_shape;
                let depth_m = -collision.shape.lowest_m(&table_from_shape, &Vector3::z());
                // A comparison with NaN is false.
                let is_above = depth_m <= self.protocol.table_tolerance_m;
                if !is_above {
                    return Err(Infeasible::Table {
                        link: link.name.clone(),
                        depth_m,
                        time_s,
                    });
                }
            }
        }
        Ok(())
    }
}

/// Refuses a joint that is outside its limits by more than a tolerance.
pub(crate) fn check_joint(
    joint: &Joint,
    [low, high]: [f64; 2],
    tolerance: f64,
    time_s: f64,
) -> Result<(), Infeasible> {
    let tolerance = tolerance + ROUNDING_RAD;
    let inside = low >= joint.lower - tolerance && high <= joint.upper + tolerance;
    if joint.kind == JointKind::Continuous || inside {
        return Ok(());
    }
    Err(Infeasible::Limit {
        joint: joint.name.clone(),
        q: if low < joint.lower - tolerance {
            low
        } else {
            high
        },
        time_s,
        lower: joint.lower,
        upper: joint.upper,
    })
}

/// Returns the fraction of the reach in which the fingers close.
pub(crate) fn closing(protocol: &Protocol) -> f64 {
    protocol.close_fraction.clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests;
