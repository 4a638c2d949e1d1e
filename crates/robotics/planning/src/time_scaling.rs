//! A motion at the controllers' rates within all limits.

use motion::{JointPoint, JointTrack, MotionSpline, PalmTrajectory};
use robot::Joint;
use simulation::Protocol;
use spatial::{Object, Pose, Table};

use crate::{
    Infeasible, PlannedMotion, Planner,
    arm::ArmPath,
    grasp_motion::{
        Fingers, GraspMotion, MotionPhase, PhaseDurations, RAMP_SPEED, ramp_acceleration,
    },
    limit_excess::LimitExcess,
    limits,
    planner::{check_joint, closing},
    timing::Timing,
};

/// Relative excess of a limit that is rounding.
const ROUNDING: f64 = 1e-9;
/// Maximum number of slowdowns of a sampled motion until it keeps its limits; each one is by the missing
/// factor, and from the second one on by a share more.
const TRIALS: usize = 20;
const MARGIN: f64 = 1e-4;
/// Periods of the slower controller over which a change of the acceleration is spread: over fewer, what a
/// controller makes up between two points is beyond the limit by more than slowing down costs.
const WINDOW_PERIODS: f64 = 4.0;
/// The phases of a motion that limits slow down.
const PHASES: [MotionPhase; 4] = [
    MotionPhase::Reach,
    MotionPhase::Close,
    MotionPhase::Squeeze,
    MotionPhase::Lift,
];

impl Planner<'_> {
    /// Returns a motion at the controllers' rates within all limits.
    #[expect(
        clippy::too_many_lines,
        reason = "one loop, whose trials share all that was prepared for them"
    )]
    pub(crate) fn time_scaled(
        &self,
        spline: &MotionSpline<Object>,
        fingers: &Fingers,
        arm: Option<&ArmPath<'_>>,
        resting: &Pose<Table, Object>,
    ) -> Result<PlannedMotion, Infeasible> {
        let table_from_object = arm.map_or(*resting, |arm| arm.table_from_object);
        let requested_s = self.protocol.path_s();
        let max = self.limits.config.max_slowdown;
        let total_s = requested_total_s(self.protocol);
        let slow = |slower: f64| Infeasible::Slow { slower, max };
        let endless = || slow(f64::INFINITY);
        let follows = fingers.opened.is_none();
        let rates_at = |motion_s: f64| {
            let rates = spline.at(motion_s).rates;
            let limits = &self.limits;
            let palm = limits.palm_rates(&rates.palm_velocity, &rates.palm_acceleration);
            let mut limited = palm.to_vec();
            if follows {
                limited.extend(limits::joint_rates(&rates.joints, &limits.joints));
            }
            if let Some(path) = arm {
                limited.extend(limits::joint_rates(
                    &path.at(motion_s)?.rates,
                    path.arm().limits(),
                ));
            }
            Ok(limited)
        };
        let pace = spline.duration_s() / requested_s;
        let timing = Timing::fastest(spline.duration_s(), pace, self.window_s(), rates_at)?;
        let durations = self.durations(timing.duration_s(), fingers);
        let mut motion = GraspMotion {
            spline,
            timing,
            fingers,
            table_from_object,
            lift_m: self.protocol.lift_m,
            durations,
        };
        for trial in 0..TRIALS {
            // NaN is not soon enough.
            let is_soon_enough = motion.durations.reach_s <= max * requested_s
                && motion.durations.lifted_s() <= max * total_s;
            if !is_soon_enough {
                let times = (motion.durations.reach_s / requested_s)
                    .max(motion.durations.lifted_s() / total_s);
                return Err(slow(times));
            }
            let palm = sampled(motion.durations.lifted_s(), self.rates.palm_hz, |time_s| {
                motion.palm(time_s)
            });
            let hand = sampled(
                motion.durations.squeezed_s(),
                self.rates.hand_hz,
                |time_s| motion.hand(time_s),
            );
            let (palm, hand) = (palm.ok_or_else(endless)?, hand.ok_or_else(endless)?);
            let commanded = match arm {
                None => None,
                Some(path) => {
                    let points =
                        sampled(motion.durations.lifted_s(), self.rates.palm_hz, |time_s| {
                            motion.arm(path, time_s)
                        });
                    let points = points.ok_or_else(endless)?.into_iter();
                    Some((path.arm(), points.collect::<Result<Vec<_>, _>>()?))
                }
            };
            let mut excess = LimitExcess::default();
            if let Some((arm, points)) = &commanded {
                excess.check_joints(points, arm.limits(), &motion.durations);
            }
            excess.check_palm(&palm, &self.limits, &motion.durations);
            excess.check_joints(&hand, &self.limits.joints, &motion.durations);
            let is_kept = PHASES
                .into_iter()
                .all(|phase| excess.phase(phase) <= 1.0 + ROUNDING);
            if is_kept {
                let tolerance = self.protocol.limit_tolerance_rad;
                check_range(&hand, self.hand.joints(), tolerance)?;
                if let Some((arm, points)) = &commanded {
                    check_range(points, arm.joints(), 0.0)?;
                }
                return Ok(PlannedMotion {
                    table_from_object,
                    grasp: motion.protocol(self.protocol),
                    carrier: match commanded {
                        Some((arm, points)) => PalmTrajectory::Arm(JointTrack {
                            joints: arm.joint_names(),
                            points,
                        }),
                        None => PalmTrajectory::Palm(palm),
                    },
                    fingers: JointTrack {
                        joints: self.hand.joint_names(),
                        points: hand,
                    },
                });
            }
            for phase in PHASES {
                // Points that lie elsewhere may show a little more.
                let margin = 1.0 + MARGIN * trial as f64;
                let times = match excess.phase(phase) {
                    kept if kept <= 1.0 + ROUNDING => 1.0,
                    excess => excess * margin * (1.0 + ROUNDING),
                };
                motion.durations.stretch(phase, times);
                if phase == MotionPhase::Reach {
                    motion.timing = motion.timing.slower(times);
                }
            }
        }
        // Sampling never came to an end.
        Err(endless())
    }

    /// Returns over how long a change of the acceleration is spread, in seconds.
    fn window_s(&self) -> f64 {
        WINDOW_PERIODS / self.rates.palm_hz.min(self.rates.hand_hz)
    }

    /// Returns the least durations of a motion's phases, of which the reach takes `reach_s`.
    fn durations(&self, reach_s: f64, fingers: &Fingers) -> PhaseDurations {
        let requested = self.protocol;
        let limits = &self.limits;
        let config = &limits.config;
        let fingers_s = |from: &[f64], to: &[f64]| {
            let joints = from.iter().zip(to).zip(&limits.joints);
            let ramps = joints.map(|((from, to), limits)| {
                ramp_s(to - from, limits.max_velocity, limits.max_acceleration)
            });
            ramps.fold(0.0, f64::max)
        };
        let close_s = fingers.opened.as_ref().map_or(0.0, |opened| {
            (requested.reach_s * closing(requested)).max(fingers_s(opened, &fingers.grasp))
        });
        PhaseDurations {
            reach_s,
            close_s,
            squeeze_s: requested
                .squeeze_s
                .max(fingers_s(&fingers.grasp, &fingers.squeezed)),
            pause_s: requested.pause_s,
            lift_s: requested.lift_s.max(ramp_s(
                requested.lift_m,
                config.palm_speed_m_per_s,
                config.palm_acceleration_m_per_s2,
            )),
        }
    }
}

/// Refuses joints that leave their limits at the commanded points or between them.
fn check_range(points: &[JointPoint], joints: &[Joint], tolerance: f64) -> Result<(), Infeasible> {
    for (from, to) in points.iter().zip(points.iter().skip(1)) {
        for (joint, segment) in joints.iter().zip(from.segments(to)) {
            check_joint(joint, segment.range(), tolerance, from.time_s)?;
        }
    }
    Ok(())
}

/// Returns samples over `duration_s` at no more than a rate, in equal periods; `None` if they are more than
/// memory can hold.
fn sampled<T>(duration_s: f64, rate_hz: f64, at: impl Fn(f64) -> T) -> Option<Vec<T>> {
    // A period that is shorter by rounding is none.
    let ticks = whole_ticks((duration_s * rate_hz * (1.0 + ROUNDING)).floor().max(1.0))?;
    let at = |tick| at(duration_s * tick as f64 / ticks as f64);
    Some((0..=ticks).map(at).collect())
}

pub(crate) fn whole_ticks(ticks: f64) -> Option<usize> {
    /// An hour at 1 kHz.
    const MAX_TICKS: f64 = 3.6e6;
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a whole number between 1 and MAX_TICKS"
    )]
    (1.0..=MAX_TICKS).contains(&ticks).then_some(ticks as usize)
}

/// Returns the least duration of a [`GraspMotion`]'s ramp over a distance within limits of speed and
/// acceleration.
fn ramp_s(distance: f64, max_speed: f64, max_acceleration: f64) -> f64 {
    let distance = distance.abs();
    (RAMP_SPEED * distance / max_speed)
        .max((ramp_acceleration() * distance / max_acceleration).sqrt())
}

/// Returns the requested duration of a motion to the end of the lift, in seconds.
fn requested_total_s(protocol: &Protocol) -> f64 {
    protocol.reach_s + protocol.squeeze_s + protocol.pause_s + protocol.lift_s
}
