//! `trajectories`: demonstrations retargeted to a robot hand, one partition per sequence, one row
//! per step.
//!
//! | column                  | type        | unit | meaning                                               |
//! |-------------------------|-------------|------|-------------------------------------------------------|
//! | `object`                | utf8        |      | name of the grasped object                            |
//! | `step`                  | i64         |      | number of the row, from 0                             |
//! | `time_s`                | f64         | s    | since the first step                                  |
//! | `object_from_palm`      | f64 × 7     | m, 1 | palm pose in the object frame: `xyz`, `xyzw`          |
//! | `q_rad`                 | list of f64 | rad  | joint positions, in the order of metadata `joints`    |
//! | `keypoint_error_m`      | f64         | m    | root mean square distance to the landmarks followed   |
//! | `fingertip_error_m`     | f64         | m    | the largest distance of a finger tip to its landmark  |
//! | `rest_up`               | f64 × 3     | 1    | unit vector against gravity, object frame             |
//! | `rest_height_m`         | f64         | m    | height of the object's origin above the table         |

use arrow::{datatypes::Schema, record_batch::RecordBatch};
use spatial::{Object, Palm, Pose, Rest};

use crate::columns::{Columns, Reader, SchemaError, count};

/// Bump on any change to the columns; readers reject every other version.
pub const VERSION: &str = "trajectories/1";

/// One motion of a robot hand that follows a demonstration.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// The demonstration's sequence.
    pub sequence: String,
    /// The grasped object's name.
    pub object: String,
    /// Names of the hand's joints, in the order of [`Step::q_rad`].
    pub joints: Vec<String>,
    /// How the object lay.
    pub rest: Rest,
    /// The steps in time order; the last one is the grasp.
    pub steps: Vec<Step>,
}

/// One step of a trajectory.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Seconds since the first step.
    pub time_s: f64,
    /// Pose of the palm in the object frame.
    pub object_from_palm: Pose<Object, Palm>,
    /// Joint positions in radians.
    pub q_rad: Vec<f64>,
    /// Root mean square distance between the robot's points and the landmarks, in meters.
    pub keypoint_error_m: f64,
    /// Largest distance between a finger tip and its landmark, in meters.
    pub fingertip_error_m: f64,
}

/// Returns the Arrow schema for a hand with these joints.
pub fn schema(joints: &[String]) -> Schema {
    columns(joints, &[]).schema()
}

fn columns(joints: &[String], trajectories: &[&Trajectory]) -> Columns {
    let rows = || {
        trajectories.iter().flat_map(|d| {
            d.steps
                .iter()
                .enumerate()
                .map(move |(step, s)| (*d, step, s))
        })
    };
    let mut c = Columns::new(VERSION).with_joints(joints);
    c.utf8(
        "object",
        "name of the grasped object",
        rows().map(|(d, _, _)| d.object.clone()),
    );
    c.i64(
        "step",
        "number of the row, from 0",
        rows().map(|(_, step, _)| count(step)),
    );
    c.f64(
        "time_s",
        "s",
        "since the first step",
        rows().map(|(_, _, s)| s.time_s),
    );
    c.f64_array(
        "object_from_palm",
        "m, 1",
        "palm pose in the object frame: xyz, xyzw",
        rows().map(|(_, _, s)| s.object_from_palm.to_array()),
    );
    c.f64_list(
        "q_rad",
        "rad",
        "joint positions, in the order of metadata `joints`",
        rows().map(|(_, _, s)| s.q_rad.clone()),
    );
    c.f64(
        "keypoint_error_m",
        "m",
        "root mean square distance to the landmarks followed",
        rows().map(|(_, _, s)| s.keypoint_error_m),
    );
    c.f64(
        "fingertip_error_m",
        "m",
        "largest distance of a finger tip to its landmark",
        rows().map(|(_, _, s)| s.fingertip_error_m),
    );
    c.rest(rows().map(|(d, _, _)| d.rest));
    c
}

/// Returns one row per step; the sequence is the partition, not a column.
///
/// # Errors
///
/// Fails if a number is not finite.
pub fn to_batch(trajectory: &Trajectory) -> Result<RecordBatch, SchemaError> {
    columns(&trajectory.joints, &[trajectory]).into_batch()
}

/// Reads what [`to_batch`] wrote for `sequence`.
///
/// # Errors
///
/// Fails if the columns are of another version, there is no row, or a row has another number of
/// joint positions than there are joints.
pub fn from_batch(sequence: &str, batch: &RecordBatch) -> Result<Trajectory, SchemaError> {
    let r = Reader::new(batch, VERSION)?;
    r.expect_some_rows()?;
    let joints = r.joints()?;
    let mut steps = Vec::with_capacity(r.rows());
    for row in 0..r.rows() {
        steps.push(Step {
            time_s: r.f64("time_s", row)?,
            object_from_palm: r.pose("object_from_palm", r.f64_array("object_from_palm", row)?)?,
            q_rad: r.joint_positions("q_rad", row, joints.len())?,
            keypoint_error_m: r.f64("keypoint_error_m", row)?,
            fingertip_error_m: r.f64("fingertip_error_m", row)?,
        });
    }
    Ok(Trajectory {
        sequence: sequence.to_owned(),
        object: r.utf8("object", 0)?.to_owned(),
        joints,
        rest: r.rest(0)?,
        steps,
    })
}
