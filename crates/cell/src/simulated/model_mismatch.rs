//! Differences of a simulated cell from the screen, besides its scene.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use simulation::{SceneConfig, SceneRandomization};

/// Differences of a simulated cell from the screen, besides its scene; all are drawn from a goal's
/// digest, so that a goal has one outcome.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ModelMismatch {
    /// Errors of the object's estimated pose, of friction, of its mass, and of the fingers' delay.
    pub errors: Option<SceneRandomization>,
    /// Delay until a command takes effect, in seconds.
    pub latency_s: f64,
    /// Standard deviation of the joint encoders' noise, in radians; the drives see it too.
    pub encoder_noise_rad: f64,
}

impl ModelMismatch {
    /// Returns a scene with a goal's errors.
    pub(super) fn drawn(&self, scene: &SceneConfig, digest: &str) -> SceneConfig {
        match &self.errors {
            Some(errors) => errors.sample(
                scene,
                &mut stream(digest, "pipeline 2026 where the object really lies"),
            ),
            None => scene.clone(),
        }
    }

    /// Describes all differences, the scene's included.
    pub(super) fn description(&self, scene: &SceneConfig) -> String {
        let Self {
            errors,
            latency_s,
            encoder_noise_rad,
        } = self;
        let touching = scene.fingers_touch;
        let scene = match errors {
            Some(SceneRandomization {
                position_m,
                yaw_rad,
                friction_scale: friction,
                mass_scale: mass,
                delay_s,
            }) => format!(
                "friction {:.3} to {:.3}, mass times {:.3} to {:.3}, torque limit {} Nm, object misplaced by up \
                 to {position_m} m and {yaw_rad:.3} rad, fingers up to {} s late",
                friction[0] * scene.friction,
                friction[1] * scene.friction,
                mass[0] * scene.mass_scale,
                mass[1] * scene.mass_scale,
                scene.drive.torque_limit,
                scene.drive.delay_s + delay_s
            ),
            None => format!(
                "friction {}, mass times {}, torque limit {} Nm",
                scene.friction, scene.mass_scale, scene.drive.torque_limit
            ),
        };
        let fingers = if touching {
            ""
        } else {
            ", fingers pass through each other"
        };
        format!(
            "{scene}, commands {latency_s} s late, encoder noise {encoder_noise_rad} rad{fingers}"
        )
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
    fn each_goal_has_its_own_errors() {
        let scene = serde_json::json!({"drive": {
            "stiffness": 20.0, "damping": 1.0, "torque_limit": 0.7, "armature": 0.001,
        }});
        let scene: SceneConfig = serde_json::from_value(scene).unwrap();
        let gap = ModelMismatch {
            errors: Some(SceneRandomization::default()),
            ..ModelMismatch::default()
        };
        let drawn = gap.drawn(&scene, "0");
        assert_ne!(drawn, scene);
        assert_eq!(drawn, gap.drawn(&scene, "0"));
        let other = gap.drawn(&scene, "1");
        assert!(drawn.friction != other.friction && drawn.mass_scale != other.mass_scale);
        assert_eq!(ModelMismatch::default().drawn(&scene, "0"), scene);
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
