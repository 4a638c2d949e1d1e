//! Errors between what a motion was made for and what is really there.

use options::{OptionFault, OptionFaults, Options, options};
use rand::Rng;

use crate::{
    config::{Offset, SceneConfig},
    settings::MAX_DELAY_S,
};

/// Greatest error of a position in meters, and of an angle in radians.
const MAX_ERROR: f64 = 1000.0;
/// Greatest factor.
const MAX_SCALE: f64 = 100.0;

/// Bounds of errors between what a motion was made for and what is really there; each error is drawn
/// uniformly within them.
#[options(also = Self::scale_faults)]
#[derive(Copy, PartialEq)]
#[schemars(inline)]
pub struct SceneRandomization {
    /// Largest error of the object's position along each axis of the table, in meters (0.005): that of a
    /// depth camera.
    #[option(
        default = 0.005, range = 0.0..=MAX_ERROR,
        why = "an object farther off is out of reach"
    )]
    pub position_m: f64,
    /// Largest error of the object's yaw on the table, in radians (5 degrees): that of a depth camera.
    #[option(default = 5.0_f64.to_radians(), range = 0.0..=MAX_ERROR, why = "it is an angle")]
    pub yaw_rad: f64,
    /// Least and greatest factor on the scene's friction coefficient (0.6 to 1.2): from dusty to clean rubber.
    #[option(default = [0.6, 1.2])]
    pub friction_scale: [f64; 2],
    /// Least and greatest factor on the scene's mass of the object (0.8 to 1.2): a package is rarely full.
    #[option(default = [0.8, 1.2])]
    pub mass_scale: [f64; 2],
    /// Longest delay of the fingers behind their commands, in seconds, in addition to the drives' own (0.04):
    /// two of 50 commands a second.
    #[option(default = 0.04)]
    pub delay_s: f64,
}

impl SceneRandomization {
    /// No errors.
    pub const NONE: Self = Self {
        position_m: 0.0,
        yaw_rad: 0.0,
        friction_scale: [1.0, 1.0],
        mass_scale: [1.0, 1.0],
        delay_s: 0.0,
    };

    /// Draws errors, and returns the scene that has them.
    pub fn sample(&self, scene: &SceneConfig, rng: &mut impl Rng) -> SceneConfig {
        let mut within =
            |[least, greatest]: [f64; 2]| least + (greatest - least) * rng.random::<f64>();
        let Self {
            position_m,
            yaw_rad,
            friction_scale,
            mass_scale,
            delay_s,
        } = *self;
        let mut sampled = scene.clone();
        sampled.object_offset = Offset {
            x_m: scene.object_offset.x_m + within([-position_m, position_m]),
            y_m: scene.object_offset.y_m + within([-position_m, position_m]),
            yaw_rad: scene.object_offset.yaw_rad + within([-yaw_rad, yaw_rad]),
        };
        let friction_scale = within(friction_scale);
        sampled.friction *= friction_scale;
        sampled.table_friction = scene.table_friction.map(|table| table * friction_scale);
        sampled.mass_scale *= within(mass_scale);
        sampled.drive.delay_s += within([0.0, delay_s]);
        sampled
    }

    /// Returns what is wrong with the bounds of a scene's errors.
    pub fn faults_in(&self, scene: &SceneConfig) -> Vec<OptionFault> {
        let mut faults = OptionFaults::default();
        let most_s = (MAX_DELAY_S - scene.drive.delay_s).max(0.0);
        let why = "added to `drive.delay_s`, a longer delay cannot be controlled";
        faults.within("delay_s", self.delay_s, 0.0..=most_s, why);
        [self.faults(), faults.found()].concat()
    }

    fn scale_faults(&self, faults: &mut OptionFaults) {
        for (key, [least, greatest]) in [
            ("friction_scale", self.friction_scale),
            ("mass_scale", self.mass_scale),
        ] {
            let is_range = least > 0.0 && least <= greatest && greatest <= MAX_SCALE;
            if !is_range {
                let problem = format!(
                    "is [{least:?}, {greatest:?}], and must be two factors above 0, the least first, and at \
                     most {MAX_SCALE}: they scale the scene's own"
                );
                faults.note(key, problem);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;

    fn scene() -> SceneConfig {
        let scene = serde_json::json!({
            "mass_scale": 2.0,
            "object_offset": {"x_m": 1.0, "y_m": 2.0, "yaw_rad": 0.5},
            "drive": {
                "stiffness": 20.0, "damping": 1.0, "torque_limit": 0.7, "armature": 0.001, "delay_s": 0.01,
            },
        });
        serde_json::from_value(scene).unwrap()
    }

    type Number = fn(&SceneConfig) -> f64;

    /// Every error covers its whole range about the scene's own value, and nothing beyond.
    #[test]
    fn errors_are_uniform_within_their_bounds() {
        let (errors, scene) = (SceneRandomization::default(), scene());
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let sampled: Vec<SceneConfig> =
            (0..4000).map(|_| errors.sample(&scene, &mut rng)).collect();
        let numbers: [(&str, Number, [f64; 2]); 6] = [
            ("x", |scene| scene.object_offset.x_m, [0.995, 1.005]),
            ("y", |scene| scene.object_offset.y_m, [1.995, 2.005]),
            (
                "yaw",
                |scene| scene.object_offset.yaw_rad,
                [0.5 - 0.08727, 0.5 + 0.08727],
            ),
            ("mass", |scene| scene.mass_scale, [1.6, 2.4]),
            ("friction", |scene| scene.friction, [0.6, 1.2]),
            ("delay", |scene| scene.drive.delay_s, [0.01, 0.05]),
        ];
        for (name, number, [least, greatest]) in numbers {
            let found: Vec<f64> = sampled.iter().map(number).collect();
            let share = |found: f64| (found - least) / (greatest - least);
            assert!(
                found.iter().all(|&f| (-1e-4..=1.0001).contains(&share(f))),
                "{name}"
            );
            let mean = found.iter().map(|&f| share(f)).sum::<f64>() / 4000.0;
            let spread = found.iter().map(|&f| (share(f) - 0.5).powi(2)).sum::<f64>() / 4000.0;
            // A uniform distribution on 0..1 has the mean 1/2 and the variance 1/12.
            assert!(
                (mean - 0.5).abs() < 0.02 && (spread * 12.0 - 1.0).abs() < 0.05,
                "{name}"
            );
        }
        let rest = SceneConfig {
            object_offset: scene.object_offset,
            mass_scale: scene.mass_scale,
            friction: scene.friction,
            drive: scene.drive,
            ..sampled[0].clone()
        };
        assert_eq!(rest, scene);
    }

    #[test]
    fn without_errors_the_scene_is_as_it_is() {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        assert_eq!(SceneRandomization::NONE.sample(&scene(), &mut rng), scene());
    }

    #[test]
    fn bounds_that_cannot_be_simulated_are_named() {
        let faults = |errors: SceneRandomization| -> Vec<String> {
            let found = errors.faults_in(&scene());
            found.into_iter().map(|fault| fault.key).collect()
        };
        let errors = SceneRandomization::default();
        assert!(faults(errors).is_empty());
        for friction_scale in [[1.2, 0.6], [0.6, f64::NAN], [0.0, 1.0], [1.0, 1e300]] {
            let errors = SceneRandomization {
                friction_scale,
                ..errors
            };
            assert_eq!(faults(errors), ["friction_scale"]);
        }
        let mass_scale = [0.0, 1.0];
        assert_eq!(
            faults(SceneRandomization {
                mass_scale,
                ..errors
            }),
            ["mass_scale"]
        );
        let delay_s = 0.195;
        assert_eq!(
            faults(SceneRandomization { delay_s, ..errors }),
            ["delay_s"]
        );
        let position_m = -0.1;
        let displaced = SceneRandomization {
            position_m,
            ..errors
        };
        assert_eq!(faults(displaced), ["position_m"]);
    }
}
