//! Rotations about the object's origin by which object and hand are turned together in training.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::{config::Augmentation, random::Random};

/// Rotations of each motion that [`Augmentation::Released`] draws once, beside none at all.
const RELEASED: usize = 10;
/// The stream of random numbers from which those come.
const STREAM: u64 = 2;

/// Rotations for data augmentation: each motion is turned together with its object.
pub(crate) struct Rotations {
    augmentation: Augmentation,
    /// By motion, for [`Augmentation::Released`]: the identity, then ten fixed rotations.
    fixed: Vec<Vec<UnitQuaternion<f64>>>,
}

impl Rotations {
    /// Draws the rotations that stay fixed during a training of `n_tracks` motions.
    pub(crate) fn new(augmentation: Augmentation, n_tracks: usize, seed: u64) -> Self {
        let mut random = Random::new(seed, STREAM);
        let mut of_track = || {
            let mut rotations = vec![UnitQuaternion::identity()];
            rotations.extend((0..RELEASED).map(|_| any(&mut random)));
            rotations
        };
        let n_fixed = match augmentation {
            Augmentation::Released => n_tracks,
            Augmentation::None | Augmentation::Vertical | Augmentation::Any => 0,
        };
        Self {
            augmentation,
            fixed: (0..n_fixed).map(|_| of_track()).collect(),
        }
    }

    /// Says whether a motion is ever turned.
    pub(crate) fn turns(&self) -> bool {
        self.augmentation != Augmentation::None
    }

    /// Returns the number of times that an epoch visits every motion.
    pub(crate) fn repeats(&self) -> usize {
        match self.augmentation {
            Augmentation::Released => 1 + RELEASED,
            Augmentation::None | Augmentation::Vertical | Augmentation::Any => 1,
        }
    }

    /// Returns the fixed rotation of a motion for a repeat below [`Rotations::repeats`]; `None` if
    /// rotations are redrawn at every step.
    pub(crate) fn fixed(&self, track: usize, repeat: usize) -> Option<UnitQuaternion<f64>> {
        self.fixed.get(track)?.get(repeat).copied()
    }

    /// Draws a rotation; the identity if rotations are fixed or absent.
    pub(crate) fn draw(&self, random: &mut Random) -> UnitQuaternion<f64> {
        match self.augmentation {
            Augmentation::None | Augmentation::Released => UnitQuaternion::identity(),
            Augmentation::Vertical => {
                let angle = std::f64::consts::TAU * random.uniform();
                UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle)
            }
            Augmentation::Any => any(random),
        }
    }
}

/// Draws any rotation, each as likely as another: four normal numbers point in a uniform direction.
fn any(random: &mut Random) -> UnitQuaternion<f64> {
    let mut draw = || random.normal();
    let (i, j, k, w) = (draw(), draw(), draw(), draw());
    UnitQuaternion::from_quaternion(Quaternion::from_parts(w, Vector3::new(i, j, k)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_released_rotations_are_eleven_for_each_motion_and_the_same_for_equal_seeds() {
        let fixed = |seed: u64, track: usize| -> Vec<UnitQuaternion<f64>> {
            let rotations = Rotations::new(Augmentation::Released, 2, seed);
            let repeats = 0..rotations.repeats();
            repeats
                .map(|repeat| rotations.fixed(track, repeat).unwrap())
                .collect()
        };
        assert_eq!(fixed(7, 0).len(), 11);
        assert_eq!(fixed(7, 0)[0].angle(), 0.0);
        assert_eq!(fixed(7, 0), fixed(7, 0));
        for (k, rotation) in fixed(7, 0).iter().enumerate() {
            let others = &fixed(7, 0)[..k];
            assert!(others.iter().all(|other| other.angle_to(rotation) > 1e-3));
        }
        assert_ne!(fixed(7, 0)[1..], fixed(7, 1)[1..]);
        assert_ne!(fixed(7, 0)[1..], fixed(8, 0)[1..]);
    }

    #[test]
    fn vertical_rotations_leave_gravity_where_it_is() {
        let rotations = Rotations::new(Augmentation::Vertical, 1, 0);
        let mut random = Random::new(0, 1);
        for _ in 0..100 {
            let up = rotations.draw(&mut random) * Vector3::z();
            assert!((up - Vector3::z()).norm() < 1e-12);
        }
    }
}
