//! Random palms about an object.

use motion::HandState;
use nalgebra::{Point3, Quaternion, Rotation3, Unit, UnitQuaternion, Vector3};
use posture::Environment;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use spatial::{Object, Pose};

use crate::{ApproachError, HandBody};

/// Distance from an object's center at which an approach begins, in meters: more than the size of any object that
/// a hand holds.
const FAR_M: f64 = 0.35;

/// Draws palms about an object that point at it.
#[derive(Clone, Copy)]
pub struct Palms<'a> {
    /// The hand.
    pub body: &'a HandBody,
    /// The object on its table.
    pub environment: &'a Environment,
    /// Point at which palms point, object frame.
    pub center_in_object: Point3<f64>,
    /// Standard deviation, along each axis, of the point that a palm points at (m).
    pub jitter_m: f64,
}

impl Palms<'_> {
    /// Draws an open hand: its approach in a direction drawn from the sphere, turned about it at random, from afar
    /// until it touches, or until the point where its fingers meet is at the object's center. `None` if the start is in
    /// collision, with the table in most cases.
    ///
    /// # Errors
    ///
    /// Does not fail for a hand that is whole.
    pub fn draw(&self, rng: &mut ChaCha8Rng) -> Result<Option<HandState<Object>>, ApproachError> {
        let rotation = uniform_rotation(rng);
        let jitter = Vector3::from_fn(|_, _| self.jitter_m * near_normal(rng));
        let axes = self.body.axes();
        let at = self.center_in_object + jitter;
        let origin = at.coords - rotation * axes.center_in_palm.coords;
        let goal = HandState {
            frame_from_palm: Pose::from_parts(origin, rotation),
            q_rad: self.body.open(),
        };
        let afar = self.body.backed_off(&goal, FAR_M);
        let clearance = self.body.clearance(self.environment, &afar)?;
        if clearance.least_m() <= 0.0 {
            return Ok(None);
        }
        let arrived = self.body.advanced(self.environment, &afar, FAR_M)?;
        Ok(Some(arrived))
    }
}

/// Returns a number that is nearly normal, the sum of six uniform ones, with mean 0 and deviation 1, at most 4.3.
fn near_normal(rng: &mut ChaCha8Rng) -> f64 {
    (0..6).map(|_| rng.random::<f64>() - 0.5).sum::<f64>() * std::f64::consts::SQRT_2
}

/// Draws a rotation, every one as likely (Shoemake, "Uniform random rotations", 1992).
pub fn uniform_rotation(rng: &mut ChaCha8Rng) -> UnitQuaternion<f64> {
    let [u, v, w]: [f64; 3] = [rng.random(), rng.random(), rng.random()];
    let (sine, cosine) = (std::f64::consts::TAU * v).sin_cos();
    let about_z = Rotation3::from_axis_angle(&Vector3::z_axis(), std::f64::consts::TAU * u);
    // A reflection of the pole to a uniform point of the sphere, after a turn about it.
    let pole = Vector3::new(sine * w.sqrt(), cosine * w.sqrt(), (1.0 - w).sqrt());
    let reflected = (pole * pole.transpose()) * 2.0 - nalgebra::Matrix3::identity();
    let matrix = reflected * about_z.into_inner();
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix));
    Unit::new_normalize(Quaternion::from(rotation.coords))
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;
    use crate::fixture;

    #[test]
    fn rotations_take_an_axis_to_every_side_equally() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let n = 4000;
        for axis in [Vector3::x(), Vector3::z()] {
            let mut sum = Vector3::zeros();
            let mut squares = Vector3::zeros();
            for _ in 0..n {
                let to = uniform_rotation(&mut rng) * axis;
                assert!((to.norm() - 1.0).abs() < 1e-9);
                sum += to;
                squares += to.component_mul(&to);
            }
            assert!((sum / f64::from(n)).norm() < 0.05, "{sum}");
            // The mean square of a coordinate of a point on the sphere is 1/3.
            assert!(
                (squares / f64::from(n) - Vector3::repeat(1.0 / 3.0)).norm() < 0.04,
                "{squares}"
            );
        }
    }

    #[test]
    fn palms_point_at_the_object_and_touch_nothing_deeply() {
        let (body, environment) = (fixture::body(), fixture::environment());
        let palms = Palms {
            body: &body,
            environment: &environment,
            center_in_object: Point3::origin(),
            jitter_m: 0.0,
        };
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let (mut found_n, mut refused_n) = (0, 0);
        for _ in 0..40 {
            let Some(hand) = palms.draw(&mut rng).unwrap() else {
                refused_n += 1;
                continue;
            };
            found_n += 1;
            let least_m = body.clearance(&environment, &hand).unwrap().least_m();
            assert!(least_m > -2e-3, "{least_m}");
            // The approach goes through the object's center.
            let way = hand.frame_from_palm.rotation * *body.axes().approach_in_palm;
            let center = hand.frame_from_palm * body.axes().center_in_palm;
            assert!(way.cross(&center.coords).norm() < 1e-9);
        }
        assert!(found_n > 5 && refused_n > 5, "{found_n} {refused_n}");
    }
}
