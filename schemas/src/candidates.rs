//! `candidates`: motions that have not been screened, one partition per object, one row per motion.
//!
//! | column              | type          | unit | meaning                                                 |
//! |---------------------|---------------|------|---------------------------------------------------------|
//! | `candidate_id`      | utf8          |      | unique in the lake                                      |
//! | `generator`         | utf8          |      | what drew it, e.g. `cgf`                                |
//! | `latent`            | list of f64   | 1    | latent code it came from; empty if there is none        |
//! | `table_from_object` | f64 × 7       | m, 1 | how the object lies: `xyz`, `xyzw`                      |
//! | `time_s`            | list of f64   | s    | since the first step; the last step is the grasp        |
//! | `object_from_palm`  | list f64 × 7  | m, 1 | palm pose in the object frame at each step              |
//! | `q_rad`             | list of f64   | rad  | joint positions, step after step, order of `joints`     |

use arrow::{datatypes::Schema, record_batch::RecordBatch};
use spatial::{Object, Palm, Pose, Table};

use crate::columns::{Columns, Reader, SchemaError};

/// Bump on any change to the columns; readers reject every other version.
pub const VERSION: &str = "candidates/1";

/// A motion to be screened.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Unique name, e.g. `005_tomato_soup_can-0007`.
    pub candidate_id: String,
    /// What drew it, e.g. `cgf`.
    pub generator: String,
    /// The latent code it came from; empty if there is none.
    pub latent: Vec<f64>,
    /// How the object lies on the table.
    pub table_from_object: Pose<Table, Object>,
    /// The steps in time order; the last one is the grasp.
    pub steps: Vec<Step>,
}

/// One step of a motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Seconds since the first step.
    pub time_s: f64,
    /// Pose of the palm in the object frame (the object as it lies before it is touched).
    pub object_from_palm: Pose<Object, Palm>,
    /// Joint positions in radians, in the order of the joints' names.
    pub q_rad: Vec<f64>,
}

/// All candidates of one object.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidates {
    /// The object's name.
    pub object: String,
    /// Names of the hand's joints, in the order of [`Step::q_rad`].
    pub joints: Vec<String>,
    /// The motions.
    pub candidates: Vec<Candidate>,
}

/// Returns the Arrow schema for a hand with these joints.
pub fn schema(joints: &[String]) -> Schema {
    columns(joints, &[]).schema()
}

fn columns(joints: &[String], candidates: &[Candidate]) -> Columns {
    let rows = || candidates.iter();
    let mut c = Columns::new(VERSION).with_joints(joints);
    c.utf8(
        "candidate_id",
        "unique name of the motion",
        rows().map(|m| m.candidate_id.clone()),
    );
    c.utf8(
        "generator",
        "what drew it",
        rows().map(|m| m.generator.clone()),
    );
    c.f64_list(
        "latent",
        "1",
        "latent code it came from",
        rows().map(|m| m.latent.clone()),
    );
    c.f64_array(
        "table_from_object",
        "m, 1",
        "how the object lies: xyz, xyzw",
        rows().map(|m| m.table_from_object.to_array()),
    );
    c.f64_list(
        "time_s",
        "s",
        "since the first step",
        rows().map(|m| m.steps.iter().map(|s| s.time_s).collect()),
    );
    c.f64_arrays(
        "object_from_palm",
        "m, 1",
        "palm pose in the object frame at each step: xyz, xyzw",
        rows().map(|m| {
            m.steps
                .iter()
                .map(|s| s.object_from_palm.to_array())
                .collect()
        }),
    );
    c.f64_list(
        "q_rad",
        "rad",
        "joint positions, step after step, order of metadata `joints`",
        rows().map(|m| {
            m.steps
                .iter()
                .flat_map(|s| s.q_rad.iter().copied())
                .collect()
        }),
    );
    c
}

/// Returns one row per motion; the object is the partition, not a column.
///
/// # Errors
///
/// Fails if a number is not finite.
pub fn to_batch(candidates: &Candidates) -> Result<RecordBatch, SchemaError> {
    columns(&candidates.joints, &candidates.candidates).into_batch()
}

/// Reads what [`to_batch`] wrote for `object`.
///
/// # Errors
///
/// Fails if the columns are of another version or the lists of a row do not fit together.
pub fn from_batch(object: &str, batch: &RecordBatch) -> Result<Candidates, SchemaError> {
    let r = Reader::new(batch, VERSION)?;
    let joints = r.joints()?;
    let mut candidates = Vec::with_capacity(r.rows());
    for row in 0..r.rows() {
        let times = r.f64_list("time_s", row)?;
        let poses: Vec<[f64; 7]> = r.f64_arrays("object_from_palm", row)?;
        let positions = r.joint_positions("q_rad", row, joints.len() * times.len())?;
        if poses.len() != times.len() {
            return Err(r.invalid(
                "object_from_palm",
                format!("{} poses for {} times", poses.len(), times.len()),
            ));
        }
        let mut steps = Vec::with_capacity(times.len());
        for ((time_s, pose), q_rad) in times
            .into_iter()
            .zip(poses)
            .zip(positions.chunks(joints.len().max(1)))
        {
            steps.push(Step {
                time_s,
                object_from_palm: r.pose("object_from_palm", pose)?,
                q_rad: q_rad.to_vec(),
            });
        }
        candidates.push(Candidate {
            candidate_id: r.utf8("candidate_id", row)?.to_owned(),
            generator: r.utf8("generator", row)?.to_owned(),
            latent: r.f64_list("latent", row)?,
            table_from_object: r
                .pose("table_from_object", r.f64_array("table_from_object", row)?)?,
            steps,
        });
    }
    Ok(Candidates {
        object: object.to_owned(),
        joints,
        candidates,
    })
}
