//! `dexpilot`'s projection: two fingertips of a person that nearly touch are to touch.
//!
//! Of a vector between fingertips that pinch, the direction is the person's and the length a constant, and its weight
//! is hundreds of times that of others (Handa et al., 2020, §IV-B, with the weights of dex-retargeting 0.5.0).

use nalgebra::Vector3;

/// Length of a vector from the thumb to a finger that pinches with it, in meters.
const THUMB_DISTANCE_M: f64 = 1e-4;
/// Length of a vector between two fingers that both pinch with the thumb, in meters.
const FINGER_DISTANCE_M: f64 = 3e-2;
/// Distance of such fingers beyond which they are followed as they are, in meters.
const MAX_FINGER_DISTANCE_M: f64 = 0.03;
/// Weights of those vectors.
const THUMB_WEIGHT: f64 = 200.0;
const FINGER_WEIGHT: f64 = 400.0;
/// What the library adds to a length before it divides by it, in meters.
const LEAST_LENGTH_M: f64 = 1e-6;

/// The pinches of a hand, which last until the fingers part.
#[derive(Debug, Clone)]
pub(crate) struct Pinches {
    fingers: usize,
    scale: f64,
    project_distance_m: f64,
    escape_distance_m: f64,
    /// Whether the thumb pinches with each other finger.
    with_thumb: Vec<bool>,
}

impl Pinches {
    pub(crate) fn new(
        fingers: usize,
        scale: f64,
        project_distance_m: f64,
        escape_distance_m: f64,
    ) -> Self {
        Self {
            fingers,
            scale,
            project_distance_m,
            escape_distance_m,
            with_thumb: vec![false; fingers.saturating_sub(1)],
        }
    }

    /// Forgets all pinches.
    pub(crate) fn reset(&mut self) {
        self.with_thumb.fill(false);
    }

    /// Calls `follow` with each vector's number, target (m) and weight, for the person's vectors (m).
    pub(crate) fn targets(
        &mut self,
        references: &[[f64; 3]],
        mut follow: impl FnMut(usize, Vector3<f64>, f64),
    ) {
        let vector = |idx: usize| Vector3::from(references[idx]);
        for (idx, pinches) in self.with_thumb.iter_mut().enumerate() {
            let distance_m = vector(idx).norm();
            if distance_m < self.project_distance_m {
                *pinches = true;
            } else if distance_m > self.escape_distance_m {
                *pinches = false;
            }
        }
        let mut idx = 0;
        let mut between = |idx: usize, pinches: bool, length_m: f64, weight: f64| {
            let vector = vector(idx);
            if pinches {
                follow(
                    idx,
                    vector * (length_m / (vector.norm() + LEAST_LENGTH_M)),
                    weight,
                );
            } else {
                follow(idx, vector * self.scale, 1.0);
            }
        };
        for &pinches in &self.with_thumb {
            between(idx, pinches, THUMB_DISTANCE_M, THUMB_WEIGHT);
            idx += 1;
        }
        for earlier in 0..self.with_thumb.len() {
            for later in earlier + 1..self.with_thumb.len() {
                let both = self.with_thumb[earlier] && self.with_thumb[later];
                let is_near = vector(idx).norm() <= MAX_FINGER_DISTANCE_M;
                between(idx, both && is_near, FINGER_DISTANCE_M, FINGER_WEIGHT);
                idx += 1;
            }
        }
        // Those from the wrist weigh as much as all others of a hand that does not pinch, and more.
        let weight = (idx + self.fingers) as f64;
        for idx in idx..references.len() {
            follow(idx, vector(idx) * self.scale, weight);
        }
    }
}

/// Returns the numbers of the links at each vector's ends: 0 is the wrist, 1 the thumb's tip, then the other fingers'.
pub(crate) fn vectors(fingers: usize) -> Vec<[usize; 2]> {
    let pairs = (1..fingers).flat_map(|earlier| {
        let later = earlier + 1..=fingers;
        later.map(move |later| [later, earlier])
    });
    let of_wrist = (1..=fingers).map(|finger| [0, finger]);
    pairs.chain(of_wrist).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vectors_are_in_the_librarys_order() {
        assert_eq!(vectors(3), [[2, 1], [3, 1], [3, 2], [0, 1], [0, 2], [0, 3]]);
    }

    /// Returns the targets of a hand of three fingers whose tips and thumb are this far apart along x.
    fn targets(pinches: &mut Pinches, lengths_m: [f64; 6]) -> Vec<(f64, f64)> {
        let references = lengths_m.map(|length| [length, 0.0, 0.0]);
        let mut found = Vec::new();
        pinches.targets(&references, |_, target, weight| {
            found.push((target.x, weight));
        });
        found
    }

    #[test]
    fn a_pinch_begins_below_one_distance_and_ends_above_the_other() {
        let mut pinches = Pinches::new(3, 2.0, 0.03, 0.05);
        let open = [0.04, 0.1, 0.08, 0.1, 0.1, 0.1];
        assert_eq!(
            targets(&mut pinches, open),
            [
                (0.08, 1.0),
                (0.2, 1.0),
                (0.16, 1.0),
                (0.2, 6.0),
                (0.2, 6.0),
                (0.2, 6.0)
            ]
        );
        let closed = [0.02, 0.1, 0.08, 0.1, 0.1, 0.1];
        let (length, weight) = targets(&mut pinches, closed)[0];
        assert!((length - 1e-4).abs() < 1e-7 && weight == 200.0);
        // Between both distances it lasts.
        assert_eq!(targets(&mut pinches, open)[0].1, 200.0);
        let parted = [0.06, 0.1, 0.08, 0.1, 0.1, 0.1];
        assert_eq!(targets(&mut pinches, parted)[0], (0.12, 1.0));
    }

    #[test]
    fn two_fingers_that_pinch_with_the_thumb_keep_their_distance() {
        let mut pinches = Pinches::new(3, 1.0, 0.03, 0.05);
        let both = [0.01, 0.01, 0.02, 0.1, 0.1, 0.1];
        let (length, weight) = targets(&mut pinches, both)[2];
        assert!(
            (length - 0.03).abs() < 2e-6 && weight == 400.0,
            "{length} {weight}"
        );
        let far = [0.01, 0.01, 0.04, 0.1, 0.1, 0.1];
        assert_eq!(targets(&mut pinches, far)[2], (0.04, 1.0));
    }
}
