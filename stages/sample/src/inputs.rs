//! What the units of `candidates` and of their report read: the hand and its joints.

use dataflow::{Form, SourceFile};
use robot::{JointOrder, RobotModel};

use crate::{SampleConfig, SampleError};

/// The hand counts as it is read.
pub const ROBOT: Form = Form {
    name: "robot",
    of: robot::read_form,
};

/// Returns the meshes that the hand collides with.
///
/// # Errors
///
/// Fails if the URDF or the place of a mesh cannot be read.
pub fn hand_meshes(config: &SampleConfig) -> Result<Vec<SourceFile>, SampleError> {
    Ok(robot_meshes::sources(&config.hand)?)
}

/// The hand's URDF, of which some units read nothing.
pub fn hand_file(config: &SampleConfig) -> SourceFile {
    SourceFile::named("hand", &config.hand)
}

/// Returns how vectors of `joints`, those of `what`, are put into the order of the hand's.
///
/// # Errors
///
/// Fails if they are not the hand's joints.
pub fn order(model: &RobotModel, joints: &[String], what: &str) -> Result<JointOrder, SampleError> {
    JointOrder::new(joints, &model.joint_names()).map_err(|source| SampleError::AnotherHand {
        what: what.to_owned(),
        source,
    })
}
