//! Options of `kind = "ingest"`.

use std::{collections::BTreeMap, path::PathBuf};

use object_shapes::ShapeOptions;
use options::{OptionFaults, Options, above, options};
use schemars::JsonSchema;
use schemas::demonstrations::Side;
use serde::{Deserialize, Serialize};

use crate::selection::Split;

/// Maximum number of images of a recording that options speak of: nine hours at 30 per second.
const MAX_IMAGES: usize = 1_000_000;
/// Maximum number of objects of a scene.
const MAX_OBJECTS: usize = 1000;
/// Greatest length, angle, factor or mass.
const MAX_SETTING: f64 = 1e6;
/// Reason for the range of masses.
const LIFTED: &str = "it is the mass of an object that a hand lifts";

/// Options of `kind = "ingest"`.
#[options(also = Self::object_faults)]
pub struct IngestConfig {
    /// Folder of the dataset
    #[option(path)]
    pub root: PathBuf,
    /// Layout of the dataset
    #[option(default)]
    pub format: Format,
    /// Side of the hand in the demonstrations; recordings of the other side are left out or mirrored
    pub hand: Side,
    /// Whether recordings of the other hand are mirrored in the object's own mirror plane
    #[option(default)]
    pub mirror: bool,
    /// Largest distance of an object from its mirror image at which it is mirrored (m): half the
    /// tolerance between cameras
    #[option(
        default = 0.005, range = above(0.0, MAX_SETTING),
        why = "0 tolerates no noise, and a larger value exceeds any scene"
    )]
    pub max_mirror_error_m: f64,
    /// Folders of the subjects whose recordings are taken; empty: all
    #[option(default)]
    pub subjects: Vec<String>,
    /// Names of the objects whose recordings are taken; empty: all
    #[option(default)]
    pub objects: Vec<String>,
    /// Part of `DexYCB` that is taken
    #[option(default)]
    pub split: Split,
    /// Images per second of the recordings (Hz); without it, what `track.yml` says, else 30, as DexYCB's cameras
    #[option(
        default, range = above(0.0, MAX_RATE_HZ),
        why = "no camera that films a whole hand is faster"
    )]
    pub rate_hz: Option<f64>,
    /// Source of the hand's landmarks
    #[option(default)]
    pub landmarks: Landmarks,
    /// Folder with the user's own `MANO_RIGHT.pkl` and `MANO_LEFT.pkl`
    #[option(path, default)]
    pub mano_models: Option<PathBuf>,
    /// Largest distance between cameras that agree on a hand or an object (m): beyond a finger's
    /// thickness they may see different fingers
    #[option(
        default = 0.01, range = above(0.0, MAX_SETTING),
        why = "0 tolerates no noise, and a larger value exceeds any scene"
    )]
    pub camera_agreement_m: f64,
    /// Source of the table's pose
    #[option(default)]
    pub table: TableRule,
    /// Fewest still objects, the grasped one among them, that must agree on a table without a tag:
    /// one alone stands on any of its sides
    #[option(
        default = 2, range = 1..=MAX_OBJECTS,
        why = "the grasped object counts, and no table holds more"
    )]
    pub min_table_objects_n: usize,
    /// Rule for the last still image
    #[option(default)]
    pub reach: ReachRule,
    /// Distance from its resting place beyond which a still object has moved (m): a few times the
    /// error of labeled poses
    #[option(
        default = 0.004, range = above(0.0, MAX_SETTING),
        why = "0 tolerates no noise, and a larger value exceeds any scene"
    )]
    pub move_threshold_m: f64,
    /// Angle from its resting orientation beyond which a still object has moved (rad), 4°: a few
    /// times the error of labeled poses; unused by "released"
    #[option(
        default = 0.07, range = above(0.0, MAX_SETTING),
        why = "0 tolerates no noise, and a larger value exceeds any scene"
    )]
    pub move_threshold_rad: f64,
    /// Multiple of the object's own jitter at rest that counts as moved, if above the thresholds:
    /// jitter alone hardly ever reaches it; unused by "released"
    #[option(
        default = 4.0, range = above(0.0, MAX_SETTING),
        why = "0 tolerates no noise, and a larger value exceeds any scene"
    )]
    pub jitter_factor: f64,
    /// Consecutive images (or all that remain) that must show the object displaced: a sixth of a
    /// second at 30 Hz, longer than a label error lasts; unused by "released"
    #[option(default = 5, range = 1..=MAX_IMAGES, why = "it counts images of a recording")]
    pub settle_n: usize,
    /// Longest gap without a hand that is interpolated (images), a tenth of a second at 30 Hz; a
    /// longer gap inside the reach makes the recording unusable
    #[option(default = 3, range = 0..=MAX_IMAGES, why = "it counts images of a recording")]
    pub max_gap_n: usize,
    /// Fewest steps of a reach: a third of a second at 30 Hz; shorter ones begin in the grasp
    #[option(default = 11, range = 1..=MAX_IMAGES, why = "it counts images of a recording")]
    pub min_steps_n: usize,
    /// Largest distance of a resting object's lowest point from the table (m): beyond it the pose of
    /// object or table is wrong
    #[option(
        default = 0.02, range = above(0.0, MAX_SETTING),
        why = "0 tolerates no noise, and a larger value exceeds any scene"
    )]
    pub max_table_error_m: f64,
    /// The objects' points and convex parts
    #[option(flatten)]
    pub shape: ShapeOptions,
    /// True masses by object name (kg), for objects outside YCB or to override YCB's table
    #[option(default)]
    pub masses_kg: BTreeMap<String, f64>,
    /// Objects missing from the dataset, or with a replacement mesh, by name
    #[option(default)]
    pub meshes: BTreeMap<String, AddedMesh>,
}

impl IngestConfig {
    fn object_faults(&self, faults: &mut OptionFaults) {
        for (object, &kg) in &self.masses_kg {
            let key = format!("masses_kg.{object}");
            faults.within(&key, kg, above(0.0, MAX_SETTING), LIFTED);
        }
        for (object, mesh) in &self.meshes {
            faults.of_table(&format!("meshes.{object}"), mesh.faults());
        }
    }
}

/// Images per second of `DexYCB`'s cameras, and of recordings whose rate nobody gives.
pub(crate) const USUAL_RATE_HZ: f64 = 30.0;
/// Maximum number of images per second, ten times those of the fastest cameras that film a whole hand.
pub(crate) const MAX_RATE_HZ: f64 = 10_000.0;

/// An object from a file of the user's.
#[options]
pub struct AddedMesh {
    /// Mesh as Wavefront OBJ, in meters
    #[option(path)]
    pub file: PathBuf,
    /// True mass, kg
    #[option(range = above(0.0, MAX_SETTING), why = LIFTED)]
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
