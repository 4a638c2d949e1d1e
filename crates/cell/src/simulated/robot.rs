//! The robot of a simulated cell.

use robot::{Chain, Joint, RobotModel};
use simulation::check_hand;
use spatial::{Base, Palm, Pose, Table};

use super::SimulatedCellConfig;
use crate::{CellError, ControllerInfo, wire};

/// The arm of a simulated cell.
#[derive(Debug, Clone, PartialEq)]
pub struct CellArm {
    /// URDF of the arm with the hand on it; its root link is the arm's base.
    pub urdf: String,
    /// Name of the link that is the palm.
    pub palm: String,
    /// Pose of the arm's base in the table's frame.
    pub table_from_base: Pose<Table, Base>,
}

/// The robot of a simulated cell.
pub(super) struct Robot {
    /// Digest of its URDF ([`crate::robot_digest`]): the arm's, if there is one.
    pub(super) digest: String,
    /// The hand alone.
    pub(super) hand: RobotModel,
    /// The arm that carries it.
    pub(super) arm: Option<Arm>,
}

/// An arm that follows its commands exactly.
pub(super) struct Arm {
    chain: Chain,
    table_from_base: Pose<Table, Base>,
}

impl Robot {
    /// Creates the robot from the hand that `urdf` describes, and the arm that carries it.
    pub(super) fn new(
        urdf: &str,
        hand: RobotModel,
        config: &SimulatedCellConfig,
    ) -> Result<Self, CellError> {
        let arm = config.arm.as_ref();
        check_hand(&config.scene, &hand)?;
        let urdf = arm.map_or(urdf, |arm| arm.urdf.as_str());
        Ok(Self {
            digest: wire::robot_digest(urdf),
            hand,
            arm: arm.map(Arm::new).transpose()?,
        })
    }

    /// Returns all joints, the hand's before the arm's: the order of all measurements.
    pub(super) fn joints(&self) -> impl Iterator<Item = &Joint> {
        let arm = self.arm.iter().flat_map(Arm::joints);
        self.hand.joints().iter().chain(arm)
    }

    /// Returns their names.
    pub(super) fn joint_names(&self) -> Vec<String> {
        self.joints().map(|joint| joint.name.clone()).collect()
    }

    /// Returns the palm's pose in the table's frame for these positions of the arm.
    pub(super) fn palm(&self, arm_q: &[f64]) -> Option<Pose<Table, Palm>> {
        let arm = self.arm.as_ref()?;
        let state = arm.chain.state(arm_q).ok()?;
        Some(arm.table_from_base * state.base_from_palm)
    }

    /// Returns the pose of the arm's base.
    pub(super) fn table_from_base(&self) -> Option<[f64; 7]> {
        Some(self.arm.as_ref()?.table_from_base.to_array())
    }

    /// Returns its controllers, each commanded once per control step.
    pub(super) fn controllers(&self, control_s: f64) -> Vec<ControllerInfo> {
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
    fn new(arm: &CellArm) -> Result<Self, CellError> {
        let robot = RobotModel::from_urdf(&arm.urdf)?;
        Ok(Self {
            chain: Chain::to_link(&robot, &arm.palm)?,
            table_from_base: arm.table_from_base,
        })
    }

    /// Returns its joints, from base to palm.
    pub(super) fn joints(&self) -> &[Joint] {
        self.chain.model().joints()
    }

    /// Returns their names.
    pub(super) fn joint_names(&self) -> Vec<String> {
        self.chain.model().joint_names()
    }
}
