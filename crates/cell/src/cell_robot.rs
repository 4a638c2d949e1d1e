//! The robot of a cell.

use robot::{Chain, Joint, RobotError, RobotModel};
use spatial::{Base, Palm, Pose, Table};

use crate::{ControllerInfo, Goal, Rejection, acceptance, wire};

/// The arm of a cell.
#[derive(Debug, Clone, PartialEq)]
pub struct CellArm {
    /// URDF of the arm with the hand on it; its root link is the arm's base.
    pub urdf: String,
    /// Name of the link that is the palm.
    pub palm: String,
    /// Pose of the arm's base in the table's frame.
    pub table_from_base: Pose<Table, Base>,
}

/// The robot of a cell: a hand, and the arm that carries it if there is one.
pub struct CellRobot {
    /// Digest of its URDF ([`crate::robot_digest`]): the arm's, if there is one.
    pub(crate) digest: String,
    /// The hand alone.
    pub(crate) hand: RobotModel,
    /// The arm that carries it.
    pub(crate) arm: Option<Arm>,
}

/// An arm and the place of its base.
pub(crate) struct Arm {
    chain: Chain,
    table_from_base: Pose<Table, Base>,
}

impl CellRobot {
    /// Creates the robot from the hand that `urdf` describes, and the arm that carries it.
    ///
    /// # Errors
    ///
    /// Fails if the arm's URDF cannot be used, or has no link of the palm's name.
    pub fn new(urdf: &str, hand: RobotModel, arm: Option<&CellArm>) -> Result<Self, RobotError> {
        let urdf = arm.map_or(urdf, |arm| arm.urdf.as_str());
        Ok(Self {
            digest: wire::robot_digest(urdf),
            hand,
            arm: arm.map(Arm::new).transpose()?,
        })
    }

    /// Checks that the robot can execute a goal: its joints, their limits, times and the object.
    ///
    /// # Errors
    ///
    /// Fails with the first refusal in the order of the protocol.
    pub fn check(
        &self,
        goal: &Goal,
        object_is_here: impl Fn(&str) -> bool,
    ) -> Result<(), Rejection> {
        acceptance::check(goal, self, object_is_here)
    }

    /// Returns the digest of its URDF ([`crate::robot_digest`]): the arm's, if there is one.
    pub fn digest(&self) -> &str {
        &self.digest
    }

    /// Returns the hand's joints.
    pub fn hand_joints(&self) -> &[Joint] {
        self.hand.joints()
    }

    /// Returns the arm's joints, from base to palm; none if the hand is free-flying.
    pub fn arm_joints(&self) -> &[Joint] {
        self.arm.as_ref().map_or(&[], Arm::joints)
    }

    /// Returns all joints, the hand's before the arm's: the order of all measurements.
    pub fn joints(&self) -> impl Iterator<Item = &Joint> {
        let arm = self.arm.iter().flat_map(Arm::joints);
        self.hand.joints().iter().chain(arm)
    }

    /// Returns their names.
    pub fn joint_names(&self) -> Vec<String> {
        self.joints().map(|joint| joint.name.clone()).collect()
    }

    /// Returns the palm's pose in the table's frame for these positions of the arm.
    pub fn palm(&self, arm_q: &[f64]) -> Option<Pose<Table, Palm>> {
        let arm = self.arm.as_ref()?;
        let state = arm.chain.state(arm_q).ok()?;
        Some(arm.table_from_base * state.base_from_palm)
    }

    /// Returns the pose of the arm's base.
    pub fn table_from_base(&self) -> Option<[f64; 7]> {
        Some(self.arm.as_ref()?.table_from_base.to_array())
    }

    /// Returns its controllers, each commanded once in `control_s` seconds.
    pub fn controllers(&self, control_s: f64) -> Vec<ControllerInfo> {
        let offer = |controller: &str, joints: Vec<String>| ControllerInfo {
            controller: controller.to_owned(),
            joints,
            rate_hz: 1.0 / control_s,
        };
        vec![
            match &self.arm {
                None => offer("palm", Vec::new()),
                Some(arm) => offer("arm", arm.joint_names()),
            },
            offer("hand", self.hand.joint_names()),
        ]
    }
}

impl Arm {
    fn new(arm: &CellArm) -> Result<Self, RobotError> {
        let robot = RobotModel::from_urdf(&arm.urdf)?;
        Ok(Self {
            chain: Chain::to_link(&robot, &arm.palm)?,
            table_from_base: arm.table_from_base,
        })
    }

    /// Returns its joints, from base to palm.
    pub(crate) fn joints(&self) -> &[Joint] {
        self.chain.model().joints()
    }

    /// Returns their names.
    pub(crate) fn joint_names(&self) -> Vec<String> {
        self.chain.model().joint_names()
    }
}
