//! The arm that carries the hand: its joint trajectory for a motion.
//!
//! A motion gives the palm's path in the object's frame. An object anywhere on the table may be
//! turned about the vertical together with the grasping hand: the screened motion stays the same.
//! For some yaw angles the arm can follow in some of its postures, for some in none.

mod choice;
mod clearance;
mod config;
mod hand;
mod palm_path;
mod path;
mod trace;

use options::{OptionFault, Options};
use robot::{Chain, Link, RobotModel, WrongDof};
use spatial::{Base, Pose, Table};

use crate::limits::MotionLimits;
use clearance::Clearance;
pub use config::ArmConfig;
pub(crate) use path::{ArmPath, ArmPoint};

/// Number of joints that an arm must have: fewer cannot reach every pose, more leave the joints of
/// a pose undetermined.
const JOINTS: usize = 6;

/// An arm with a hand.
#[derive(Debug, Clone)]
pub(crate) struct Arm {
    config: ArmConfig,
    /// Arm and hand.
    robot: RobotModel,
    chain: Chain,
    /// Index of each of the hand's joints among the robot's.
    fingers: Vec<usize>,
    base_from_table: Pose<Base, Table>,
    /// Limits of each of the arm's joints.
    limits: Vec<MotionLimits>,
    clearance: Clearance,
}

impl Arm {
    /// Creates the arm for a hand.
    ///
    /// # Errors
    ///
    /// Fails if an option is invalid, if the arm does not have six joints with speeds, or if it
    /// does not carry the given hand.
    pub(crate) fn new(
        config: &ArmConfig,
        robot: &RobotModel,
        hand: &RobotModel,
    ) -> Result<Self, OptionFault> {
        config.check().map_err(|fault| fault.within("arm"))?;
        let of_palm = |err: robot::RobotError| OptionFault::new("arm.palm", err.to_string());
        let palm = robot.require_link(&config.palm).map_err(of_palm)?;
        let chain = Chain::to_link(robot, &config.palm).map_err(of_palm)?;
        if chain.dof() != JOINTS {
            let problem = format!(
                "{} joints lead from the arm's base to it, not {JOINTS}",
                chain.dof()
            );
            return Err(OptionFault::new("arm.palm", problem));
        }
        let fingers = hand::joints_of_hand(robot, &chain, palm, hand)?;
        let joints = || chain.model().joints().iter();
        if let Some(joint) = joints().find(|joint| joint.velocity <= 0.0) {
            let problem = format!("it gives joint `{}` no speed", joint.name);
            return Err(OptionFault::new("arm.robot", problem));
        }
        let limits = joints().map(|joint| MotionLimits {
            max_velocity: joint.velocity * config.velocity_scale,
            max_acceleration: config.acceleration_rad_per_s2,
        });
        Ok(Self {
            limits: limits.collect(),
            clearance: Clearance::new(robot, palm, config.clearance_m),
            base_from_table: config.table_from_base()?.inverse(),
            config: config.clone(),
            chain,
            fingers,
            robot: robot.clone(),
        })
    }

    /// Returns the names of the arm's joints, from base to hand: the order of all its numbers.
    pub(crate) fn joint_names(&self) -> Vec<String> {
        self.chain.model().joint_names()
    }

    /// Returns the limits of each of the arm's joints.
    pub(crate) fn limits(&self) -> &[MotionLimits] {
        &self.limits
    }

    /// Returns the arm's joints, from base to hand.
    pub(crate) fn joints(&self) -> &[robot::Joint] {
        self.chain.model().joints()
    }

    /// Returns the pose of each of the robot's links in the arm's base frame, for joint positions
    /// of the arm and of the hand.
    ///
    /// # Errors
    ///
    /// Fails unless there is one position per joint.
    fn links(&self, arm: &[f64], hand: &[f64]) -> Result<Vec<Pose<Base, Link>>, WrongDof> {
        let mut q = vec![0.0; self.robot.dof()];
        for (joints, positions) in [(self.chain.joints(), arm), (&self.fingers, hand)] {
            if joints.len() != positions.len() {
                return Err(WrongDof {
                    expected: joints.len(),
                    found: positions.len(),
                });
            }
            for (&joint, &position) in joints.iter().zip(positions) {
                q[joint] = position;
            }
        }
        self.robot.forward_kinematics(&q)
    }
}

#[cfg(test)]
mod tests;
