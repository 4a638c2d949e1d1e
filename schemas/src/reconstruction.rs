//! `reconstruction`: reconstruction errors of a model's motions, one partition per model, one row
//! per sequence.
//!
//! Each motion is decoded from the mean of its latent code at the times of its steps. Means are over
//! these steps; the grasp is the last of them. Positions of prismatic joints are in meters.

use arrow_array::RecordBatch;
use arrow_schema::Schema;

use crate::{
    SchemaError, Table,
    columns::{JOINTS, Reader, Writer, columns},
    training::Split,
};

columns! {
    /// The reconstruction error of one motion.
    #[derive(Debug, Clone, PartialEq)]
    pub struct ReconstructionError {
        sequence: String => "the recording",
        object: String => "its object",
        split: Split => "training, held_out or unseen",
        tip_error_mean_m: f64 ["m"] => "mean distance of the finger tips",
        tip_error_grasp_m: f64 ["m"] => "the same at the grasp",
        palm_error_mean_m: f64 ["m"] => "mean distance of the palm's origin",
        palm_error_grasp_m: f64 ["m"] => "the same at the grasp",
        palm_rotation_mean_rad: f64 ["rad"] => "mean angle between the palms",
        palm_rotation_grasp_rad: f64 ["rad"] => "the same at the grasp",
        joint_error_mean_rad: f64 ["rad"] => "mean absolute error of the joints' positions",
        joint_error_grasp_rad: f64 ["rad"] => "the same at the grasp",
        joint_errors_rad: Vec<f64> ["rad"]
            => "mean absolute error of each joint, order of metadata `joints`",
    }
}

/// The reconstruction errors of one model.
#[derive(Debug, Clone, PartialEq)]
pub struct Reconstruction {
    /// Names of the hand's joints, in the order of [`ReconstructionError::joint_errors_rad`].
    pub joints: Vec<String>,
    /// One row per sequence.
    pub rows: Vec<ReconstructionError>,
}

impl Table for Reconstruction {
    const NAME: &'static str = "reconstruction";
    const PARTITION: &'static str = "model";
    const VERSION: &'static str = "reconstruction/1";

    fn schema() -> Schema {
        Writer::of::<ReconstructionError>(Self::VERSION, &[]).schema()
    }

    fn to_batch(&self) -> Result<RecordBatch, SchemaError> {
        let writer = Writer::of(Self::VERSION, &self.rows);
        writer.with_names(JOINTS, &self.joints).into_batch()
    }

    fn from_batch(_key: &str, batch: &RecordBatch) -> Result<Self, SchemaError> {
        let reader = Reader::new(batch, Self::VERSION)?;
        let (joints, rows) = (reader.joints()?, reader.rows::<ReconstructionError>()?);
        for row in &rows {
            let errors = &row.joint_errors_rad;
            SchemaError::check_length("joint_errors_rad", "errors", errors, joints.len())?;
        }
        Ok(Self { joints, rows })
    }
}
