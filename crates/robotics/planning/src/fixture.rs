//! Motions and protocols of this crate's tests.

use motion::{Motion, MotionError, Step};
use simulation::Protocol;
use spatial::{Object, Pose, Table};

#[path = "../../motion/tests/motion/swings.rs"]
pub(crate) mod swings;

/// Steps of a motion, and the pose of its object on the table.
#[derive(Debug, Clone)]
pub(crate) struct MotionOnTable {
    pub(crate) joints: Vec<String>,
    pub(crate) steps: Vec<Step<Object>>,
    pub(crate) table_from_object: Pose<Table, Object>,
}

impl MotionOnTable {
    pub(crate) fn motion(&self) -> Result<Motion<Object>, MotionError> {
        Motion::new(&self.joints, self.steps.clone())
    }
}

/// Returns the grasp protocol of a hand without options of its own.
pub(crate) fn protocol() -> Protocol {
    serde_json::from_str(include_str!("../tests/grasp.json")).unwrap()
}
