//! Options of registration.

use options::{above, options};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Greatest length of an object on a table, in meters.
const MAX_LENGTH_M: f64 = 1.0;

/// In which directions a pose is found.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(inline)]
pub enum Freedom {
    /// Along the table and about its normal: the object lies exactly as its resting orientation says.
    Table,
    /// In all directions, near the resting orientation.
    #[default]
    All,
}

/// What becomes of an object for which two different poses fit alike.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(inline)]
pub enum Ambiguous {
    /// None of them is returned.
    #[default]
    Refuse,
    /// The better one is returned.
    Best,
}

/// How a pose is found, and when it is refused.
#[options]
pub struct RegistrationOptions {
    /// Whether the pose is found along the table alone, or in all directions near the resting orientation
    #[option(default)]
    pub freedom: Freedom,
    /// What becomes of an object for which two different poses fit alike: it is refused, or the better pose taken
    #[option(default)]
    pub ambiguous: Ambiguous,
    /// A seen point this near to the surface is explained by a pose (m): three times the error of a stereo camera's depth at
    /// an arm's length
    #[option(default = 0.004, range = above(0.0, MAX_LENGTH_M), why = "it is a part of an object")]
    pub explained_m: f64,
    /// Least share of the seen points that a pose explains
    #[option(default = 0.95, range = 0.0..=1.0, why = "it is a share")]
    pub least_explained_share: f64,
    /// Greatest share of the object's surface that a pose puts where a camera saw free space
    #[option(default = 0.1, range = 0.0..=1.0, why = "it is a share")]
    pub most_free_share: f64,
    /// Poses are different if the root mean square distance between the surfaces is more than this (m)
    #[option(default = 0.004, range = above(0.0, MAX_LENGTH_M), why = "it is a part of an object")]
    pub different_m: f64,
    /// A different pose fits alike if its residual is less than this many times the best one's
    #[option(default = 1.1, range = 1.0..=100.0, why = "the best residual is the least")]
    pub ambiguous_ratio: f64,
}
