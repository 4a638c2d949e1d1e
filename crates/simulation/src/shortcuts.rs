//! What is left out of a rollout because it cannot change the verdict.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What is not simulated because it cannot change the verdict; all of it by default.
///
/// `cargo bench --bench shortcuts` carries out thousands of rollouts with all of them and with none,
/// and compares the verdicts. (Beginning the reach only where the hand comes near is not among them: the
/// fingers then arrive slightly elsewhere, and grasps that hold by chance fail by chance.) A rollout whose steps are recorded is always carried out to its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(inline)]
pub struct Shortcuts {
    /// Motions that geometry alone refuses are not simulated (true). Without it they are carried out
    /// all the same, and then refused.
    pub refused: bool,
    /// A rollout ends as soon as the object lies or falls below the whole hand (true).
    pub lost: bool,
    /// A rollout ends as soon as the object has rested in the hand for a while (true).
    pub settled: bool,
}

impl Shortcuts {
    /// Everything is simulated.
    pub const NONE: Self = Self {
        refused: false,
        lost: false,
        settled: false,
    };
    /// Nothing is simulated in vain.
    pub const ALL: Self = Self {
        refused: true,
        lost: true,
        settled: true,
    };
}

impl Default for Shortcuts {
    fn default() -> Self {
        Self::ALL
    }
}
