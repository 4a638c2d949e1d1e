//! Options of `kind = "report"`.

use std::path::PathBuf;

use dataflow::{OptionFault, OptionFaults};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Most motions on a page: each has about 20 kB.
const MAX_MOTIONS: usize = 2000;
/// Bounds of an object's triangles on a page: fewer are no shape, more are megabytes.
const TRIANGLES: [usize; 2] = [100, 100_000];

/// Options of `kind = "report"`.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReportConfig {
    /// File of the robot hand, or its URDF alone, with the meshes that it names.
    #[serde(skip_serializing)]
    pub hand: PathBuf,
    /// Number of recorded motions on the page: one of each reason for failing, one success of each object,
    /// near misses, then others
    #[serde(default = "motions")]
    pub motions: usize,
    /// Number of triangles of an object on the page; a larger mesh is simplified, for the page alone
    #[serde(default = "object_triangles")]
    pub object_triangles: usize,
}

fn motions() -> usize {
    48
}

fn object_triangles() -> usize {
    2000
}

impl ReportConfig {
    pub(crate) fn faults(&self) -> Vec<OptionFault> {
        let mut faults = OptionFaults::default();
        let size = "each motion has about 20 kB";
        faults.within("motions", self.motions, 0..=MAX_MOTIONS, size);
        let [least, most] = TRIANGLES;
        let shape = "fewer show no shape, more take megabytes";
        faults.within(
            "object_triangles",
            self.object_triangles,
            least..=most,
            shape,
        );
        faults.found()
    }
}
