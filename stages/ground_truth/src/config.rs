//! Options of `kind = "ground_truth"`.

use options::options;

/// Options of `kind = "ground_truth"`: none.
#[options]
pub struct GroundTruthConfig {}
