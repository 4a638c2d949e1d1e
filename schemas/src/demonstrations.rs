//! `demonstrations`: a person's hand reaching for an object, one partition per sequence, one row per
//! step, everything in the object's own frame, up to the last step before the object moves.
//!
//! Landmarks: wrist; thumb, index, middle, ring, little finger, four each from base to tip.

use arrow_array::RecordBatch;
use arrow_schema::Schema;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use spatial::RestingPose;

use crate::{
    SchemaError, Table,
    columns::{Reader, Writer, columns, words},
};

/// Label of demonstrations and of what is retargeted from them: source of the data and its terms of
/// use, e.g. `DexYCB, CC BY-NC 4.0`.
pub const TERMS: &str = "terms";

/// Number of landmarks of a hand.
pub const KEYPOINTS: usize = 21;

/// Names of the landmarks in their order.
pub const KEYPOINT_NAMES: [&str; KEYPOINTS] = [
    "wrist",
    "thumb_mcp",
    "thumb_pip",
    "thumb_dip",
    "thumb_tip",
    "index_mcp",
    "index_pip",
    "index_dip",
    "index_tip",
    "middle_mcp",
    "middle_pip",
    "middle_dip",
    "middle_tip",
    "ring_mcp",
    "ring_pip",
    "ring_dip",
    "ring_tip",
    "little_mcp",
    "little_pip",
    "little_dip",
    "little_tip",
];

words! {
    /// Side of a hand.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
    #[serde(rename_all = "snake_case")]
    pub enum Side: "side" {
        /// The right hand.
        Right = "right",
        /// The left hand.
        Left = "left",
    }
}

/// One recorded reach of a hand.
#[derive(Debug, Clone, PartialEq)]
pub struct Demonstration {
    /// The sequence's name, unique in the dataset: `20200709-subject-01-20200709_141754`.
    pub sequence: String,
    /// The grasped object's name.
    pub object: String,
    /// The subject's name.
    pub subject: String,
    /// The hand of the landmarks.
    pub hand: Side,
    /// Whether the other hand was recorded and everything is mirrored.
    pub mirrored: bool,
    /// Why the reach starts where it does.
    pub start_reason: String,
    /// Why the reach ends where it does.
    pub end_reason: String,
    /// The object's resting pose.
    pub rest: RestingPose,
    /// The steps in time order; the last one is the grasp.
    pub steps: Vec<Step>,
}

/// One step of a demonstration.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Number of the recording's image.
    pub image: u32,
    /// Seconds since the first step.
    pub time_s: f64,
    /// Number of cameras whose landmarks agree and were fused; 0 if the step is interpolated, or
    /// the landmarks come from a hand model.
    pub cameras_n: u32,
    /// Whether no image shows the hand and the landmarks are interpolated.
    pub bridged: bool,
    /// The landmarks in the object frame, in meters.
    pub keypoints_m: [[f64; 3]; KEYPOINTS],
}

columns! {
    /// A step with the constants of its demonstration.
    struct Row {
        object: String => "name of the grasped object",
        subject: String => "who grasped",
        hand: Side => "`right` or `left`: the hand of the landmarks",
        mirrored: bool => "whether the other hand was recorded, and all is mirrored",
        start_reason: String => "why the reach starts at its first row",
        end_reason: String => "why the reach ends at its last row",
        step: i64 => "number of the row, from 0",
        image: u32 => "number of the recording's image",
        time_s: f64 ["s"] => "since the first step",
        cameras_n: u32 => "cameras whose landmarks agree; 0: bridged, or not by labels",
        bridged: bool => "whether no image shows the hand, and it is interpolated",
        keypoints_m: [[f64; 3]; KEYPOINTS] ["m"] => "21 landmarks of the hand, xyz each, object frame",
        rest: RestingPose,
    }
}

impl Table for Demonstration {
    const NAME: &'static str = "demonstrations";
    const PARTITION: &'static str = "sequence";
    const VERSION: &'static str = "demonstrations/2";

    fn schema() -> Schema {
        Writer::of::<Row>(Self::VERSION, &[]).schema()
    }

    fn to_batch(&self) -> Result<RecordBatch, SchemaError> {
        let rows = (0..).zip(&self.steps).map(|(number, step)| Row {
            object: self.object.clone(),
            subject: self.subject.clone(),
            hand: self.hand,
            mirrored: self.mirrored,
            start_reason: self.start_reason.clone(),
            end_reason: self.end_reason.clone(),
            step: number,
            image: step.image,
            time_s: step.time_s,
            cameras_n: step.cameras_n,
            bridged: step.bridged,
            keypoints_m: step.keypoints_m,
            rest: self.rest,
        });
        Writer::of(Self::VERSION, &rows.collect::<Vec<_>>()).into_batch()
    }

    fn from_batch(sequence: &str, batch: &RecordBatch) -> Result<Self, SchemaError> {
        let reader = Reader::new(batch, Self::VERSION)?;
        let first: Row = reader.first()?;
        let steps = reader.rows()?.into_iter().map(|row: Row| Step {
            image: row.image,
            time_s: row.time_s,
            cameras_n: row.cameras_n,
            bridged: row.bridged,
            keypoints_m: row.keypoints_m,
        });
        Ok(Self {
            sequence: sequence.to_owned(),
            object: first.object,
            subject: first.subject,
            hand: first.hand,
            mirrored: first.mirrored,
            start_reason: first.start_reason,
            end_reason: first.end_reason,
            rest: first.rest,
            steps: steps.collect(),
        })
    }
}
