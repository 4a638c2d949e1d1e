//! The motion of a grasp, from its start to the end of the lift, as functions of time.

use motion::{JointPoint, JointRates, MotionSpline, PalmPoint};
use nalgebra::Vector3;
use simulation::{Approach, Protocol};
use spatial::{Object, Pose, Table, quintic};

use crate::{
    Infeasible,
    arm::{ArmPath, ArmPoint},
    timing::Timing,
};

/// A phase of a motion that can be slowed down by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum MotionPhase {
    /// The palm moves to the grasp.
    Reach,
    /// The fingers close.
    Close,
    /// The fingers press.
    Squeeze,
    /// The palm rises.
    Lift,
}

/// Durations of a motion's phases, in seconds.
#[expect(clippy::struct_field_names, reason = "a unit ends every name")]
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PhaseDurations {
    pub(crate) reach_s: f64,
    pub(crate) close_s: f64,
    pub(crate) squeeze_s: f64,
    /// Between the squeeze and the lift.
    pub(crate) pause_s: f64,
    pub(crate) lift_s: f64,
}

impl PhaseDurations {
    /// Returns the start of the squeeze.
    pub(crate) fn grasp_s(&self) -> f64 {
        self.reach_s + self.close_s
    }

    /// Returns the end of the squeeze.
    pub(crate) fn squeezed_s(&self) -> f64 {
        self.grasp_s() + self.squeeze_s
    }

    /// Returns the start of the lift.
    pub(crate) fn lift_from_s(&self) -> f64 {
        self.squeezed_s() + self.pause_s
    }

    /// Returns the end of the lift.
    pub(crate) fn lifted_s(&self) -> f64 {
        self.lift_from_s() + self.lift_s
    }

    /// Returns the phase at a time.
    pub(crate) fn phase(&self, time_s: f64) -> MotionPhase {
        if time_s <= self.reach_s {
            MotionPhase::Reach
        } else if time_s <= self.grasp_s() {
            MotionPhase::Close
        } else if time_s <= self.lift_from_s() {
            MotionPhase::Squeeze
        } else {
            MotionPhase::Lift
        }
    }

    /// Multiplies the duration of a phase.
    pub(crate) fn stretch(&mut self, phase: MotionPhase, factor: f64) {
        let duration = match phase {
            MotionPhase::Reach => &mut self.reach_s,
            MotionPhase::Close => &mut self.close_s,
            MotionPhase::Squeeze => &mut self.squeeze_s,
            MotionPhase::Lift => &mut self.lift_s,
        };
        *duration *= factor;
    }
}

/// Joint positions of the fingers from the end of the reach on, and in it unless they follow the motion.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Fingers {
    /// In the reach; `None` if they follow the motion.
    pub(crate) opened: Option<Vec<f64>>,
    /// At the grasp.
    pub(crate) grasp: Vec<f64>,
    /// In the squeeze.
    pub(crate) squeezed: Vec<f64>,
}

/// The motion of a grasp: the timed motion; then the fingers close and squeeze, and the palm rises.
pub(crate) struct GraspMotion<'a> {
    pub(crate) spline: &'a MotionSpline<Object>,
    pub(crate) timing: Timing,
    pub(crate) fingers: &'a Fingers,
    pub(crate) table_from_object: Pose<Table, Object>,
    pub(crate) lift_m: f64,
    pub(crate) durations: PhaseDurations,
}

impl GraspMotion<'_> {
    /// Returns how high the palm is above the grasp, in meters, and how that changes.
    pub(crate) fn height(&self, time_s: f64) -> [f64; 3] {
        let from_s = self.durations.lift_from_s();
        ramp(time_s - from_s, self.durations.lift_s).map(|share| share * self.lift_m)
    }

    /// Returns the palm in the table's frame.
    pub(crate) fn palm(&self, time_s: f64) -> PalmPoint {
        let [motion_s, speed, path_acceleration] = self.timing.at(time_s);
        let hand = self.spline.at(motion_s);
        let [height_m, lift_speed, lift_acceleration] = self.height(time_s);
        let up = Vector3::z();
        let rates = &hand.rates;
        let [tangent, curvature] = [&rates.palm_velocity, &rates.palm_acceleration]
            .map(|rate| rate.expressed_in(&self.table_from_object));
        let mut velocity = tangent * speed;
        velocity.linear += up * lift_speed;
        let mut acceleration = curvature * (speed * speed) + tangent * path_acceleration;
        acceleration.linear += up * lift_acceleration;
        let before_lift = self.table_from_object * hand.frame_from_palm;
        PalmPoint {
            time_s,
            table_from_palm: before_lift.translated(&(up * height_m)),
            velocity,
            acceleration,
        }
    }

    /// Returns the arm.
    pub(crate) fn arm(&self, arm: &ArmPath<'_>, time_s: f64) -> Result<JointPoint, Infeasible> {
        let [height_m, lift_speed, lift_acceleration] = self.height(time_s);
        let lifts = time_s > self.durations.lift_from_s();
        let (moving, [speed, acceleration]) = if lifts {
            (arm.lifted(height_m)?, [lift_speed, lift_acceleration])
        } else {
            let [motion_s, speed, acceleration] = self.timing.at(time_s);
            (arm.at(motion_s)?, [speed, acceleration])
        };
        let ArmPoint { q, rates } = moving;
        Ok(JointPoint {
            time_s,
            q_rad: q,
            rates: time_scaled(&rates, speed, acceleration),
        })
    }

    /// Returns the fingers.
    pub(crate) fn hand(&self, time_s: f64) -> JointPoint {
        let PhaseDurations {
            reach_s,
            close_s,
            squeeze_s,
            ..
        } = self.durations;
        let Fingers {
            opened,
            grasp,
            squeezed,
        } = self.fingers;
        let grasp_s = self.durations.grasp_s();
        if time_s > grasp_s {
            return between(grasp, squeezed, time_s, grasp_s, squeeze_s);
        }
        if let Some(opened) = opened {
            return between(opened, grasp, time_s, reach_s, close_s);
        }
        let [motion_s, speed, acceleration] = self.timing.at(time_s);
        let hand = self.spline.at(motion_s);
        JointPoint {
            time_s,
            rates: time_scaled(&hand.rates.joints, speed, acceleration),
            q_rad: hand.q_rad,
        }
    }

    /// Returns the protocol that a motion of these durations follows.
    pub(crate) fn protocol(&self, requested: &Protocol) -> Protocol {
        let PhaseDurations {
            close_s,
            squeeze_s,
            lift_s,
            ..
        } = self.durations;
        let reach_s = self.durations.grasp_s();
        Protocol {
            reach_s,
            close_fraction: match requested.approach {
                Approach::Follow | Approach::AtGrasp => requested.close_fraction,
                Approach::Open => close_s / reach_s,
            },
            squeeze_s,
            lift_s,
            ..requested.clone()
        }
    }
}

/// Returns derivatives by time from those by a path's own time, of which the first and second derivative by
/// time are given.
fn time_scaled(rates: &JointRates, speed: f64, acceleration: f64) -> JointRates {
    let both = rates.velocity.iter().zip(&rates.acceleration);
    JointRates {
        velocity: rates.velocity.iter().map(|v| v * speed).collect(),
        acceleration: both
            .map(|(v, a)| a * speed * speed + v * acceleration)
            .collect(),
    }
}

/// Returns the joints on a [`ramp`] from one position to another.
fn between(from: &[f64], to: &[f64], time_s: f64, start_s: f64, duration_s: f64) -> JointPoint {
    let [share, speed, acceleration] = ramp(time_s - start_s, duration_s);
    let ends = || from.iter().zip(to);
    JointPoint {
        time_s,
        q_rad: ends()
            .map(|(from, to)| from + (to - from) * share)
            .collect(),
        rates: JointRates {
            velocity: ends().map(|(from, to)| (to - from) * speed).collect(),
            acceleration: ends()
                .map(|(from, to)| (to - from) * acceleration)
                .collect(),
        },
    }
}

/// Greatest speed of a [`ramp`], times its duration.
pub(crate) const RAMP_SPEED: f64 = 1.875;

/// Returns the greatest acceleration of a [`ramp`], times the square of its duration: `10/√3`.
pub(crate) fn ramp_acceleration() -> f64 {
    10.0 / 3.0_f64.sqrt()
}

/// Returns `10 s³ − 15 s⁴ + 6 s⁵` of the share s of a duration, from 0 to 1, and its derivatives by time, of
/// which none jumps (Lynch and Park, *Modern Robotics*, 2017, §9.2.2.2).
fn ramp(time_s: f64, duration_s: f64) -> [f64; 3] {
    if time_s <= 0.0 {
        return [0.0; 3];
    }
    if time_s >= duration_s {
        return [1.0, 0.0, 0.0];
    }
    quintic([0.0; 3], [1.0, 0.0, 0.0], duration_s, time_s)
}
