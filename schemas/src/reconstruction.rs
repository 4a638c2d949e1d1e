//! `reconstruction`: how far a model's motions are from the ones that they were encoded from, one
//! partition per model, one row per sequence.
//!
//! Each motion is decoded from the mean of its latent code at the times of its steps. Means are over
//! these steps; the grasp is the last of them.
//!
//! | column                      | type        | unit | meaning                                    |
//! |-----------------------------|-------------|------|--------------------------------------------|
//! | `sequence`                  | utf8        |      | the recording                              |
//! | `object`                    | utf8        |      | its object                                 |
//! | `split`                     | utf8        |      | `training`, `held_out` or `unseen`         |
//! | `tip_error_mean_m`          | f64         | m    | distance of the finger tips: mean          |
//! | `tip_error_grasp_m`         | f64         | m    | at the grasp                               |
//! | `palm_error_mean_m`         | f64         | m    | distance of the palm's origin: mean        |
//! | `palm_error_grasp_m`        | f64         | m    | at the grasp                               |
//! | `palm_rotation_mean_rad`    | f64         | rad  | angle between the palms: mean              |
//! | `palm_rotation_grasp_rad`   | f64         | rad  | at the grasp                               |
//! | `joint_error_mean_rad`      | f64         | rad  | absolute error of the joints: mean         |
//! | `joint_error_grasp_rad`     | f64         | rad  | at the grasp                               |
//! | `joint_errors_rad`          | list of f64 | rad  | the mean of each joint, order of `joints`  |
//!
//! Positions of prismatic joints are in meters.

use arrow_array::RecordBatch;
use arrow_schema::Schema;

use crate::Table;
use crate::columns::{Columns, Reader, SchemaError};

/// Bump on any change to the columns; readers reject every other version.
const VERSION: &str = "reconstruction/1";

/// How far one motion is from the one that it was encoded from.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Row {
    /// The recording's name.
    pub sequence: String,
    /// Its object's name.
    pub object: String,
    /// `training`, `held_out` or `unseen`.
    pub split: String,
    /// Mean distance of the finger tips, in meters.
    pub tip_error_mean_m: f64,
    /// The same at the grasp.
    pub tip_error_grasp_m: f64,
    /// Mean distance of the palm's origin, in meters.
    pub palm_error_mean_m: f64,
    /// The same at the grasp.
    pub palm_error_grasp_m: f64,
    /// Mean angle between the palms, in radians.
    pub palm_rotation_mean_rad: f64,
    /// The same at the grasp.
    pub palm_rotation_grasp_rad: f64,
    /// Mean absolute error of the joints' positions, in radians (meters if prismatic).
    pub joint_error_mean_rad: f64,
    /// The same at the grasp.
    pub joint_error_grasp_rad: f64,
    /// Mean absolute error of each joint, in radians (meters if prismatic).
    pub joint_errors_rad: Vec<f64>,
}

/// A column: its name, unit, meaning, and where its number is.
type Column = (
    &'static str,
    &'static str,
    &'static str,
    fn(&mut Row) -> &mut f64,
);

/// The columns of numbers.
const NUMBERS: [Column; 8] = [
    (
        "tip_error_mean_m",
        "m",
        "mean distance of the finger tips",
        |row| &mut row.tip_error_mean_m,
    ),
    ("tip_error_grasp_m", "m", "the same at the grasp", |row| {
        &mut row.tip_error_grasp_m
    }),
    (
        "palm_error_mean_m",
        "m",
        "mean distance of the palm's origin",
        |row| &mut row.palm_error_mean_m,
    ),
    ("palm_error_grasp_m", "m", "the same at the grasp", |row| {
        &mut row.palm_error_grasp_m
    }),
    (
        "palm_rotation_mean_rad",
        "rad",
        "mean angle between the palms",
        |row| &mut row.palm_rotation_mean_rad,
    ),
    (
        "palm_rotation_grasp_rad",
        "rad",
        "the same at the grasp",
        |row| &mut row.palm_rotation_grasp_rad,
    ),
    (
        "joint_error_mean_rad",
        "rad",
        "mean absolute error of the joints' positions",
        |row| &mut row.joint_error_mean_rad,
    ),
    (
        "joint_error_grasp_rad",
        "rad",
        "the same at the grasp",
        |row| &mut row.joint_error_grasp_rad,
    ),
];

/// Returns the Arrow schema for a hand with these joints.
fn schema(joints: &[String]) -> Schema {
    columns(joints, &[]).schema()
}

fn columns(joints: &[String], rows: &[Row]) -> Columns {
    let mut c = Columns::new(VERSION).with_joints(joints);
    c.utf8(
        "sequence",
        "the recording",
        rows.iter().map(|row| row.sequence.clone()),
    );
    c.utf8(
        "object",
        "its object",
        rows.iter().map(|row| row.object.clone()),
    );
    c.utf8(
        "split",
        "training, held_out or unseen",
        rows.iter().map(|row| row.split.clone()),
    );
    for (name, unit, about, number) in NUMBERS {
        let values = rows.iter().map(|row| *number(&mut row.clone()));
        c.f64(name, unit, about, values);
    }
    c.f64_list(
        "joint_errors_rad",
        "rad",
        "mean absolute error of each joint, order of metadata `joints`",
        rows.iter().map(|row| row.joint_errors_rad.clone()),
    );
    c
}

/// Returns one row per sequence of a hand with these joints.
///
/// # Errors
///
/// Fails if a number is not finite.
fn to_batch(joints: &[String], rows: &[Row]) -> Result<RecordBatch, SchemaError> {
    columns(joints, rows).into_batch()
}

/// Reads what [`to_batch`] wrote: the joints and the rows.
///
/// # Errors
///
/// Fails if the columns are of another version or a row has not one error per joint.
fn from_batch(batch: &RecordBatch) -> Result<(Vec<String>, Vec<Row>), SchemaError> {
    let r = Reader::new(batch, VERSION)?;
    let joints = r.joints()?;
    let rows = (0..r.rows()).map(|idx| {
        let mut row = Row {
            sequence: r.utf8("sequence", idx)?.to_owned(),
            object: r.utf8("object", idx)?.to_owned(),
            split: r.utf8("split", idx)?.to_owned(),
            joint_errors_rad: r.f64_list("joint_errors_rad", idx)?,
            ..Row::default()
        };
        for (name, _, _, number) in NUMBERS {
            *number(&mut row) = r.f64(name, idx)?;
        }
        let found = row.joint_errors_rad.len();
        if found != joints.len() {
            let message = format!("{found} numbers for {} joints", joints.len());
            return Err(r.invalid("joint_errors_rad", message));
        }
        Ok(row)
    });
    let rows = rows.collect::<Result<_, _>>()?;
    Ok((joints, rows))
}

/// How far the motions of one model are from the ones that they were encoded from.
#[derive(Debug, Clone, PartialEq)]
pub struct Reconstruction {
    /// Names of the hand's joints, in the order of [`Row::joint_errors_rad`].
    pub joints: Vec<String>,
    /// One row per sequence.
    pub rows: Vec<Row>,
}

impl Table for Reconstruction {
    const NAME: &'static str = "reconstruction";
    const VERSION: &'static str = VERSION;

    fn schema() -> Schema {
        schema(&[])
    }

    fn to_batch(&self) -> Result<RecordBatch, SchemaError> {
        to_batch(&self.joints, &self.rows)
    }

    fn from_batch(_key: &str, batch: &RecordBatch) -> Result<Self, SchemaError> {
        from_batch(batch).map(|(joints, rows)| Self { joints, rows })
    }
}
