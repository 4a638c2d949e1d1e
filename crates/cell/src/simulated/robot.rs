//! The robot that a simulated cell has.

use robot::RobotModel;

use crate::{CellError, report::Offer, wire};

/// The robot of a simulated cell.
pub(super) struct Robot {
    /// Digest of its URDF ([`crate::robot_digest`]).
    pub(super) digest: String,
    /// The hand alone.
    pub(super) hand: RobotModel,
}

impl Robot {
    /// Takes a hand that flies.
    pub(super) fn flying(urdf: &str) -> Result<Self, CellError> {
        Ok(Self {
            digest: wire::robot_digest(urdf),
            hand: RobotModel::from_urdf(urdf)?,
        })
    }

    /// Returns its controllers, each told something once per control step.
    pub(super) fn controllers(&self, control_s: f64) -> Vec<Offer> {
        let offer = |controller: &str, joints: Vec<String>| Offer {
            controller: controller.to_owned(),
            joints,
            rate_hz: 1.0 / control_s,
        };
        vec![
            offer("palm", Vec::new()),
            offer("hand", self.hand.joint_names()),
        ]
    }
}
