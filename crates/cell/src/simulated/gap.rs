//! Differences of a simulated cell from the screen, besides its scene.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use simulation::Offset;

/// Differences of a simulated cell from the screen, besides its scene; all are drawn from a goal's
/// digest, so that a goal has one outcome.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Gap {
    /// Error of the object's estimated pose.
    pub object: ObjectError,
    /// Delay until a command takes effect, in seconds.
    pub latency_s: f64,
    /// Standard deviation of the joint encoders' noise, in radians; the drives see it too.
    pub encoder_noise_rad: f64,
}

/// Bounds of the error of the object's pose on the table, drawn uniformly for each goal.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ObjectError {
    /// Largest displacement along each of the table's axes, in meters.
    pub position_m: f64,
    /// Largest rotation about the vertical, in radians.
    pub yaw_rad: f64,
}

impl ObjectError {
    /// Adds a goal's pose error to the object's offset.
    pub(super) fn misplaced(&self, offset: Offset, digest: &str) -> Offset {
        let mut rng = stream(digest, "pipeline 2026 where the object really lies");
        let mut next = |bound: f64| bound * (2.0 * rng.random::<f64>() - 1.0);
        Offset {
            x_m: offset.x_m + next(self.position_m),
            y_m: offset.y_m + next(self.position_m),
            yaw_rad: offset.yaw_rad + next(self.yaw_rad),
        }
    }
}

/// Encoder noise, step by step.
pub(super) struct EncoderNoise {
    rng: ChaCha8Rng,
    deviation_rad: f64,
}

impl EncoderNoise {
    pub(super) fn of(digest: &str, deviation_rad: f64) -> Self {
        Self {
            rng: stream(digest, "pipeline 2026 what encoders add"),
            deviation_rad,
        }
    }

    /// Draws the noise of one step of `dof` joints, in radians.
    pub(super) fn step(&mut self, dof: usize) -> Vec<f64> {
        let draw = |_| self.deviation_rad * self.rng.sample::<f64, _>(StandardNormal);
        (0..dof).map(draw).collect()
    }
}

/// Returns the random numbers of one goal for one purpose.
fn stream(digest: &str, purpose: &str) -> ChaCha8Rng {
    ChaCha8Rng::from_seed(blake3::derive_key(purpose, digest.as_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_goal_has_its_own_error_within_the_bounds() {
        let bounds = ObjectError {
            position_m: 0.01,
            yaw_rad: 0.1,
        };
        let errors: Vec<Offset> = (0..1000)
            .map(|goal| bounds.misplaced(Offset::default(), &format!("{goal}")))
            .collect();
        assert!(
            errors
                .iter()
                .all(|e| e.x_m.abs() <= 0.01 && e.yaw_rad.abs() <= 0.1)
        );
        let mean = errors.iter().map(|e| e.y_m).sum::<f64>() / 1000.0;
        assert!(mean.abs() < 1e-3, "{mean}");
        assert_eq!(errors[0], bounds.misplaced(Offset::default(), "0"));
        assert_ne!(errors[0], errors[1]);
        let none = ObjectError::default().misplaced(Offset::default(), "0");
        assert!(none.x_m == 0.0 && none.y_m == 0.0 && none.yaw_rad == 0.0);
    }

    #[test]
    fn encoder_noise_has_the_configured_deviation() {
        let mut noise = EncoderNoise::of("goal", 0.01);
        let drawn: Vec<f64> = (0..2000).flat_map(|_| noise.step(16)).collect();
        let n = drawn.len() as f64;
        let mean = drawn.iter().sum::<f64>() / n;
        let deviation = (drawn.iter().map(|x| x * x).sum::<f64>() / n).sqrt();
        assert!(mean.abs() < 3e-4 && (deviation / 0.01 - 1.0).abs() < 0.02);
        let mut again = EncoderNoise::of("goal", 0.01);
        assert_eq!(again.step(16), drawn[..16]);
        assert!(
            EncoderNoise::of("goal", 0.0)
                .step(4)
                .iter()
                .all(|x| *x == 0.0)
        );
    }
}
