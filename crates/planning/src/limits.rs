//! Limits on the speeds of palm and joints.

use motion::JointRates;
use nalgebra::Vector3;
use robot::RobotModel;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use simulation::SettingFault;
use spatial::{Peaks, Twist};

/// Largest slowdown factor accepted.
const MAX_SLOWDOWN: f64 = 1000.0;

/// Limits on the speeds of palm and joints; a motion is slowed down until it keeps them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(inline)]
pub struct LimitsConfig {
    /// Largest speed of every joint (rad/s; m/s if prismatic); if absent, each joint's from the
    /// URDF.
    pub joint_velocity_rad_per_s: Option<f64>,
    /// Largest acceleration of every joint (rad/s²; m/s² if prismatic): small drives reach full
    /// speed in a tenth of a second.
    pub joint_acceleration_rad_per_s2: f64,
    /// Largest speed of the palm's origin (m/s): that of an industrial arm's end.
    pub palm_speed_m_per_s: f64,
    /// Largest acceleration of the palm's origin (m/s²): that of gravity.
    pub palm_acceleration_m_per_s2: f64,
    /// Largest angular speed of the palm (rad/s): half a turn in a second, an xArm's joints'.
    pub palm_turn_rad_per_s: f64,
    /// Largest angular acceleration of the palm (rad/s²): an xArm's joints'.
    pub palm_turn_acceleration_rad_per_s2: f64,
    /// Largest slowdown factor of a motion relative to the requested duration; a slower one is not
    /// sent: it is another motion.
    pub max_slowdown: f64,
}

impl Default for LimitsConfig {
    /// Returns the limits of a small arm and hand; the options' docs give the reasons.
    #[expect(
        clippy::approx_constant,
        reason = "a speed from a data sheet, not the number π"
    )]
    fn default() -> Self {
        Self {
            joint_velocity_rad_per_s: None,
            joint_acceleration_rad_per_s2: 50.0,
            palm_speed_m_per_s: 1.0,
            palm_acceleration_m_per_s2: 10.0,
            palm_turn_rad_per_s: 3.14,
            palm_turn_acceleration_rad_per_s2: 20.0,
            max_slowdown: 5.0,
        }
    }
}

/// The limits of one hand.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Limits {
    /// The options that they were made from.
    pub(crate) config: LimitsConfig,
    /// Limits of each joint, in the order of the hand's joints.
    pub(crate) joints: Vec<Most>,
}

/// Limits of a joint's motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Most {
    /// Largest speed in rad/s (m/s if prismatic).
    pub(crate) velocity: f64,
    /// Largest acceleration in rad/s² (m/s²).
    pub(crate) acceleration: f64,
}

/// A part of a robot with limits of its own: the palm's position, its rotation, or a joint.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Part {
    pub(crate) velocity: Vector3<f64>,
    pub(crate) acceleration: Vector3<f64>,
    pub(crate) most_velocity: f64,
    pub(crate) most_acceleration: f64,
}

impl Limits {
    /// Creates the limits of a hand.
    pub(crate) fn new(config: &LimitsConfig, hand: &RobotModel) -> Result<Self, SettingFault> {
        config.check()?;
        let velocity = |joint: &robot::Joint| {
            let most = config.joint_velocity_rad_per_s.unwrap_or(joint.velocity);
            if most > 0.0 {
                return Ok(Most {
                    velocity: most,
                    acceleration: config.joint_acceleration_rad_per_s2,
                });
            }
            let problem = format!(
                "the URDF gives joint `{}` no speed, so that this option must",
                joint.name
            );
            Err(SettingFault::new(
                "limits.joint_velocity_rad_per_s",
                problem,
            ))
        };
        Ok(Self {
            config: config.clone(),
            joints: hand
                .joints()
                .iter()
                .map(velocity)
                .collect::<Result<_, _>>()?,
        })
    }

    /// Returns the parts of a palm with these rates.
    pub(crate) fn of_palm<Frame>(
        &self,
        velocity: &Twist<Frame>,
        acceleration: &Twist<Frame>,
    ) -> [Part; 2] {
        let config = &self.config;
        [
            Part {
                velocity: velocity.linear,
                acceleration: acceleration.linear,
                most_velocity: config.palm_speed_m_per_s,
                most_acceleration: config.palm_acceleration_m_per_s2,
            },
            Part {
                velocity: velocity.angular,
                acceleration: acceleration.angular,
                most_velocity: config.palm_turn_rad_per_s,
                most_acceleration: config.palm_turn_acceleration_rad_per_s2,
            },
        ]
    }

    /// Returns the limits of a palm.
    pub(crate) fn of_palm_alone(&self) -> Peaks {
        let config = &self.config;
        Peaks {
            speed: config.palm_speed_m_per_s,
            acceleration: config.palm_acceleration_m_per_s2,
            angular_speed: config.palm_turn_rad_per_s,
            angular_acceleration: config.palm_turn_acceleration_rad_per_s2,
        }
    }
}

/// Returns the parts for joints with these rates.
pub(crate) fn of_joints(rates: &JointRates, most: &[Most]) -> Vec<Part> {
    let JointRates {
        velocity,
        acceleration,
    } = rates;
    let numbers = [velocity.len(), acceleration.len()];
    assert_eq!(numbers, [most.len(); 2], "every joint has a limit");
    let rates = velocity.iter().zip(acceleration).zip(most);
    rates
        .map(|((&velocity, &acceleration), most)| Part::of_joint(velocity, acceleration, *most))
        .collect()
}

impl Part {
    /// Creates the part of a single joint.
    pub(crate) fn of_joint(velocity: f64, acceleration: f64, most: Most) -> Self {
        Self {
            velocity: Vector3::x() * velocity,
            acceleration: Vector3::x() * acceleration,
            most_velocity: most.velocity,
            most_acceleration: most.acceleration,
        }
    }

    /// Returns the slowdown factor that its limits require: velocities scale with the inverse of
    /// the factor, accelerations with the inverse of its square. NaN requires an infinite slowdown.
    pub(crate) fn excess(&self) -> f64 {
        let speed = self.velocity.norm() / self.most_velocity;
        let change = self.acceleration.norm() / self.most_acceleration;
        if speed.is_nan() || change.is_nan() {
            return f64::INFINITY;
        }
        speed.max(change.sqrt())
    }
}

impl LimitsConfig {
    /// Checks the limits beyond their types.
    ///
    /// # Errors
    ///
    /// Fails with the first limit that is out of range.
    pub fn check(&self) -> Result<(), SettingFault> {
        let positive = [
            (
                "limits.joint_velocity_rad_per_s",
                self.joint_velocity_rad_per_s.unwrap_or(1.0),
            ),
            (
                "limits.joint_acceleration_rad_per_s2",
                self.joint_acceleration_rad_per_s2,
            ),
            ("limits.palm_speed_m_per_s", self.palm_speed_m_per_s),
            (
                "limits.palm_acceleration_m_per_s2",
                self.palm_acceleration_m_per_s2,
            ),
            ("limits.palm_turn_rad_per_s", self.palm_turn_rad_per_s),
            (
                "limits.palm_turn_acceleration_rad_per_s2",
                self.palm_turn_acceleration_rad_per_s2,
            ),
        ];
        for (key, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                let problem = format!("{value:?} is not more than 0");
                return Err(SettingFault::new(key, problem));
            }
        }
        if (1.0..=MAX_SLOWDOWN).contains(&self.max_slowdown) {
            return Ok(());
        }
        let problem = format!(
            "{:?} is not from 1 to {MAX_SLOWDOWN}: a goal holds every point of a motion",
            self.max_slowdown
        );
        Err(SettingFault::new("limits.max_slowdown", problem))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_that_is_no_number_is_beyond_every_limit() {
        let most = Most {
            velocity: 2.0,
            acceleration: 8.0,
        };
        let excess = |velocity, acceleration| Part::of_joint(velocity, acceleration, most).excess();
        assert!((excess(1.0, 2.0) - 0.5).abs() < 1e-12);
        for (velocity, acceleration) in [(f64::NAN, 0.0), (0.0, f64::NAN), (f64::NAN, f64::NAN)] {
            assert!(excess(velocity, acceleration).is_infinite());
        }
    }
}
