//! Errors of an object's estimated pose: noise, and errors of a given size.

use std::f64::consts::TAU;

use nalgebra::{UnitQuaternion, Vector3};
use options::options;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use spatial::{Object, Pose, RestingPose, Table};

/// Largest error: its square is finite.
const MAX_ERROR: f64 = 1000.0;

/// Error of the object's estimated pose on the table, of this size for every motion and in a direction of its own.
#[options]
#[derive(Copy, PartialEq)]
#[schemars(inline)]
pub struct PoseError {
    /// Distance of the estimated from the true position, in meters, in a direction in the table's plane that is drawn
    /// for each motion (0).
    #[option(default = 0.0, range = 0.0..=MAX_ERROR, why = "an object farther off is out of reach")]
    pub position_m: f64,
    /// Angle of the estimated from the true yaw, in radians, of a sign that is drawn for each motion (0).
    #[option(default = 0.0, range = 0.0..=MAX_ERROR, why = "it is an angle")]
    pub yaw_rad: f64,
}

impl PoseError {
    /// Draws the error of one item of a seed, as a motion in the frame of the object that lies so: the yaw is about
    /// the vertical through the object's origin.
    pub(crate) fn draw(
        &self,
        table_from_object: &Pose<Table, Object>,
        seed: u64,
        item: usize,
    ) -> Pose<Object, Object> {
        if self.position_m == 0.0 && self.yaw_rad == 0.0 {
            return Pose::identity();
        }
        let mut rng = rng(seed, item);
        let direction_rad = TAU * rng.random::<f64>();
        let sign = if rng.random::<bool>() { 1.0 } else { -1.0 };
        let along = Vector3::new(direction_rad.cos(), direction_rad.sin(), 0.0) * self.position_m;
        let up = RestingPose::of(table_from_object).up_in_object;
        Pose::from_parts(
            table_from_object.rotation.inverse() * along,
            UnitQuaternion::from_axis_angle(&up, sign * self.yaw_rad),
        )
    }
}

/// Draws a shift from the normal distribution with these deviations in meters, for one item of a seed.
pub(crate) fn pose_noise_m(deviation_m: &Vector3<f64>, seed: u64, item: usize) -> Vector3<f64> {
    let mut rng = rng(seed, item);
    deviation_m.map(|deviation| deviation * rng.sample::<f64, _>(StandardNormal))
}

fn rng(seed: u64, item: usize) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(item as u64);
    rng
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shifts_have_their_deviation_and_each_item_its_own() {
        let deviation = Vector3::new(0.01, 0.1, 0.0);
        let n = 4000;
        let shifts: Vec<_> = (0..n)
            .map(|item| pose_noise_m(&deviation, 7, item))
            .collect();
        let mean: Vector3<f64> = shifts.iter().sum::<Vector3<f64>>() / n as f64;
        let squares: Vector3<f64> = shifts.iter().map(|shift| shift.component_mul(shift)).sum();
        for axis in 0..3 {
            let found = (squares[axis] / n as f64).sqrt();
            assert!(
                (found - deviation[axis]).abs() <= 0.05 * deviation[axis],
                "{found}"
            );
            assert!(mean[axis].abs() <= 0.06 * deviation[axis]);
        }
        assert_eq!(pose_noise_m(&deviation, 7, 3), shifts[3]);
        assert_ne!(pose_noise_m(&deviation, 8, 3), shifts[3]);
    }

    /// On the table, the object is estimated 5 mm and 5 degrees off, in all directions and both ways alike.
    #[test]
    fn errors_have_their_size_on_the_table_and_directions_of_their_own() {
        let error = PoseError {
            position_m: 0.005,
            yaw_rad: 0.0873,
        };
        let tilt = UnitQuaternion::from_euler_angles(1.2, -0.4, 2.0);
        let lying: Pose<Table, Object> = Pose::from_parts(Vector3::new(0.1, 0.2, 0.05), tilt);
        let n = 2000;
        let drawn = (0..n).map(|item| {
            let off: Pose<Table, Table> = lying * error.draw(&lying, 7, item) * lying.inverse();
            let turn = off.rotation.scaled_axis();
            let origin = lying.translation.vector;
            let shift = off.transform_point(&origin.into()).coords - origin;
            assert!(
                (shift.norm() - 0.005).abs() < 1e-9 && shift.z.abs() < 1e-9,
                "{shift}"
            );
            assert!((turn.norm() - 0.0873).abs() < 1e-9, "{turn}");
            assert!(turn.xy().norm() < 1e-9, "{turn}");
            (shift, turn.z)
        });
        let drawn: Vec<_> = drawn.collect();
        let mean = drawn.iter().map(|(shift, _)| shift).sum::<Vector3<f64>>() / n as f64;
        let clockwise = drawn.iter().filter(|(_, turn)| *turn < 0.0).count();
        assert!(mean.norm() < 5e-4, "{mean}");
        assert!((900..1100).contains(&clockwise), "{clockwise}");
        assert_eq!(PoseError::default().draw(&lying, 7, 0), Pose::identity());
    }
}
