//! Options of `kind = "refine"`.

use std::path::PathBuf;

use options::options;
use refinement::RefinementConfig;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Most samples of one motion.
const MAX_DRAWS: usize = 10_000;

/// Options of `kind = "refine"`.
#[options]
pub struct RefineConfig {
    /// File of the robot hand, or its URDF alone; the root link is the palm.
    #[option(path)]
    pub hand: PathBuf,
    /// The hand's file: which points of the hand stand for its posture, and which are fingertips.
    #[option(path)]
    pub hand_table: PathBuf,
    /// Of so many consecutive candidates with the same resting pose, the best one is kept, without physics (1); what is
    /// left over competes too, and a pose with fewer keeps one.
    #[option(
        default = 1, range = 1..=MAX_DRAWS,
        why = "each motion is refined, and one of so many is kept"
    )]
    pub draws: usize,
    /// Which of them is the best one
    #[option(default)]
    pub choose_by: ChooseBy,
    /// The objective and its search.
    #[option(flatten)]
    pub refinement: RefinementConfig,
}

/// Which of several refined draws is the best one.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ChooseBy {
    /// That with the smallest residual.
    #[default]
    Residual,
    /// That whose joints the refinement changed least at the grasp, of those in which a finger opposes the thumb.
    Change,
}
