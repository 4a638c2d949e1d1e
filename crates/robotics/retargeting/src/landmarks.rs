//! A person's hand at one time.

use posture::KEYPOINTS;

/// The landmarks of a person's hand at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LandmarkStep {
    /// Seconds since the first step, finite and later than those before.
    pub time_s: f64,
    /// The landmarks in the object's frame, in meters, finite: the wrist; thumb, index, middle, ring and little
    /// finger, four each from base to tip.
    pub keypoints_m: [[f64; 3]; KEYPOINTS],
}
