//! A hand at one time.

use spatial::{Palm, Pose};

use crate::Step;

/// A hand at one time, in frame `F`.
#[derive(Debug, Clone, PartialEq)]
pub struct HandState<F> {
    /// Pose of the palm.
    pub frame_from_palm: Pose<F, Palm>,
    /// Joint positions in radians (meters if prismatic), in the order of the hand's joints.
    pub q_rad: Vec<f64>,
}

impl<F> HandState<F> {
    /// Returns the hand in another frame.
    #[must_use]
    pub fn expressed_in<G>(self, other_from_frame: &Pose<G, F>) -> HandState<G> {
        HandState {
            frame_from_palm: *other_from_frame * self.frame_from_palm,
            q_rad: self.q_rad,
        }
    }
}

impl<F, R> From<Step<F, R>> for HandState<F> {
    fn from(step: Step<F, R>) -> Self {
        Self {
            frame_from_palm: step.frame_from_palm,
            q_rad: step.q_rad,
        }
    }
}

impl<F, R> From<&Step<F, R>> for HandState<F> {
    fn from(step: &Step<F, R>) -> Self {
        Self {
            frame_from_palm: step.frame_from_palm,
            q_rad: step.q_rad.clone(),
        }
    }
}
