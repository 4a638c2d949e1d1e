//! Options of `kind = "refine"`.

use std::path::PathBuf;

use options::options;
use refinement::RefinementConfig;

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
    /// Of so many consecutive candidates with the same resting pose, the one with the smallest residual is kept,
    /// without physics (1); what is left over competes too, and a pose with fewer keeps one.
    #[option(
        default = 1, range = 1..=MAX_DRAWS,
        why = "each motion is refined, and one of so many is kept"
    )]
    pub draws: usize,
    /// The objective and its search.
    #[option(flatten)]
    pub refinement: RefinementConfig,
}
