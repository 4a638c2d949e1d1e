//! `demonstrations`: a person's hand reaching for an object, one partition per sequence, one row per
//! step, everything in the object's own frame, up to the last step before the object moves.
//!
//! | column                | type     | unit | meaning                                                   |
//! |-----------------------|----------|------|-----------------------------------------------------------|
//! | `object`              | utf8     |      | name of the grasped object                                |
//! | `subject`             | utf8     |      | who grasped                                               |
//! | `hand`                | utf8     |      | `right` or `left`: the hand of the landmarks              |
//! | `mirrored`            | bool     |      | whether the other hand was recorded, and all is mirrored  |
//! | `start_reason`        | utf8     |      | why the reach starts at its first row                     |
//! | `end_reason`          | utf8     |      | why it ends at its last row                               |
//! | `step`                | i64      |      | number of the row, from 0                                 |
//! | `image`               | i64      |      | number of the recording's image                           |
//! | `time_s`              | f64      | s    | since the first step                                      |
//! | `cameras_n`           | i64      |      | cameras whose landmarks agree; 0: bridged, or not by labels |
//! | `bridged`             | bool     |      | whether no image shows the hand, and it is interpolated   |
//! | `keypoints_m`         | f64 × 63 | m    | 21 landmarks of the hand, xyz each, object frame          |
//! | `rest_up`             | f64 × 3  | 1    | unit vector against gravity, object frame                 |
//! | `rest_height_m`       | f64      | m    | height of the object's origin above the table             |
//!
//! Landmarks: wrist; thumb, index, middle, ring, little finger, four each from base to tip.

use arrow_array::RecordBatch;
use arrow_schema::Schema;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use spatial::Rest;

use crate::Table;
use crate::columns::{Columns, Reader, SchemaError, count};

/// Bump on any change to the columns; readers reject every other version.
const VERSION: &str = "demonstrations/2";

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

/// Side of a hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// The right hand.
    Right,
    /// The left hand.
    Left,
}

impl Side {
    /// Both sides.
    pub const ALL: [Self; 2] = [Self::Right, Self::Left];

    /// Returns the side's name: `right` or `left`.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Right => "right",
            Self::Left => "left",
        }
    }

    /// Returns the side of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|side| side.as_str() == name)
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
    /// Whether the other hand was recorded, and everything is its mirror image.
    pub mirrored: bool,
    /// Why the reach starts where it does.
    pub start_reason: String,
    /// Why the reach ends where it does.
    pub end_reason: String,
    /// How the object lay.
    pub rest: Rest,
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
    /// Cameras whose landmarks agree and were fused; 0 where the step is bridged, or the landmarks
    /// come from a hand model.
    pub cameras_n: u32,
    /// Whether no image shows the hand, and the landmarks lie between those before and after.
    pub bridged: bool,
    /// The landmarks in the object frame, in meters.
    pub keypoints_m: [[f64; 3]; KEYPOINTS],
}

/// Returns the Arrow schema.
fn schema() -> Schema {
    columns(&[]).schema()
}

fn columns(demonstrations: &[&Demonstration]) -> Columns {
    let rows = || {
        demonstrations.iter().flat_map(|d| {
            d.steps
                .iter()
                .enumerate()
                .map(move |(step, s)| (*d, step, s))
        })
    };
    let mut c = Columns::new(VERSION);
    c.utf8(
        "object",
        "name of the grasped object",
        rows().map(|(d, _, _)| d.object.clone()),
    );
    c.utf8(
        "subject",
        "who grasped",
        rows().map(|(d, _, _)| d.subject.clone()),
    );
    c.utf8(
        "hand",
        "`right` or `left`: the hand of the landmarks",
        rows().map(|(d, _, _)| d.hand.as_str().to_owned()),
    );
    c.bool(
        "mirrored",
        "whether the other hand was recorded, and all is mirrored",
        rows().map(|(d, _, _)| d.mirrored),
    );
    c.utf8(
        "start_reason",
        "why the reach starts at its first row",
        rows().map(|(d, _, _)| d.start_reason.clone()),
    );
    c.utf8(
        "end_reason",
        "why the reach ends at its last row",
        rows().map(|(d, _, _)| d.end_reason.clone()),
    );
    c.i64(
        "step",
        "number of the row, from 0",
        rows().map(|(_, step, _)| count(step)),
    );
    c.i64(
        "image",
        "number of the recording's image",
        rows().map(|(_, _, s)| i64::from(s.image)),
    );
    c.f64(
        "time_s",
        "s",
        "since the first step",
        rows().map(|(_, _, s)| s.time_s),
    );
    c.i64(
        "cameras_n",
        "cameras whose landmarks agree; 0: bridged, or not by labels",
        rows().map(|(_, _, s)| i64::from(s.cameras_n)),
    );
    c.bool(
        "bridged",
        "whether no image shows the hand, and it is interpolated",
        rows().map(|(_, _, s)| s.bridged),
    );
    c.f64_array(
        "keypoints_m",
        "m",
        "21 landmarks of the hand, xyz each, object frame",
        rows().map(|(_, _, s)| {
            let mut flat = [0.0; 3 * KEYPOINTS];
            for (to, from) in flat.iter_mut().zip(s.keypoints_m.as_flattened()) {
                *to = *from;
            }
            flat
        }),
    );
    c.rest(rows().map(|(d, _, _)| d.rest));
    c
}

/// Returns one row per step; the sequence is the partition, not a column.
///
/// # Errors
///
/// Fails if a number is not finite.
fn to_batch(demonstration: &Demonstration) -> Result<RecordBatch, SchemaError> {
    columns(&[demonstration]).into_batch()
}

/// Reads what [`to_batch`] wrote for `sequence`.
///
/// # Errors
///
/// Fails if the columns are of another version, or there is no row.
fn from_batch(sequence: &str, batch: &RecordBatch) -> Result<Demonstration, SchemaError> {
    let r = Reader::new(batch, VERSION)?;
    r.expect_some_rows()?;
    let mut steps = Vec::with_capacity(r.rows());
    for row in 0..r.rows() {
        let flat: [f64; 3 * KEYPOINTS] = r.f64_array("keypoints_m", row)?;
        let mut keypoints_m = [[0.0; 3]; KEYPOINTS];
        keypoints_m.as_flattened_mut().copy_from_slice(&flat);
        steps.push(Step {
            image: u32::try_from(r.i64("image", row)?)
                .map_err(|err| r.invalid("image", err.to_string()))?,
            time_s: r.f64("time_s", row)?,
            cameras_n: r.u32("cameras_n", row)?,
            bridged: r.bool("bridged", row)?,
            keypoints_m,
        });
    }
    let hand = r.utf8("hand", 0)?;
    Ok(Demonstration {
        sequence: sequence.to_owned(),
        object: r.utf8("object", 0)?.to_owned(),
        subject: r.utf8("subject", 0)?.to_owned(),
        hand: Side::from_name(hand)
            .ok_or_else(|| r.invalid("hand", format!("`{hand}` is neither right nor left")))?,
        mirrored: r.bool("mirrored", 0)?,
        start_reason: r.utf8("start_reason", 0)?.to_owned(),
        end_reason: r.utf8("end_reason", 0)?.to_owned(),
        rest: r.rest(0)?,
        steps,
    })
}

impl Table for Demonstration {
    const NAME: &'static str = "demonstrations";
    const VERSION: &'static str = VERSION;

    fn schema() -> Schema {
        schema()
    }

    fn to_batch(&self) -> Result<RecordBatch, SchemaError> {
        to_batch(self)
    }

    fn from_batch(key: &str, batch: &RecordBatch) -> Result<Self, SchemaError> {
        from_batch(key, batch)
    }
}
