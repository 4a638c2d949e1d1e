//! Configurations of a hand: where its palm is and how its joints are; how far apart two are, and what is between them.

use nalgebra::{UnitQuaternion, Vector3};
use rand::Rng;
use spatial::{Object, Palm, Pose};

/// A palm's pose and the joints' positions: a point of the space that is searched.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Configuration {
    /// Pose of the palm in the object's frame.
    pub(crate) object_from_palm: Pose<Object, Palm>,
    /// Joint positions in radians (meters if prismatic).
    pub(crate) q: Vec<f64>,
}

impl Configuration {
    /// Returns the configuration at a share of the way to another one: on a straight line, the rotation on the
    /// shortest arc.
    pub(crate) fn towards(&self, to: &Self, share: f64) -> Self {
        let [a, b] = [self, to].map(|at| &at.object_from_palm);
        // Rotations equal within rounding have no arc, and either end serves.
        let rotation = a.rotation.try_slerp(&b.rotation, share, 1e-9);
        let joints = self.q.iter().zip(&to.q);
        Self {
            object_from_palm: Pose::from_parts(
                a.translation.vector.lerp(&b.translation.vector, share),
                rotation.unwrap_or(b.rotation),
            ),
            q: joints.map(|(a, b)| a + share * (b - a)).collect(),
        }
    }
}

/// Distance of two configurations: the root of the sum of the squares of the palm's way, its rotation and the joints'
/// changes, each times its weight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Metric {
    /// Weight of a meter of the palm's origin.
    pub translation_per_m: f64,
    /// Weight of a radian of the palm.
    pub rotation_per_rad: f64,
    /// Weight of a radian (meter if prismatic) of a joint.
    pub joint_per_rad: f64,
}

impl Metric {
    /// Returns the distance of two configurations, as a number without unit.
    pub(crate) fn distance(&self, a: &Configuration, b: &Configuration) -> f64 {
        self.squared(a, b).sqrt()
    }

    /// Returns the square of the distance.
    pub(crate) fn squared(&self, a: &Configuration, b: &Configuration) -> f64 {
        let [from, to] = [a, b].map(|at| &at.object_from_palm);
        let way = (to.translation.vector - from.translation.vector).norm_squared();
        // Of the two quaternions of a rotation, the nearer one.
        let cosine = from.rotation.coords.dot(&to.rotation.coords).abs().min(1.0);
        let angle = 2.0 * cosine.acos();
        let joints = a.q.iter().zip(&b.q);
        let joints: f64 = joints.map(|(a, b)| (b - a).powi(2)).sum();
        self.translation_per_m.powi(2) * way
            + (self.rotation_per_rad * angle).powi(2)
            + self.joint_per_rad.powi(2) * joints
    }
}

/// The region in which configurations are drawn: a box for the palm's origin, every rotation, the joints' limits.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Region {
    /// Least and greatest coordinates of the palm's origin in the object's frame, in meters.
    pub(crate) palm_m: [Vector3<f64>; 2],
    /// Least and greatest position of each joint.
    pub(crate) joints: Vec<[f64; 2]>,
}

impl Region {
    /// Draws a configuration, every one as likely as any other.
    pub(crate) fn draw(&self, rng: &mut impl Rng) -> Configuration {
        let [least, greatest] = &self.palm_m;
        let place = Vector3::from_fn(|axis, _| between(rng, least[axis], greatest[axis]));
        let rotation = rotation(rng);
        let joints = self.joints.iter();
        Configuration {
            object_from_palm: Pose::from_parts(place, rotation),
            q: joints.map(|[from, to]| between(rng, *from, *to)).collect(),
        }
    }
}

fn between(rng: &mut impl Rng, from: f64, to: f64) -> f64 {
    from + rng.random::<f64>() * (to - from)
}

/// Draws a rotation, every one as likely as any other (Shoemake, *Uniform Random Rotations*, Graphics Gems III, 1992).
fn rotation(rng: &mut impl Rng) -> UnitQuaternion<f64> {
    let [u, v, w]: [f64; 3] = [rng.random(), rng.random(), rng.random()];
    let [about, along] = [v, w].map(|turn| turn * std::f64::consts::TAU);
    let [outer, inner] = [(1.0 - u).sqrt(), u.sqrt()];
    let coordinates = [
        outer * about.sin(),
        outer * about.cos(),
        inner * along.sin(),
        inner * along.cos(),
    ];
    UnitQuaternion::new_normalize(nalgebra::Quaternion::from(coordinates))
}

#[cfg(test)]
pub(crate) mod tests {
    use nalgebra::Isometry3;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// A palm in the object's frame, two joints.
    pub(crate) fn at(place: [f64; 3], turn: [f64; 3], q: [f64; 2]) -> Configuration {
        Configuration {
            object_from_palm: Pose::new(Isometry3::new(place.into(), turn.into())),
            q: q.to_vec(),
        }
    }

    const METRIC: Metric = Metric {
        translation_per_m: 10.0,
        rotation_per_rad: 2.0,
        joint_per_rad: 1.0,
    };

    #[test]
    fn meters_and_radians_add_with_their_weights() {
        let origin = at([0.0; 3], [0.0; 3], [0.0; 2]);
        let check = |to: Configuration, expected: f64| {
            let found = METRIC.distance(&origin, &to);
            assert!((found - expected).abs() < 1e-9, "{found}");
        };
        check(at([0.3, 0.0, 0.0], [0.0; 3], [0.0; 2]), 3.0);
        check(at([0.0; 3], [0.0, 0.7, 0.0], [0.0; 2]), 1.4);
        check(at([0.0; 3], [0.0; 3], [0.6, -0.8]), 1.0);
        // Four radians one way are 2.283 the other way.
        let turned = at([0.0; 3], [4.0, 0.0, 0.0], [0.0; 2]);
        check(turned, 2.0 * (std::f64::consts::TAU - 4.0));
    }

    #[test]
    fn the_way_between_two_configurations_is_gone_at_constant_speed() {
        let from = at([0.1, 0.2, -0.1], [0.3, -1.0, 2.0], [0.4, -0.2]);
        let to = at([-0.3, 0.1, 0.4], [-0.9, 0.5, 0.2], [1.1, 0.7]);
        let whole = METRIC.distance(&from, &to);
        for share in [0.0, 0.25, 0.5, 0.9, 1.0] {
            let between = from.towards(&to, share);
            let [before, after] = [&from, &to].map(|end| METRIC.distance(end, &between));
            assert!((before - share * whole).abs() < 1e-6);
            assert!((after - (1.0 - share) * whole).abs() < 1e-6);
        }
    }

    #[test]
    fn draws_fill_their_region_and_turn_about_every_axis_alike() {
        let region = Region {
            palm_m: [Vector3::new(-0.1, 0.0, 0.2), Vector3::new(0.1, 0.0, 0.6)],
            joints: vec![[-0.5, 1.5], [0.3, 0.3]],
        };
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let draws: Vec<Configuration> = (0..4000).map(|_| region.draw(&mut rng)).collect();
        let mean = |of: &dyn Fn(&Configuration) -> f64| {
            draws.iter().map(of).sum::<f64>() / draws.len() as f64
        };
        assert!((mean(&|one| one.object_from_palm.translation.z) - 0.4).abs() < 0.01);
        assert!((mean(&|one| one.q[0]) - 0.5).abs() < 0.05);
        assert!(draws.iter().all(|one| one.q[1] == 0.3));
        // The image of an axis is anywhere on the sphere: its mean is 0, and each coordinate's square a third.
        for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
            for k in 0..3 {
                let image = |one: &Configuration| (one.object_from_palm.rotation * axis)[k];
                assert!(mean(&image).abs() < 0.04);
                assert!((mean(&|one| image(one).powi(2)) - 1.0 / 3.0).abs() < 0.03);
            }
        }
    }
}
