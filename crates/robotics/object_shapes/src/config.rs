//! Options of an object's shape.

use options::options;

/// Maximum number of points on a surface: 48 MB of them with their normals.
const MAX_SURFACE_POINTS: usize = 1_000_000;
/// Maximum number of convex parts of an object.
const MAX_PARTS: usize = 4096;
/// Greatest distance of a part from its simplification, in meters.
const MAX_TOLERANCE_M: f64 = 1e6;

/// What is made of an object's mesh.
#[options]
pub struct ShapeOptions {
    /// Points on each object's surface: as many as the paper's network sees, and a few more
    #[option(
        default = 2048, range = 1..=MAX_SURFACE_POINTS,
        why = "they are sampled and held in memory for each object"
    )]
    pub points_n: usize,
    /// Most convex parts of each object, for physics: enough for a mug's handle; time per contact
    /// grows with them
    #[option(
        default = 64, range = 1..=MAX_PARTS,
        why = "each is a collision shape in every physics step"
    )]
    pub max_convex_parts_n: usize,
    /// Largest distance between a convex part and its simplification (m), the faces on which the object rests being
    /// exact: every firm rest is kept; 0 for at most 32 corners of each part, up to 4 mm off, with which a motion's
    /// screening takes a tenth less time for boxes and a third less for bottles, but these roll off a side on which they
    /// stand
    #[option(
        default = 1e-4, range = 0.0..=MAX_TOLERANCE_M,
        why = "a larger value exceeds any scene"
    )]
    pub part_tolerance_m: f64,
}
