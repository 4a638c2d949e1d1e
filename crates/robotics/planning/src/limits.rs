//! Limits on the speeds of palm and joints.

use motion::JointRates;
use nalgebra::Vector3;
use options::{OptionFault, Options, above, options};
use robot::RobotModel;
use spatial::{Peaks, Twist};

/// Largest slowdown factor accepted.
const MAX_SLOWDOWN: f64 = 1000.0;
/// Greatest speed or acceleration accepted.
const MAX_RATE: f64 = 1e12;
/// Angular speed of the palm by default, in rad/s.
#[expect(
    clippy::approx_constant,
    reason = "a joint's published limit, no half turn"
)]
const PALM_TURN_RAD_PER_S: f64 = 3.14;
/// Reason for the ranges of speeds and accelerations.
const TAKES_TIME: &str = "a motion takes time, and no arm or hand is faster";

/// Limits on the speeds of palm and joints; a motion is slowed down until it keeps them.
#[options]
#[derive(PartialEq)]
#[schemars(inline)]
pub struct LimitsConfig {
    /// Largest speed of every joint (rad/s; m/s if prismatic); if absent, each joint's from the
    /// URDF.
    #[option(default, range = above(0.0, MAX_RATE), why = TAKES_TIME)]
    pub joint_velocity_rad_per_s: Option<f64>,
    /// Largest acceleration of every joint (rad/s²; m/s² if prismatic): small drives reach full
    /// speed in a tenth of a second.
    #[option(default = 50.0, range = above(0.0, MAX_RATE), why = TAKES_TIME)]
    pub joint_acceleration_rad_per_s2: f64,
    /// Largest speed of the palm's origin (m/s): that of an industrial arm's end.
    #[option(default = 1.0, range = above(0.0, MAX_RATE), why = TAKES_TIME)]
    pub palm_speed_m_per_s: f64,
    /// Largest acceleration of the palm's origin (m/s²): that of gravity.
    #[option(default = 10.0, range = above(0.0, MAX_RATE), why = TAKES_TIME)]
    pub palm_acceleration_m_per_s2: f64,
    /// Largest angular speed of the palm (rad/s): half a turn in a second, an xArm's joints'.
    #[option(default = PALM_TURN_RAD_PER_S, range = above(0.0, MAX_RATE), why = TAKES_TIME)]
    pub palm_turn_rad_per_s: f64,
    /// Largest angular acceleration of the palm (rad/s²): an xArm's joints'.
    #[option(default = 20.0, range = above(0.0, MAX_RATE), why = TAKES_TIME)]
    pub palm_turn_acceleration_rad_per_s2: f64,
    /// Largest slowdown factor of a motion relative to the requested duration; a slower one is not
    /// sent: it is another motion.
    #[option(
        default = 5.0, range = 1.0..=MAX_SLOWDOWN,
        why = "a goal holds every point of a motion"
    )]
    pub max_slowdown: f64,
}

/// The limits of one hand.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Limits {
    /// The options that they were made from.
    pub(crate) config: LimitsConfig,
    /// Limits of each joint, in the order of the hand's joints.
    pub(crate) joints: Vec<MotionLimits>,
}

/// Limits of a joint's motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct MotionLimits {
    /// Largest speed in rad/s (m/s if prismatic).
    pub(crate) max_velocity: f64,
    /// Largest acceleration in rad/s² (m/s²).
    pub(crate) max_acceleration: f64,
}

/// Velocity and acceleration of the palm's position, of its rotation or of a joint, with their limits.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LimitedRates {
    pub(crate) velocity: Vector3<f64>,
    pub(crate) acceleration: Vector3<f64>,
    pub(crate) max_velocity: f64,
    pub(crate) max_acceleration: f64,
}

impl Limits {
    /// Creates the limits of a hand.
    pub(crate) fn new(config: &LimitsConfig, hand: &RobotModel) -> Result<Self, OptionFault> {
        config.check().map_err(|fault| fault.within("limits"))?;
        let velocity = |joint: &robot::Joint| {
            let max_velocity = config.joint_velocity_rad_per_s.unwrap_or(joint.velocity);
            if max_velocity > 0.0 {
                return Ok(MotionLimits {
                    max_velocity,
                    max_acceleration: config.joint_acceleration_rad_per_s2,
                });
            }
            let problem = format!(
                "the URDF gives joint `{}` no speed, so that this option must",
                joint.name
            );
            Err(OptionFault::new("limits.joint_velocity_rad_per_s", problem))
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

    /// Returns a palm's rates with their limits, linear and angular.
    pub(crate) fn palm_rates<Frame>(
        &self,
        velocity: &Twist<Frame>,
        acceleration: &Twist<Frame>,
    ) -> [LimitedRates; 2] {
        let config = &self.config;
        [
            LimitedRates {
                velocity: velocity.linear,
                acceleration: acceleration.linear,
                max_velocity: config.palm_speed_m_per_s,
                max_acceleration: config.palm_acceleration_m_per_s2,
            },
            LimitedRates {
                velocity: velocity.angular,
                acceleration: acceleration.angular,
                max_velocity: config.palm_turn_rad_per_s,
                max_acceleration: config.palm_turn_acceleration_rad_per_s2,
            },
        ]
    }

    /// Returns the limits of a palm.
    pub(crate) fn palm_peaks(&self) -> Peaks {
        let config = &self.config;
        Peaks {
            speed: config.palm_speed_m_per_s,
            acceleration: config.palm_acceleration_m_per_s2,
            angular_speed: config.palm_turn_rad_per_s,
            angular_acceleration: config.palm_turn_acceleration_rad_per_s2,
        }
    }
}

/// Returns joint rates with their limits.
pub(crate) fn joint_rates(rates: &JointRates, limits: &[MotionLimits]) -> Vec<LimitedRates> {
    let JointRates {
        velocity,
        acceleration,
    } = rates;
    let numbers = [velocity.len(), acceleration.len()];
    assert_eq!(numbers, [limits.len(); 2], "every joint has a limit");
    let rates = velocity.iter().zip(acceleration).zip(limits);
    rates
        .map(|((&velocity, &acceleration), limits)| {
            LimitedRates::of_joint(velocity, acceleration, *limits)
        })
        .collect()
}

impl LimitedRates {
    /// Returns the rates of one joint.
    pub(crate) fn of_joint(velocity: f64, acceleration: f64, limits: MotionLimits) -> Self {
        Self {
            velocity: Vector3::x() * velocity,
            acceleration: Vector3::x() * acceleration,
            max_velocity: limits.max_velocity,
            max_acceleration: limits.max_acceleration,
        }
    }

    /// Returns the slowdown factor that the limits require: velocities scale with the inverse of
    /// the factor, accelerations with the inverse of its square. NaN requires an infinite slowdown.
    pub(crate) fn excess(&self) -> f64 {
        let speed = self.velocity.norm() / self.max_velocity;
        let change = self.acceleration.norm() / self.max_acceleration;
        if speed.is_nan() || change.is_nan() {
            return f64::INFINITY;
        }
        speed.max(change.sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_nan_rate_exceeds_every_limit() {
        let limits = MotionLimits {
            max_velocity: 2.0,
            max_acceleration: 8.0,
        };
        let excess = |velocity, acceleration| {
            LimitedRates::of_joint(velocity, acceleration, limits).excess()
        };
        assert!((excess(1.0, 2.0) - 0.5).abs() < 1e-12);
        for (velocity, acceleration) in [(f64::NAN, 0.0), (0.0, f64::NAN), (f64::NAN, f64::NAN)] {
            assert!(excess(velocity, acceleration).is_infinite());
        }
    }
}
