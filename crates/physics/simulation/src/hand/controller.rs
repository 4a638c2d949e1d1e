//! One finger joint's PD drive as a spring and a damper of the engine.

use crate::{config::SceneConfig, units::real};

/// Stiffness of a spring that stands for a constant torque or force, in the engine's units.
const CONSTANT_STIFFNESS: f32 = 1e-3;

/// A PD drive with a torque limit and end stops, in the engine's units of the joint's coordinate.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Controller {
    stiffness: f32,
    damping: f32,
    limit: f32,
    stop_stiffness: f32,
    lower: f32,
    upper: f32,
    time_step_s: f32,
    /// Acceleration per torque or force with all other joints free, at the joints' zero, in the engine's
    /// units: 1/(kg m²) where the joint turns.
    pub(crate) inverse_inertia: f32,
}

/// Torque that the engine integrates implicitly: `stiffness (rest − q) − damping q̇`, in its units, which are Nm
/// and radians where the joint turns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Spring {
    pub(crate) stiffness: f32,
    pub(crate) damping: f32,
    pub(crate) rest: f32,
}

impl Controller {
    /// Returns the drive of a joint with these ends, in either order, whose coordinate has so many of the
    /// engine's `units` in a radian or a meter.
    pub(crate) fn new(scene: &SceneConfig, ends: [f64; 2], units: f64) -> Self {
        let drive = &scene.drive;
        Self {
            stiffness: real(drive.stiffness / units.powi(2)),
            damping: real(drive.damping / units.powi(2)),
            limit: real(drive.torque_limit / units),
            stop_stiffness: real(drive.stop_stiffness / units.powi(2)),
            lower: real(ends[0].min(ends[1]) * units),
            upper: real(ends[0].max(ends[1]) * units),
            time_step_s: real(scene.time_step_s),
            inverse_inertia: 0.0,
        }
    }

    /// Returns the feedforward of a drive beside its spring and damper to continue at a speed: the torque
    /// that this takes, and compensation for the damper.
    pub(crate) fn ahead(&self, torque: f32, speed: f32) -> f32 {
        torque + self.damping * speed
    }

    /// Returns the spring for the next physics step of a joint at `q` that moves at `speed`, with the
    /// feedforward torque `ahead`.
    ///
    /// A drive that saturates, and still will at the end of the step even if nothing is in its way,
    /// gives its limit and neither spring nor damper. Close to the limit,
    /// the spring's rest position is moved so that both together stay within it. An end stop is a
    /// second spring in parallel, without a limit.
    pub(crate) fn spring(&self, command: f32, ahead: f32, q: f32, speed: f32) -> Spring {
        let command = command.max(self.lower).min(self.upper) + ahead / self.stiffness;
        let mut spring = self.constant(command, q, speed).unwrap_or_else(|| {
            let friction = self.damping * speed;
            let torque = (self.stiffness * (command - q))
                .max(friction - self.limit)
                .min(friction + self.limit);
            Spring {
                stiffness: self.stiffness,
                damping: self.damping,
                rest: q + torque / self.stiffness,
            }
        });
        if q < self.lower || q > self.upper {
            let end = q.max(self.lower).min(self.upper);
            let torque = spring.stiffness * (spring.rest - q) + self.stop_stiffness * (end - q);
            spring.stiffness += self.stop_stiffness;
            spring.rest = q + torque / spring.stiffness;
        }
        spring
    }

    /// Returns the limit as a spring, if the drive saturates in the whole step.
    fn constant(&self, command: f32, q: f32, speed: f32) -> Option<Spring> {
        let torque_at = |speed: f32| {
            self.stiffness * (command - q - self.time_step_s * speed) - self.damping * speed
        };
        let gained = self.time_step_s * self.limit * self.inverse_inertia;
        let torque = if torque_at(speed + gained) >= self.limit {
            self.limit
        } else if torque_at(speed - gained) <= -self.limit {
            -self.limit
        } else {
            return None;
        };
        Some(Spring {
            stiffness: CONSTANT_STIFFNESS,
            damping: 0.0,
            rest: q + torque / CONSTANT_STIFFNESS,
        })
    }
}
