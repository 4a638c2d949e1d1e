//! Options of `kind = "ingest"`.

use std::{collections::BTreeMap, path::PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Options of `kind = "ingest"`.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct IngestConfig {
    /// Folder of the dataset in `DexYCB`'s layout: `SUBJECT/SEQUENCE/meta.yml`, `calibration`,
    /// `models`.
    #[serde(skip_serializing)]
    pub root: PathBuf,
    /// Hand side to keep; recordings of the other side are left out.
    pub hand: Hand,
    /// Images per second of the recordings, in Hz.
    pub rate_hz: f64,
    /// Distance from its resting place beyond which a still object has moved, in meters.
    pub move_threshold_m: f64,
    /// Angle from its resting orientation beyond which a still object has moved, in radians.
    pub move_threshold_rad: f64,
    /// Multiple of the object's own jitter at rest that counts as moved where that is more than
    /// the thresholds.
    pub jitter_factor: f64,
    /// Images in a row (or all that are left) that must show the object away from its rest.
    pub settle_n: usize,
    /// Longest run of images without a hand that is bridged by interpolation; a longer one inside
    /// the reach makes the recording unusable.
    pub max_gap_n: usize,
    /// Fewest steps of a reach.
    pub min_steps_n: usize,
    /// Points on each object's surface.
    pub points_n: usize,
    /// Most convex parts of each object, for physics.
    pub max_convex_parts_n: usize,
    /// True masses in kilograms by object name, for objects that are not among YCB's or to
    /// overrule YCB's table.
    #[serde(default)]
    pub masses_kg: BTreeMap<String, f64>,
}

/// Side of a human hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Hand {
    /// The right hand, the side of every landmark in `demonstrations`.
    Right,
}

impl Hand {
    /// Returns the word by which `meta.yml` names the side.
    pub(crate) fn as_str(self) -> &'static str {
        match self {
            Self::Right => "right",
        }
    }
}
