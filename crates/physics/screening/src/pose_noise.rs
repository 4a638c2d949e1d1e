//! Noise on the place of an object, for the study of noise.

use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Draws a shift from the normal distribution with these deviations in meters, for one item of a seed.
pub(crate) fn pose_noise_m(deviation_m: &Vector3<f64>, seed: u64, item: usize) -> Vector3<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(item as u64);
    deviation_m.map(|deviation| deviation * rng.sample::<f64, _>(StandardNormal))
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
}
