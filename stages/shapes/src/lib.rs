//! Generates training objects: shapes without recordings, beside the objects of the recordings.
//!
//! One unit per shape, seeded by its name, and one for each object of the recordings, which is passed on. A shape is a
//! seen object that is scaled and stretched, or a body of a family: a box, a body of revolution, a prism, a vessel, a
//! vessel with a handle, a blend of rods and boxes, a plate or a pen. Sizes are those of household things that a hand
//! spans, masses follow from a density, resting orientations from the mesh.
//!
//! No shape is made of an unseen object, and one that is like an unseen object is left out.

mod bodies;
mod config;
mod shapes;

pub use config::ShapesConfig;
pub use shapes::{Shapes, ShapesMetrics};
