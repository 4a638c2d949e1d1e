//! Inputs of `candidates` and of their report: the hand and its joints.

use dataflow::SourceFile;
use robot::{JointOrder, RobotModel};

use crate::{SampleConfig, SampleError};

/// The hand's URDF, of which some units read nothing.
pub fn hand_file(config: &SampleConfig) -> SourceFile {
    SourceFile::named("hand", &config.hand)
}

/// Returns how vectors of `joints`, those of `what`, are put into the order of the hand's.
///
/// # Errors
///
/// Fails if they are not the hand's joints.
pub fn joint_order(
    model: &RobotModel,
    joints: &[String],
    what: &str,
) -> Result<JointOrder, SampleError> {
    JointOrder::new(joints, &model.joint_names()).map_err(|source| SampleError::HandMismatch {
        what: what.to_owned(),
        source,
    })
}
