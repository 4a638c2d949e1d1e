//! Where a hand is and how its joints stand, at one time.

use spatial::{Palm, Pose};

/// A hand at one time, in frame `F`.
#[derive(Debug, Clone, PartialEq)]
pub struct HandPose<F> {
    /// Pose of the palm.
    pub frame_from_palm: Pose<F, Palm>,
    /// Joint positions in the hand's order, radians (meters if prismatic).
    pub q_rad: Vec<f64>,
}
