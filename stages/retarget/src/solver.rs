//! The solver: postures of a hand whose points follow targets, within joint limits.
//!
//! A [`CompiledHand`] is a robot prepared once; a [`Task`] says what one step asks; a [`Solver`]
//! moves a posture to a minimum of it, without allocating. Everything is in `f64`, in meters and
//! radians, in the object's frame.
//!
//! The hand's structure is what makes it fast: second derivatives are gathered body by body from
//! the tips to the root, as composite inertias are, and their matrix is an arrow, one block per
//! finger bordered by what moves all fingers.

mod arrow;
mod check;
mod compiled;
mod differentiate;
mod error;
mod evaluate;
mod layout;
mod limits;
mod minimize;
mod moments;
mod posture;
mod starts;
mod task;
#[cfg(test)]
mod tests;
mod trig;

pub use compiled::{CompiledHand, Root};
pub use error::SolverError;
pub use evaluate::Posed;
pub use minimize::{Options, Outcome, Solver, Wrist};
pub use posture::{Posture, RootPose};
pub use task::{Loss, NoTerms, Residual, Rest, Smoothness, Target, Task, Terms};
