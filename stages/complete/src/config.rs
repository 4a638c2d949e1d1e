//! Options of `kind = "complete"`.

use completion::Completion;
use options::options;

/// Greatest density, in kilograms per cubic meter: more than lead's.
const MAX_DENSITY: f64 = 20_000.0;
/// Most points on a surface.
const MAX_POINTS: usize = 1_000_000;
/// Most convex parts of an object.
const MAX_PARTS: usize = 4096;

/// Options of `kind = "complete"`.
#[options]
pub struct CompleteConfig {
    /// How the side that no camera saw is estimated
    #[option(default)]
    pub completion: Completion,
    /// Density of the estimated body (kg/m³), from which its mass follows, within 20 g and 1.2 kg: that of water, because an
    /// object that is heavier than estimated slips out of the squeeze that is planned for it
    #[option(default = 1000.0, range = 1.0..=MAX_DENSITY, why = "nothing on a table is denser")]
    pub density_kg_per_m3: f64,
    /// Distance between the points at which distances from the surface are stored (m), as in `retarget`
    #[option(default = 0.0025, range = 1e-4..=1.0, why = "a finer grid of an object fills the memory")]
    pub field_spacing_m: f64,
    /// Points on each object's surface: as many as the paper's network sees, and a few more
    #[option(default = 2048, range = 1..=MAX_POINTS, why = "they are sampled and held in memory for each object")]
    pub points_n: usize,
    /// Most convex parts of each object, for physics: an estimate has no finer ones
    #[option(default = 12, range = 1..=MAX_PARTS, why = "each is a collision shape in every physics step")]
    pub max_convex_parts_n: usize,
}
