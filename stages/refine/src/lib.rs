//! Refines candidate motions against object and table before physics.
//!
//! `refinement` moves each motion: out of object and table, to a grasp whose fingertips' forces balance. One unit per
//! object. Of at least `draws` consecutive motions with the same resting pose the best one stays a candidate, under its own
//! name and source; the others become its refused draws. Nothing is simulated: `screen`
//! judges every generator alike.

mod config;
mod refine;

pub use config::{ChooseBy, RefineConfig};
pub use refine::{Refine, RefineMetrics, RefinedCandidates, Refinement, RefusedDraws};
