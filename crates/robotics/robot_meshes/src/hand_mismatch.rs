//! Motions that were made for another hand than a stage reads.

use std::path::{Path, PathBuf};

use dataflow::Diagnostic;
use robot::{JointMismatch, JointOrder, RobotModel};

/// Candidates are for another hand than the one of the stage that reads them.
#[derive(Debug, thiserror::Error)]
#[error("candidates of `{object}` are not for the hand `{}`", urdf.display())]
pub struct HandMismatch {
    stage: &'static str,
    object: String,
    urdf: PathBuf,
    /// Difference of their joints from the hand's.
    source: JointMismatch,
}

impl HandMismatch {
    /// Checks that the candidates of an object move the joints of this hand, in any order; `stage` is the kind of the
    /// stage that reads them.
    ///
    /// # Errors
    ///
    /// Fails unless their joints are the hand's.
    pub fn check(
        stage: &'static str,
        (object, joints): (&str, &[String]),
        (urdf, hand): (&Path, &RobotModel),
    ) -> Result<(), Self> {
        let order = JointOrder::new(joints, &hand.joint_names());
        order.map(drop).map_err(|source| Self {
            stage,
            object: object.to_owned(),
            urdf: urdf.to_owned(),
            source,
        })
    }
}

impl Diagnostic for HandMismatch {
    fn hint(&self) -> Option<String> {
        Some(format!(
            "use the same `hand` in `retarget` and in `{}`, then run again",
            self.stage
        ))
    }
}
