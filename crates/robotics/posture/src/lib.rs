//! Postures of a robot hand: points and vectors follow targets, links keep out of things, fingertips touch surfaces.
//!
//! A [`CompiledHand`] is a robot prepared once; a [`Task`] says what one step asks; a [`Solver`]
//! moves a posture to a minimum of it, without allocating. [`Hand`] adds what a [`HandTable`] says of the
//! robot, and spheres that fill its links; [`EnvironmentTerms`] are the terms of an object on a table.
//! Everything is in `f64`, in meters and radians, in the object's frame; no search leaves the joints' limits.
//!
//! The hand's structure is what makes it fast: second derivatives are gathered body by body from
//! the tips to the root, as composite inertias are, and their matrix is an arrow, one block per
//! finger bordered by what moves all fingers.
//!
//! Of a person's hand it knows the names of landmarks; of demonstrations, motions and files nothing.

mod arrow;
mod check;
mod closing;
mod compiled;
mod differentiate;
mod environment;
mod environment_terms;
mod error;
mod evaluate;
#[cfg(test)]
mod fixture;
mod hand;
mod hand_table;
mod initial_postures;
mod layout;
mod limits;
mod minimize;
mod moments;
mod pairs;
mod posture;
mod propose;
mod self_gap_terms;
mod solver_error;
mod task;
#[cfg(test)]
mod tests;
mod trig;
mod vectors;

pub use closing::{contact_share, openness};
pub use compiled::{CompiledHand, Root};
pub use environment::{Environment, SignedDistance};
pub use environment_terms::{CollisionPenalty, ContactTarget, EnvironmentTerms};
pub use error::PostureError;
pub use evaluate::Posed;
pub use hand::{Hand, HandPoint};
pub use hand_table::{FollowedPoint, HandTable};
pub use minimize::{RootMotion, SearchOptions, SearchOutcome, Solver};
pub use posture::{Posture, RootPose};
pub use schemas::demonstrations::{KEYPOINTS, Side};
pub use self_gap_terms::SelfGapTerms;
pub use solver_error::SolverError;
pub use task::{
    Loss, NoTerms, PairResidual, PosturePrior, Residual, Smoothness, Target, Task, Terms,
    VectorTarget, VectorTargets,
};
