//! A course at the controllers' rates within all limits.

use motion::{Carrier, Course, JointPoint, JointTrack};
use robot::Joint;
use simulation::Protocol;
use spatial::{Object, Pose, Table};

use crate::{
    Feasible, Infeasible, Planner,
    arm::ArmPath,
    excess::Excess,
    limits,
    planner::{check_joint, closing, path_s},
    timing::Timing,
    whole::{Fingers, Lengths, Part, RAMP_SPEED, WholeMotion, ramp_acceleration},
};

/// Relative excess of a limit that is rounding.
const ROUNDING: f64 = 1e-9;
/// How often a sampled motion is slowed down until it keeps its limits; each time takes what is missing,
/// and from the second time on a share more than the time before.
const TRIALS: usize = 20;
const MARGIN: f64 = 1e-4;
/// Periods of the slower controller over which a change of the acceleration is spread: over fewer, what a
/// controller makes up between two points is beyond the limit by more than slowing down costs.
const WINDOW_PERIODS: f64 = 4.0;
/// The parts of a motion that limits slow down.
const PARTS: [Part; 4] = [Part::Way, Part::Close, Part::Squeeze, Part::Lift];

impl Planner<'_> {
    /// Returns a course at the controllers' rates within all limits.
    #[expect(
        clippy::too_many_lines,
        reason = "one loop, whose trials share all that was prepared for them"
    )]
    pub(crate) fn timed(
        &self,
        course: &Course<Object>,
        fingers: &Fingers,
        arm: Option<&ArmPath<'_>>,
        lying: &Pose<Table, Object>,
    ) -> Result<Feasible, Infeasible> {
        let table_from_object = arm.map_or(*lying, |arm| arm.table_from_object);
        let asked_s = path_s(self.protocol);
        let most = self.limits.config.max_slowdown;
        let whole_s = whole_s(self.protocol);
        let slow = |slower: f64| Infeasible::Slow { slower, most };
        let endless = || slow(f64::INFINITY);
        let follows = fingers.opened.is_none();
        let parts_at = |course_s: f64| {
            let rates = course.at(course_s).rates;
            let limits = &self.limits;
            let palm = limits.of_palm(&rates.palm_velocity, &rates.palm_acceleration);
            let mut parts = palm.to_vec();
            if follows {
                parts.extend(limits::of_joints(&rates.joints, &limits.joints));
            }
            if let Some(path) = arm {
                parts.extend(limits::of_joints(
                    &path.at(course_s)?.rates,
                    path.arm().limits(),
                ));
            }
            Ok(parts)
        };
        let pace = course.duration_s() / asked_s;
        let timing = Timing::fastest(course.duration_s(), pace, self.window_s(), parts_at)?;
        let lengths = self.lengths(timing.duration_s(), fingers);
        let mut motion = WholeMotion {
            course,
            timing,
            fingers,
            table_from_object,
            lift_m: self.protocol.lift_m,
            lengths,
        };
        for trial in 0..TRIALS {
            // What is no number is not soon enough.
            let is_soon_enough = motion.lengths.way_s <= most * asked_s
                && motion.lengths.lifted_s() <= most * whole_s;
            if !is_soon_enough {
                let times =
                    (motion.lengths.way_s / asked_s).max(motion.lengths.lifted_s() / whole_s);
                return Err(slow(times));
            }
            let palm = sampled(motion.lengths.lifted_s(), self.rates.palm_hz, |time_s| {
                motion.palm(time_s)
            });
            let hand = sampled(motion.lengths.squeezed_s(), self.rates.hand_hz, |time_s| {
                motion.hand(time_s)
            });
            let (palm, hand) = (palm.ok_or_else(endless)?, hand.ok_or_else(endless)?);
            let told = match arm {
                None => None,
                Some(path) => {
                    let points = sampled(motion.lengths.lifted_s(), self.rates.palm_hz, |time_s| {
                        motion.arm(path, time_s)
                    });
                    let points = points.ok_or_else(endless)?.into_iter();
                    Some((path.arm(), points.collect::<Result<Vec<_>, _>>()?))
                }
            };
            let mut excess = Excess::default();
            if let Some((arm, points)) = &told {
                excess.of_joints(points, arm.limits(), &motion.lengths);
            }
            excess.of_palm(&palm, &self.limits, &motion.lengths);
            excess.of_joints(&hand, &self.limits.joints, &motion.lengths);
            let is_kept = PARTS
                .into_iter()
                .all(|part| excess.of(part) <= 1.0 + ROUNDING);
            if is_kept {
                let tolerance = self.protocol.limit_tolerance_rad;
                check_range(&hand, self.hand.joints(), tolerance)?;
                if let Some((arm, points)) = &told {
                    check_range(points, arm.joints(), 0.0)?;
                }
                return Ok(Feasible {
                    table_from_object,
                    grasp: motion.protocol(self.protocol),
                    carrier: match told {
                        Some((arm, points)) => Carrier::Arm(JointTrack {
                            joints: arm.joint_names(),
                            points,
                        }),
                        None => Carrier::Palm(palm),
                    },
                    hand: JointTrack {
                        joints: self.hand.joint_names(),
                        points: hand,
                    },
                });
            }
            for part in PARTS {
                // Points that lie elsewhere may show a little more.
                let margin = 1.0 + MARGIN * trial as f64;
                let times = match excess.of(part) {
                    kept if kept <= 1.0 + ROUNDING => 1.0,
                    excess => excess * margin * (1.0 + ROUNDING),
                };
                motion.lengths.stretch(part, times);
                if part == Part::Way {
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

    /// Returns how long the parts of a motion last at least, of which the palm's way takes `way_s`.
    fn lengths(&self, way_s: f64, fingers: &Fingers) -> Lengths {
        let asked = self.protocol;
        let limits = &self.limits;
        let config = &limits.config;
        let fingers_s = |from: &[f64], to: &[f64]| {
            let joints = from.iter().zip(to).zip(&limits.joints);
            let ramps = joints
                .map(|((from, to), most)| ramp_s(to - from, most.velocity, most.acceleration));
            ramps.fold(0.0, f64::max)
        };
        let close_s = fingers.opened.as_ref().map_or(0.0, |opened| {
            (asked.reach_s * closing(asked)).max(fingers_s(opened, &fingers.grasp))
        });
        Lengths {
            way_s,
            close_s,
            squeeze_s: asked
                .squeeze_s
                .max(fingers_s(&fingers.grasp, &fingers.squeezed)),
            pause_s: asked.pause_s,
            lift_s: asked.lift_s.max(ramp_s(
                asked.lift_m,
                config.palm_speed_m_per_s,
                config.palm_acceleration_m_per_s2,
            )),
        }
    }
}

/// Refuses joints that leave their limits at what they are told or between that.
fn check_range(points: &[JointPoint], joints: &[Joint], tolerance: f64) -> Result<(), Infeasible> {
    for (from, to) in points.iter().zip(points.iter().skip(1)) {
        for (joint, segment) in joints.iter().zip(from.segments(to)) {
            check_joint(joint, segment.range(), tolerance, from.time_s)?;
        }
    }
    Ok(())
}

/// Returns what is told over `duration_s` at no more than a rate, in equal periods; `None` if that is
/// more than memory can hold.
fn sampled<T>(duration_s: f64, rate_hz: f64, at: impl Fn(f64) -> T) -> Option<Vec<T>> {
    // A period that is shorter by rounding is none.
    let ticks = whole((duration_s * rate_hz * (1.0 + ROUNDING)).floor().max(1.0))?;
    let at = |tick| at(duration_s * tick as f64 / ticks as f64);
    Some((0..=ticks).map(at).collect())
}

pub(crate) fn whole(ticks: f64) -> Option<usize> {
    /// An hour at 1 kHz.
    const MOST: f64 = 3.6e6;
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a whole number between 1 and MOST"
    )]
    (1.0..=MOST).contains(&ticks).then_some(ticks as usize)
}

/// Returns how long a [`WholeMotion`]'s ramp takes at least for a way, a speed and an acceleration.
fn ramp_s(way: f64, speed: f64, acceleration: f64) -> f64 {
    let way = way.abs();
    (RAMP_SPEED * way / speed).max((ramp_acceleration() * way / acceleration).sqrt())
}

/// Returns how long a motion takes as asked for, to the end of the lift, in seconds.
fn whole_s(protocol: &Protocol) -> f64 {
    protocol.reach_s + protocol.squeeze_s + protocol.pause_s + protocol.lift_s
}
