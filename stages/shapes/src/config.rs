//! Options of `kind = "shapes"`.

use folds::UnseenObjects;
use object_shapes::ShapeOptions;
use options::options;

/// Most shapes of one pipeline.
const MAX_SHAPES: usize = 100_000;
/// Greatest distance that is asked for between a shape and an unseen object, in meters.
const MAX_APART_M: f64 = 1.0;

/// Options of `kind = "shapes"`.
#[options]
pub struct ShapesConfig {
    /// Number of generated shapes: each takes about a second
    #[option(default = 200, range = 0..=MAX_SHAPES, why = "each is a partition")]
    pub count: usize,
    /// Share of them that are objects of the recordings, scaled and stretched; the others are bodies of revolution,
    /// boxes, prisms, vessels and blends
    #[option(default = 0.3, range = 0.0..=1.0, why = "it is a share")]
    pub stretched_share: f64,
    /// Mean distance between the surfaces of a shape and of an unseen object, at the size and rotation at which they
    /// are most alike, below which the shape is left out (m): they would be one object to a function
    #[option(default = 0.005, range = 0.0..=MAX_APART_M, why = "no object of a hand's size is farther off")]
    pub apart_m: f64,
    /// The objects that nothing is made of, as in `train`
    #[option(flatten)]
    pub unseen: UnseenObjects,
    /// The shapes' points and convex parts
    #[option(flatten)]
    pub shape: ShapeOptions,
}
