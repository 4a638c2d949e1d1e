//! The arm that carries the hand: its joints over a whole motion.
//!
//! A motion says where the palm goes, in the object's frame. An object that stands somewhere on the
//! table may be turned about the vertical with the hand that grasps it: what was screened stays what it
//! is. For some directions the arm can follow in some of its postures, for some in none.

mod choice;
mod clearance;
mod config;
mod hand;
mod path;
mod trace;
mod way;

use nalgebra::Isometry3;
use robot::{Chain, RobotModel, WrongDof};

use crate::{OptionError, limits::Most};
use clearance::Clearance;
pub use config::{ArmConfig, Base};
pub(crate) use path::{ArmMoving, ArmPath};

/// Joints that an arm must have: with fewer a hand cannot be brought to any pose, with more the pose does
/// not say where they are.
const JOINTS: usize = 6;

/// An arm with a hand.
#[derive(Debug, Clone)]
pub(crate) struct Arm {
    config: ArmConfig,
    /// Arm and hand.
    robot: RobotModel,
    chain: Chain,
    /// Which of the robot's joints each joint of the hand is.
    fingers: Vec<usize>,
    base_from_table: Isometry3<f64>,
    /// How fast each joint of the arm may move.
    limits: Vec<Most>,
    clearance: Clearance,
}

impl Arm {
    /// Takes an arm with the hand for which motions are made.
    ///
    /// # Errors
    ///
    /// Fails if an option cannot be used, if the arm has not six joints with speeds, and if what it carries
    /// is not the hand.
    pub(crate) fn new(
        config: &ArmConfig,
        robot: &RobotModel,
        hand: &RobotModel,
    ) -> Result<Self, OptionError> {
        config.check()?;
        let of_palm = |err: robot::RobotError| OptionError::new("arm.palm", err.to_string());
        let palm = robot.require_link(&config.palm).map_err(of_palm)?;
        let chain = Chain::to_link(robot, &config.palm).map_err(of_palm)?;
        if chain.dof() != JOINTS {
            let problem = format!(
                "{} joints lead from the arm's foot to it, not {JOINTS}",
                chain.dof()
            );
            return Err(OptionError::new("arm.palm", problem));
        }
        let fingers = hand::joints_of_hand(robot, &chain, palm, hand)?;
        let joints = || chain.model().joints().iter();
        if let Some(joint) = joints().find(|joint| joint.velocity <= 0.0) {
            let problem = format!("it gives joint `{}` no speed", joint.name);
            return Err(OptionError::new("arm.robot", problem));
        }
        let limits = joints().map(|joint| Most {
            velocity: joint.velocity * config.velocity_scale,
            acceleration: config.acceleration_rad_per_s2,
        });
        Ok(Self {
            limits: limits.collect(),
            clearance: Clearance::new(robot, palm, config.clearance_m),
            base_from_table: config.table_from_base()?.isometry().inverse(),
            config: config.clone(),
            chain,
            fingers,
            robot: robot.clone(),
        })
    }

    /// Returns the names of the arm's joints, from its foot to the hand: the order of all its numbers.
    pub(crate) fn joint_names(&self) -> Vec<String> {
        self.chain.model().joint_names()
    }

    /// Returns how fast each joint of the arm may move.
    pub(crate) fn limits(&self) -> &[Most] {
        &self.limits
    }

    /// The arm's joints, from its foot to the hand.
    pub(crate) fn joints(&self) -> &[robot::Joint] {
        self.chain.model().joints()
    }

    /// Returns the pose of each of the robot's links in the frame of the arm's foot, for joints of the arm
    /// and of the hand.
    ///
    /// # Errors
    ///
    /// Fails unless there is one position for each of them.
    fn links(&self, arm: &[f64], hand: &[f64]) -> Result<Vec<Isometry3<f64>>, WrongDof> {
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
