//! Options of `kind = "retarget"`.

use std::path::PathBuf;

use options::options;
use retargeting::RetargetingConfig;

/// Largest error that makes sense, in meters: its square still adds up accurately.
const MAX_ERROR_M: f64 = 1e6;
/// Coarsest grid spacing of a distance field, in meters: coarser grids miss objects of a hand's size.
const COARSEST_M: f64 = 0.1;
/// Finest grid spacing of a distance field, in meters: finer, a mug has more than 2²⁶ grid points.
const FINEST_M: f64 = 1e-4;

/// Options of `kind = "retarget"`.
#[options]
pub struct RetargetConfig {
    /// File of the robot hand, or its URDF alone; the root link is the palm.
    #[option(path)]
    pub hand: PathBuf,
    /// The hand's file: its side, its size, and which landmark each of its points follows.
    #[option(path)]
    pub hand_table: PathBuf,
    /// Configuration file of dex-retargeting (YAML), whose objective replaces the one below: `position`, `vector` or
    /// `dexpilot`. The robot is that of `hand`, with its link names.
    #[option(path, default)]
    pub dex_retargeting: Option<PathBuf>,
    /// The objective and its search.
    #[option(flatten)]
    pub retargeting: RetargetingConfig,
    /// Grid spacing of an object's distance field (m): a fraction of a finger, at a few megabytes
    /// for each object.
    #[option(
        default = 0.0025, range = FINEST_M..=COARSEST_M,
        why = "a coarser grid misses objects of a hand's size, and a finer one of a mug has more than 2²⁶ points"
    )]
    pub field_spacing_m: f64,
    /// Root mean square keypoint error at the grasp above which a sequence is skipped (m): beyond
    /// it the hand does not reproduce the person's grasp.
    #[option(
        default = 0.05, range = 0.0..=MAX_ERROR_M,
        why = "squares of larger values lose precision in a sum"
    )]
    pub max_keypoint_error_m: f64,
}
