//! Refines candidate motions against object and table before physics.
//!
//! `refinement` moves each motion: out of object and table, to a grasp whose fingertips' forces balance. One unit per
//! object. Of at least `draws` consecutive motions with the same resting pose the one with the smallest residual stays a
//! candidate, under its own name and source; the others become its refused draws. Nothing is simulated: `screen`
//! judges every generator alike.

mod config;
mod refine;

pub use config::RefineConfig;
pub use refine::{Refine, RefineMetrics, RefinedCandidates, Refinement, RefusedDraws};
