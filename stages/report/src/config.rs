//! Options of `kind = "report"`.

use std::path::PathBuf;

use options::options;

/// Most motions on a page: each has about 20 kB.
const MAX_MOTIONS: usize = 2000;
/// Fewest triangles of an object on a page: fewer are no shape.
const MIN_TRIANGLES: usize = 100;
/// Most triangles of an object on a page: more are megabytes.
const MAX_TRIANGLES: usize = 100_000;

/// Options of `kind = "report"`.
#[options]
pub struct ReportConfig {
    /// File of the robot hand, or its URDF alone, with the meshes that it names.
    #[option(path)]
    pub hand: PathBuf,
    /// Number of recorded motions on the page: one of each reason for failing, one success of each object,
    /// near misses, then others
    #[option(default = 48, range = 0..=MAX_MOTIONS, why = "each motion has about 20 kB")]
    pub motions: usize,
    /// Number of triangles of an object on the page; a larger mesh is simplified, for the page alone
    #[option(
        default = 2000, range = MIN_TRIANGLES..=MAX_TRIANGLES,
        why = "fewer show no shape, more take megabytes"
    )]
    pub object_triangles: usize,
}
