//! From a motion that holds in physics to one that a robot can make: timed within its limits, sampled
//! at its controllers' rate, and refused where that cannot be.

use cell::{Carrier, JointPoint, Track};
use nalgebra::{Isometry3, Vector3};
use robot::{Joint, JointKind, JointOrder, RobotModel};
use schemas::candidates::{Candidate, Candidates, Rates, Step};
use simulation::{Approach, Flexion, Protocol, Trial};
use spatial::{Object, Pose, Table};

use crate::{
    DispatchConfig, DispatchError,
    arm::{Arm, ArmPath},
    config::RatesConfig,
    course::Course,
    excess::Excess,
    limits::{self, Limits},
    motion::{Fingers, Lengths, Part, RAMP_SPEED, WholeMotion, ramp_acceleration},
    refusal::Refusal,
    robots::Robots,
    timing::Timing,
};

/// Relative excess of a limit that is rounding.
const ROUNDING: f64 = 1e-9;
/// What of a position beyond a limit is rounding, in radians (meters if prismatic).
const ROUNDING_RAD: f64 = 1e-6;
/// How often a sampled motion is slowed down until it keeps its limits; each time takes what is missing,
/// and from the second time on a share more than the time before.
const TRIALS: usize = 20;
const MARGIN: f64 = 1e-4;
/// Periods of the slower controller over which a change of the acceleration is spread: over fewer, what a
/// controller makes up between two points is beyond the limit by more than slowing down costs.
const WINDOW_PERIODS: f64 = 4.0;
/// The parts of a motion that limits slow down.
const PARTS: [Part; 4] = [Part::Way, Part::Close, Part::Squeeze, Part::Lift];

/// What makes motions feasible for one hand.
pub(crate) struct Planner<'a> {
    hand: &'a RobotModel,
    protocol: &'a Protocol,
    limits: Limits,
    rates: RatesConfig,
    flexion: Flexion,
    arm: Option<Arm>,
}

/// A motion that the robot can make.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Feasible {
    /// How the object lies, and where: an arm has it at its place.
    pub(crate) table_from_object: Pose<Table, Object>,
    /// What moves the palm, from rest to rest, to the end of the lift.
    pub(crate) carrier: Carrier,
    /// What the fingers are told, to the end of the squeeze.
    pub(crate) hand: Track,
    /// How it is carried out, in as much time as it needs.
    pub(crate) grasp: Protocol,
}

impl<'a> Planner<'a> {
    /// Takes the options for a robot.
    pub(crate) fn new(
        config: &'a DispatchConfig,
        robots: &'a Robots,
    ) -> Result<Self, DispatchError> {
        let hand = &robots.hand;
        let arm = match (&config.arm, &robots.arm) {
            (Some(options), Some(arm)) => Some(Arm::new(options, &arm.urdf, hand)?),
            _ => None,
        };
        let limits = Limits::new(&config.limits, hand)?;
        let wrong = |key: &'static str, problem: String| DispatchError::BadOption { key, problem };
        let flexion = Flexion::new(&config.grasp, hand)
            .map_err(|err| wrong("grasp.flexion_joints", err.to_string()))?;
        let path_s = path_s(&config.grasp);
        if !(path_s.is_finite() && path_s > 0.0) {
            return Err(wrong(
                "grasp.reach_s",
                format!("it leaves the palm {path_s} s for its way"),
            ));
        }
        if config.grasp.trial != Trial::Lift {
            let problem = "a cell lifts what it grasps, and pulls at nothing".to_owned();
            return Err(wrong("grasp.trial", problem));
        }
        Ok(Self {
            hand,
            protocol: &config.grasp,
            rates: config.rates,
            flexion,
            limits,
            arm,
        })
    }

    /// Makes a motion feasible; its joints come in the order of the hand's.
    ///
    /// It goes where the candidate goes, nowhere faster than it was screened, from rest to rest, and
    /// slower where a limit asks for it.
    pub(crate) fn plan(
        &self,
        candidates: &Candidates,
        candidate: &Candidate,
    ) -> Result<Feasible, Refusal> {
        let ordered = self.in_order(candidates, candidate)?;
        let course = Course::through(&ordered, self.hand.dof())?;
        self.check_course(&course, candidate.table_from_object.isometry())?;
        let grasp = course.grasp().q;
        let fingers = Fingers {
            opened: match self.protocol.approach {
                Approach::Follow => None,
                Approach::Open => Some(self.flexion.flexed(&grasp, -self.protocol.open_rad)),
            },
            squeezed: self.flexion.flexed(&grasp, self.protocol.squeeze_rad),
            grasp,
        };
        let stands = |course_s: f64| {
            let opened = fingers.opened.clone();
            opened.unwrap_or_else(|| course.at(course_s).q)
        };
        let lying = &candidate.table_from_object;
        let arm = self.arm.as_ref();
        let arm = arm
            .map(|arm| arm.follow(&course, lying, stands, self.protocol.lift_m))
            .transpose()?;
        self.timed(&course, &fingers, arm.as_ref(), lying)
    }

    /// Returns the candidate with its joints in the order of the hand's.
    fn in_order(
        &self,
        candidates: &Candidates,
        candidate: &Candidate,
    ) -> Result<Candidate, Refusal> {
        let order = JointOrder::new(&candidates.joints, &self.hand.joint_names());
        let order = order.map_err(|err| Refusal::Joints {
            joint: err.joint().to_owned(),
        })?;
        let step = |(idx, step): (usize, &Step)| {
            // What is missing is missing of this step.
            let pick = |numbers: &[f64]| {
                let found = order.apply(numbers);
                found.map_err(|_short| Refusal::Number { step: idx })
            };
            Ok(Step {
                q_rad: pick(&step.q_rad)?,
                rates: Rates {
                    q_velocity_rad_per_s: pick(&step.rates.q_velocity_rad_per_s)?,
                    q_acceleration_rad_per_s2: pick(&step.rates.q_acceleration_rad_per_s2)?,
                    ..step.rates.clone()
                },
                ..step.clone()
            })
        };
        let steps = candidate.steps.iter().enumerate().map(step);
        Ok(Candidate {
            steps: steps.collect::<Result<_, Refusal>>()?,
            ..candidate.clone()
        })
    }

    /// Returns a course at the controllers' rates within all limits.
    #[expect(
        clippy::too_many_lines,
        reason = "one loop, whose trials share all that was prepared for them"
    )]
    fn timed(
        &self,
        course: &Course,
        fingers: &Fingers,
        arm: Option<&ArmPath<'_>>,
        lying: &Pose<Table, Object>,
    ) -> Result<Feasible, Refusal> {
        let table_from_object = arm.map_or(*lying, |arm| arm.table_from_object);
        let asked_s = path_s(self.protocol);
        let most = self.limits.config.most_times_slower;
        let whole_s = whole_s(self.protocol);
        let slow = |slower: f64| Refusal::Slow { slower, most };
        let endless = || slow(f64::INFINITY);
        let follows = fingers.opened.is_none();
        let parts_at = |course_s: f64| {
            let hand = course.at(course_s);
            let (velocity, acceleration) = (&hand.velocity, &hand.acceleration);
            let palm = self
                .limits
                .of_palm(&velocity.twist(), &acceleration.twist());
            let mut parts = palm.to_vec();
            if follows {
                parts.extend(limits::of_joints(
                    &velocity.q,
                    &acceleration.q,
                    &self.limits.joints,
                ));
            }
            if let Some(path) = arm {
                let moving = path.at(course_s)?;
                parts.extend(limits::of_joints(
                    &moving.velocity,
                    &moving.acceleration,
                    path.arm().limits(),
                ));
            }
            Some(parts)
        };
        let pace = course.duration_s() / asked_s;
        let timing = Timing::fastest(course.duration_s(), pace, self.window_s(), parts_at);
        let timing = timing.ok_or_else(endless)?;
        let lengths = self.lengths(timing.duration_s(), fingers);
        let mut motion = WholeMotion {
            course,
            timing,
            fingers,
            arm,
            table_from_object: *table_from_object.isometry(),
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
                Some(motion.palm(time_s))
            });
            let hand = sampled(motion.lengths.squeezed_s(), self.rates.hand_hz, |time_s| {
                Some(motion.hand(time_s))
            });
            let (palm, hand) = (palm.ok_or_else(endless)?, hand.ok_or_else(endless)?);
            let told = match arm {
                None => None,
                Some(path) => {
                    let points = sampled(motion.lengths.lifted_s(), self.rates.palm_hz, |time_s| {
                        motion.arm(time_s)
                    });
                    Some((path.arm(), points.ok_or_else(endless)?))
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
                        Some((arm, points)) => Carrier::Arm(Track {
                            joints: arm.joint_names(),
                            points,
                        }),
                        None => Carrier::Palm(palm),
                    },
                    hand: Track {
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

    /// Refuses a course on which a joint is outside its limits or the hand deeper below the table than
    /// the protocol has it.
    fn check_course(
        &self,
        course: &Course,
        table_from_object: &Isometry3<f64>,
    ) -> Result<(), Refusal> {
        let places = (course.duration_s() * self.rates.palm_hz).ceil().max(1.0);
        let places = whole(places).ok_or(Refusal::Slow {
            slower: f64::INFINITY,
            most: self.limits.config.most_times_slower,
        })?;
        for place in 0..=places {
            let time_s = course.duration_s() * place as f64 / places as f64;
            let hand = course.at(time_s);
            self.check_joints(&hand.q, time_s)?;
            self.check_table(
                &(table_from_object * hand.object_from_palm),
                &hand.q,
                time_s,
            )?;
        }
        Ok(())
    }

    fn check_joints(&self, q: &[f64], time_s: f64) -> Result<(), Refusal> {
        let tolerance = self.protocol.limit_tolerance_rad;
        for (joint, &q) in self.hand.joints().iter().zip(q) {
            check_joint(joint, [q, q], tolerance, time_s)?;
        }
        Ok(())
    }

    fn check_table(
        &self,
        table_from_palm: &Isometry3<f64>,
        q: &[f64],
        time_s: f64,
    ) -> Result<(), Refusal> {
        let palm_from_links = self.hand.forward_kinematics(q)?;
        for (link, palm_from_link) in self.hand.links().iter().zip(&palm_from_links) {
            for collision in &link.collisions {
                let table_from_shape = table_from_palm * palm_from_link * collision.link_from_shape;
                let up = table_from_shape
                    .rotation
                    .inverse_transform_vector(&Vector3::z());
                let depth_m = collision.shape.extent_m(&up) - table_from_shape.translation.vector.z;
                // NaN is not above.
                let is_above = depth_m <= self.protocol.table_tolerance_m;
                if !is_above {
                    return Err(Refusal::Table {
                        link: link.name.clone(),
                        depth_m,
                        time_s,
                    });
                }
            }
        }
        Ok(())
    }
}

/// Refuses joints that leave their limits at what they are told or between that.
fn check_range(points: &[JointPoint], joints: &[Joint], tolerance: f64) -> Result<(), Refusal> {
    for (from, to) in points.iter().zip(points.iter().skip(1)) {
        for (joint, segment) in joints.iter().zip(from.segments(to)) {
            check_joint(joint, segment.range(), tolerance, from.time_s)?;
        }
    }
    Ok(())
}

/// Refuses a joint that is outside its limits by more than a tolerance.
fn check_joint(
    joint: &Joint,
    [low, high]: [f64; 2],
    tolerance: f64,
    time_s: f64,
) -> Result<(), Refusal> {
    let tolerance = tolerance + ROUNDING_RAD;
    let inside = low >= joint.lower - tolerance && high <= joint.upper + tolerance;
    if joint.kind == JointKind::Continuous || inside {
        return Ok(());
    }
    Err(Refusal::Limit {
        joint: joint.name.clone(),
        q: if low < joint.lower - tolerance {
            low
        } else {
            high
        },
        time_s,
        lower: joint.lower,
        upper: joint.upper,
    })
}

/// Returns what is told over `duration_s` at no more than a rate, in equal periods; `None` if that is
/// more than memory can hold.
fn sampled<T>(duration_s: f64, rate_hz: f64, at: impl Fn(f64) -> Option<T>) -> Option<Vec<T>> {
    // A period that is shorter by rounding is none.
    let ticks = whole((duration_s * rate_hz * (1.0 + ROUNDING)).floor().max(1.0))?;
    (0..=ticks)
        .map(|tick| at(duration_s * tick as f64 / ticks as f64))
        .collect()
}

fn whole(ticks: f64) -> Option<usize> {
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

/// Returns how long the palm is on its way as asked for, in seconds.
fn path_s(protocol: &Protocol) -> f64 {
    match protocol.approach {
        Approach::Follow => protocol.reach_s,
        Approach::Open => protocol.reach_s * (1.0 - closing(protocol)),
    }
}

/// Returns how long a motion takes as asked for, to the end of the lift, in seconds.
fn whole_s(protocol: &Protocol) -> f64 {
    protocol.reach_s + protocol.squeeze_s + protocol.pause_s + protocol.lift_s
}

/// Returns the share of the reach in which the fingers close.
fn closing(protocol: &Protocol) -> f64 {
    protocol.close_fraction.clamp(0.0, 1.0)
}

#[cfg(test)]
pub(crate) mod testing;
#[cfg(test)]
mod tests;
