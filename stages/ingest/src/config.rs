//! Options of `kind = "ingest"`.

use std::{collections::BTreeMap, path::PathBuf};

use schemars::JsonSchema;
use schemas::demonstrations::Side;
use serde::{Deserialize, Serialize};

use crate::selection::Split;

/// Options of `kind = "ingest"`.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct IngestConfig {
    /// Folder of the dataset
    #[serde(skip_serializing)]
    pub root: PathBuf,
    /// Layout of the dataset
    #[serde(default)]
    pub format: Format,
    /// Side of the hand in the demonstrations; recordings of the other side are left out or mirrored
    pub hand: Side,
    /// Whether recordings of the other hand are mirrored in the object's own mirror plane
    #[serde(default)]
    pub mirror: bool,
    /// Largest distance of an object from its mirror image at which it is mirrored (m): half the
    /// tolerance between cameras
    #[serde(default = "defaults::max_mirror_error_m")]
    pub max_mirror_error_m: f64,
    /// Folders of the subjects whose recordings are taken; empty: all
    #[serde(default)]
    pub subjects: Vec<String>,
    /// Names of the objects whose recordings are taken; empty: all
    #[serde(default)]
    pub objects: Vec<String>,
    /// Part of `DexYCB` that is taken
    #[serde(default)]
    pub split: Split,
    /// Images per second of the recordings (Hz); without it, what `track.yml` says, else 30, as DexYCB's cameras
    #[serde(default)]
    pub rate_hz: Option<f64>,
    /// Source of the hand's landmarks
    #[serde(default)]
    pub landmarks: Landmarks,
    /// Folder with the user's own `MANO_RIGHT.pkl` and `MANO_LEFT.pkl`
    #[serde(default, skip_serializing)]
    pub mano_models: Option<PathBuf>,
    /// Largest distance between cameras that agree on a hand or an object (m): beyond a finger's
    /// thickness they may see different fingers
    #[serde(default = "defaults::camera_agreement_m")]
    pub camera_agreement_m: f64,
    /// Source of the table's pose
    #[serde(default)]
    pub table: TableRule,
    /// Fewest still objects, the grasped one among them, that must agree on a table without a tag:
    /// one alone stands on any of its sides
    #[serde(default = "defaults::min_table_objects_n")]
    pub min_table_objects_n: usize,
    /// Rule for the last still image
    #[serde(default)]
    pub reach: ReachRule,
    /// Distance from its resting place beyond which a still object has moved (m): a few times the
    /// error of labeled poses
    #[serde(default = "defaults::move_threshold_m")]
    pub move_threshold_m: f64,
    /// Angle from its resting orientation beyond which a still object has moved (rad), 4°: a few
    /// times the error of labeled poses; unused by "released"
    #[serde(default = "defaults::move_threshold_rad")]
    pub move_threshold_rad: f64,
    /// Multiple of the object's own jitter at rest that counts as moved, if above the thresholds:
    /// jitter alone hardly ever reaches it; unused by "released"
    #[serde(default = "defaults::jitter_factor")]
    pub jitter_factor: f64,
    /// Consecutive images (or all that remain) that must show the object displaced: a sixth of a
    /// second at 30 Hz, longer than a label error lasts; unused by "released"
    #[serde(default = "defaults::settle_n")]
    pub settle_n: usize,
    /// Longest gap without a hand that is interpolated (images), a tenth of a second at 30 Hz; a
    /// longer gap inside the reach makes the recording unusable
    #[serde(default = "defaults::max_gap_n")]
    pub max_gap_n: usize,
    /// Fewest steps of a reach: a third of a second at 30 Hz; shorter ones begin in the grasp
    #[serde(default = "defaults::min_steps_n")]
    pub min_steps_n: usize,
    /// Largest distance of a resting object's lowest point from the table (m): beyond it the pose of
    /// object or table is wrong
    #[serde(default = "defaults::max_table_error_m")]
    pub max_table_error_m: f64,
    /// Points on each object's surface: as many as the paper's network sees, and a few more
    #[serde(default = "defaults::points_n")]
    pub points_n: usize,
    /// Most convex parts of each object, for physics: enough for a mug's handle; time per contact
    /// grows with them
    #[serde(default = "defaults::max_convex_parts_n")]
    pub max_convex_parts_n: usize,
    /// True masses by object name (kg), for objects outside YCB or to override YCB's table
    #[serde(default)]
    pub masses_kg: BTreeMap<String, f64>,
    /// Objects missing from the dataset, or with a replacement mesh, by name
    #[serde(default)]
    pub meshes: BTreeMap<String, AddedMesh>,
}

/// Images per second of `DexYCB`'s cameras, and of recordings whose rate nobody gives.
pub(crate) const USUAL_RATE_HZ: f64 = 30.0;
/// Maximum number of images per second, ten times those of the fastest cameras that film a whole hand.
pub(crate) const MAX_RATE_HZ: f64 = 10_000.0;

/// An object from a file of the user's.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AddedMesh {
    /// Mesh as Wavefront OBJ, in meters
    #[serde(skip_serializing)]
    pub file: PathBuf,
    /// True mass, kg
    pub mass_kg: f64,
}

/// Layout of a dataset.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Format {
    /// `DexYCB`'s: `SUBJECT/SEQUENCE/meta.yml`, `calibration`, `models`.
    #[default]
    #[serde(rename = "dexycb")]
    DexYcb,
    /// `HO-Cap`'s: `subject_N/SEQUENCE/meta.yaml`, `calibration`, `models`.
    #[serde(rename = "hocap")]
    HoCap,
    /// Landmarks and object poses as they are: `SUBJECT/SEQUENCE/track.yml` and `track.npz`.
    Tracks,
}

/// Source of a hand's landmarks. If both sources exist, their difference is reported.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Landmarks {
    /// The labels; if no camera has the hand, the hand model, if `mano_models` has it.
    #[default]
    Either,
    /// The labels alone.
    Labels,
    /// The hand model alone.
    Mano,
}

/// Source of the table's pose.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TableRule {
    /// The dataset's tag or mark; where a recording has none, the objects that stand still.
    #[default]
    Tag,
    /// The objects that stand still.
    Objects,
}

/// Rule for the last image before the object moves.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ReachRule {
    /// The object has moved once it stays displaced from the median of its still poses by more than
    /// its own jitter; one frame for the whole reach.
    #[default]
    Robust,
    /// As in the paper's code: the image before the first in which a coordinate of the object is
    /// more than the threshold from that of the first image; each step in the frame of its own image.
    Released,
}

/// Values of options that a pipeline file leaves out; the options say why.
#[rustfmt::skip]
mod defaults {
    pub(super) fn max_mirror_error_m() -> f64 { 0.005 }
    pub(super) fn camera_agreement_m() -> f64 { 0.01 }
    pub(super) fn min_table_objects_n() -> usize { 2 }
    pub(super) fn move_threshold_m() -> f64 { 0.004 }
    pub(super) fn move_threshold_rad() -> f64 { 0.07 }
    pub(super) fn jitter_factor() -> f64 { 4.0 }
    pub(super) fn settle_n() -> usize { 5 }
    pub(super) fn max_gap_n() -> usize { 3 }
    pub(super) fn min_steps_n() -> usize { 11 }
    pub(super) fn max_table_error_m() -> f64 { 0.02 }
    pub(super) fn points_n() -> usize { 2048 }
    pub(super) fn max_convex_parts_n() -> usize { 64 }
}
