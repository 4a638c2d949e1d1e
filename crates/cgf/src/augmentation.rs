//! Rotations about the object's origin by which object and hand are turned together in training.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::{config::Augmentation, random::Random};

/// Rotations of each scene that [`Augmentation::Released`] draws once, beside none at all.
const RELEASED: usize = 10;
/// The stream of random numbers from which those come.
const STREAM: u64 = 2;

/// How the scenes of a training are turned.
pub(crate) struct Rotations {
    augmentation: Augmentation,
    /// By scene, for [`Augmentation::Released`]: no rotation, then ten that stay.
    fixed: Vec<Vec<UnitQuaternion<f64>>>,
}

impl Rotations {
    /// Draws what stays during a training of `n_scenes` scenes.
    pub(crate) fn new(augmentation: Augmentation, n_scenes: usize, seed: u64) -> Self {
        let mut random = Random::new(seed, STREAM);
        let mut of_scene = || {
            let mut rotations = vec![UnitQuaternion::identity()];
            rotations.extend((0..RELEASED).map(|_| any(&mut random)));
            rotations
        };
        let n_fixed = match augmentation {
            Augmentation::Released => n_scenes,
            Augmentation::None | Augmentation::Vertical | Augmentation::Any => 0,
        };
        Self {
            augmentation,
            fixed: (0..n_fixed).map(|_| of_scene()).collect(),
        }
    }

    /// Says whether a scene is ever turned.
    pub(crate) fn turns(&self) -> bool {
        self.augmentation != Augmentation::None
    }

    /// Draws a rotation for a scene.
    pub(crate) fn draw(&self, scene: usize, random: &mut Random) -> UnitQuaternion<f64> {
        match self.augmentation {
            Augmentation::None => UnitQuaternion::identity(),
            Augmentation::Vertical => {
                let angle = std::f64::consts::TAU * random.uniform();
                UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle)
            }
            Augmentation::Released => {
                let fixed = &self.fixed[scene];
                fixed[random.index(fixed.len())]
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
    fn the_released_rotations_are_eleven_for_each_scene_and_the_same_for_equal_seeds() {
        let drawn = |seed: u64, scene: usize| {
            let rotations = Rotations::new(Augmentation::Released, 2, seed);
            let mut random = Random::new(3, 1);
            let mut drawn: Vec<UnitQuaternion<f64>> = Vec::new();
            for _ in 0..1000 {
                let rotation = rotations.draw(scene, &mut random);
                if drawn.iter().all(|other| other.angle_to(&rotation) > 1e-9) {
                    drawn.push(rotation);
                }
            }
            drawn.sort_by(|a, b| a.angle().total_cmp(&b.angle()));
            drawn
        };
        assert_eq!(drawn(7, 0).len(), 11);
        assert_eq!(drawn(7, 0)[0].angle(), 0.0);
        assert_eq!(drawn(7, 0), drawn(7, 0));
        assert_ne!(drawn(7, 0)[1..], drawn(7, 1)[1..]);
        assert_ne!(drawn(7, 0)[1..], drawn(8, 0)[1..]);
    }

    #[test]
    fn vertical_rotations_leave_gravity_where_it_is() {
        let rotations = Rotations::new(Augmentation::Vertical, 1, 0);
        let mut random = Random::new(0, 1);
        for _ in 0..100 {
            let up = rotations.draw(0, &mut random) * Vector3::z();
            assert!((up - Vector3::z()).norm() < 1e-12);
        }
    }
}
