//! From a motion that holds in physics to one that a robot can make: timed within its limits, sampled
//! at its controllers' rate, and refused where that cannot be.

use cell::GoalStep;
use nalgebra::{UnitQuaternion, Vector3};
use robot::{JointKind, RobotModel};
use schemas::candidates::{Candidate, Candidates, Rates, Step};
use simulation::{Approach, Protocol};
use spatial::{Object, Pose, Table};

use crate::{
    DispatchConfig, DispatchError,
    course::{Course, Rate},
    limits::{Joints, Limits},
    refusal::Refusal,
    timing::Timing,
};

/// Relative excess of a limit that is rounding.
const ROUNDING: f64 = 1e-9;
/// How often a sampled motion is slowed down until it keeps its limits; each time takes what is missing,
/// of which sampling brings back next to nothing.
const TRIALS: usize = 10;

/// What makes motions feasible for one hand.
pub(crate) struct Planner<'a> {
    hand: &'a RobotModel,
    protocol: &'a Protocol,
    limits: Limits,
    rate_hz: f64,
    /// Least of the largest speeds of the joints that open and squeeze.
    flexion_speed: f64,
}

/// A motion that the robot can make.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Feasible {
    /// The way of the palm, with the fingers' positions on it, at the controllers' rate; at rest at both
    /// ends.
    pub(crate) steps: Vec<GoalStep>,
    /// How it is carried out, in as much time as it needs.
    pub(crate) grasp: Protocol,
}

impl<'a> Planner<'a> {
    /// Takes the options for a hand.
    pub(crate) fn new(
        config: &'a DispatchConfig,
        hand: &'a RobotModel,
    ) -> Result<Self, DispatchError> {
        let limits = Limits::new(&config.limits, hand)?;
        let wrong = |key: &'static str, problem: String| DispatchError::BadOption { key, problem };
        let flexion = hand
            .require_joints(&config.grasp.flexion_joints)
            .map_err(|err| wrong("grasp.flexion_joints", err.to_string()))?;
        let path_s = path_s(&config.grasp);
        if !(path_s.is_finite() && path_s > 0.0) {
            return Err(wrong(
                "grasp.reach_s",
                format!("it leaves the palm {path_s} s for its way"),
            ));
        }
        let speeds = flexion
            .iter()
            .filter_map(|&joint| limits.q_velocity.get(joint));
        Ok(Self {
            hand,
            protocol: &config.grasp,
            rate_hz: config.rate_hz,
            flexion_speed: speeds.copied().fold(f64::INFINITY, f64::min),
            limits,
        })
    }

    /// Returns the names of the joints, in the order of a feasible motion's.
    pub(crate) fn joints_of_hand(&self) -> Vec<String> {
        self.hand.joint_names()
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
        let (steps, way_s) = self.timed(&course)?;
        self.check_joints(&steps)?;
        self.check_table(&candidate.table_from_object, &steps)?;
        Ok(Feasible {
            steps,
            grasp: self.stretched(way_s),
        })
    }

    /// Returns the candidate with its joints in the order of the hand's.
    fn in_order(
        &self,
        candidates: &Candidates,
        candidate: &Candidate,
    ) -> Result<Candidate, Refusal> {
        let names = self.hand.joint_names();
        let strange = candidates.joints.iter().find(|name| !names.contains(name));
        if let Some(joint) = strange {
            let joint = joint.clone();
            return Err(Refusal::Joints { joint });
        }
        let columns: Vec<usize> = names
            .iter()
            .map(|name| {
                let column = candidates.joints.iter().position(|joint| joint == name);
                let joint = name.clone();
                column.ok_or(Refusal::Joints { joint })
            })
            .collect::<Result<_, _>>()?;
        let pick = |numbers: &[f64]| -> Vec<f64> {
            let numbers = columns.iter().map(|&column| numbers.get(column));
            // What is missing is found when the course is laid.
            numbers.flatten().copied().collect()
        };
        let step = |step: &Step| Step {
            q_rad: pick(&step.q_rad),
            rates: Rates {
                q_velocity_rad_per_s: pick(&step.rates.q_velocity_rad_per_s),
                q_acceleration_rad_per_s2: pick(&step.rates.q_acceleration_rad_per_s2),
                ..step.rates.clone()
            },
            ..step.clone()
        };
        Ok(Candidate {
            steps: candidate.steps.iter().map(step).collect(),
            ..candidate.clone()
        })
    }

    /// Returns the course at the controllers' rate within all limits, and how long it takes in seconds.
    fn timed(&self, course: &Course) -> Result<(Vec<GoalStep>, f64), Refusal> {
        let asked_s = path_s(self.protocol);
        let pace = course.duration_s() / asked_s;
        let most = self.limits.config.most_times_slower;
        let slow = |way_s: f64| Refusal::Slow {
            slower: way_s / asked_s,
            most,
        };
        let endless = || slow(f64::INFINITY);
        let mut timing =
            Timing::fastest(course, &self.limits, self.joints(), pace).ok_or_else(endless)?;
        for _ in 0..TRIALS {
            // What is no number is not soon enough.
            let is_soon_enough = timing.duration_s() <= most * asked_s;
            if !is_soon_enough {
                return Err(slow(timing.duration_s()));
            }
            let ticks = (timing.duration_s() * self.rate_hz).ceil().max(1.0);
            timing = timing.slower(ticks / self.rate_hz / timing.duration_s());
            let steps = self.sampled(course, &timing, ticks).ok_or_else(endless)?;
            let excess = self.excess(&steps);
            if excess <= 1.0 + ROUNDING {
                return Ok((steps, ticks / self.rate_hz));
            }
            timing = timing.slower(excess * (1.0 + ROUNDING));
        }
        Err(slow(timing.duration_s()))
    }

    /// Samples a course at the controllers' rate; `None` if that is more than memory can hold.
    fn sampled(&self, course: &Course, timing: &Timing, ticks: f64) -> Option<Vec<GoalStep>> {
        /// An hour at 1 kHz.
        const MOST: f64 = 3.6e6;
        if ticks > MOST {
            return None;
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a whole number between 1 and MOST"
        )]
        let ticks = ticks as usize;
        (0..=ticks)
            .map(|tick| {
                let time_s = tick as f64 / self.rate_hz;
                let hand = course.at(timing.course_s(time_s))?;
                Some(GoalStep {
                    time_s,
                    object_from_palm: Pose::new(hand.object_from_palm),
                    q_rad: hand.q,
                })
            })
            .collect()
    }

    /// Returns how many times as slow a sampled motion must be for its limits: velocities go with the
    /// inverse of that, accelerations with the inverse of its square.
    ///
    /// Both are those that a controller sees, differences over one period; before and after, the hand
    /// rests.
    fn excess(&self, steps: &[GoalStep]) -> f64 {
        let rest = || Rate {
            linear: Vector3::zeros(),
            angular: Vector3::zeros(),
            q: vec![0.0; self.hand.dof()],
        };
        let moves = steps.windows(2).map(|pair| match pair {
            [from, to] => self.rate(from, to),
            _ => rest(),
        });
        let mut before = rest();
        let mut excess: f64 = 0.0;
        for velocity in moves.chain([rest()]) {
            let acceleration = Rate {
                linear: (velocity.linear - before.linear) * self.rate_hz,
                angular: (velocity.angular - before.angular) * self.rate_hz,
                q: differences(&before.q, &velocity.q, self.rate_hz),
            };
            for part in self
                .limits
                .of_rates(&velocity, &acceleration, self.joints())
            {
                let speed = part.velocity.norm() / part.most_velocity;
                let change = part.acceleration.norm() / part.most_acceleration;
                excess = excess.max(speed).max(change.sqrt());
            }
            before = velocity;
        }
        excess
    }

    /// Returns the mean velocity from one step to the next.
    fn rate(&self, from: &GoalStep, to: &GoalStep) -> Rate {
        let [a, b] = [from, to].map(|step| step.object_from_palm.isometry());
        let turn: UnitQuaternion<f64> = b.rotation * a.rotation.inverse();
        Rate {
            linear: (b.translation.vector - a.translation.vector) * self.rate_hz,
            angular: turn.scaled_axis() * self.rate_hz,
            q: differences(&from.q_rad, &to.q_rad, self.rate_hz),
        }
    }

    /// Whether the fingers follow the motion on the palm's way.
    fn joints(&self) -> Joints {
        match self.protocol.approach {
            Approach::Follow => Joints::Follow,
            Approach::Open => Joints::Still,
        }
    }

    /// Returns the protocol with the time that the palm's way needs, and no ramp faster than the limits.
    ///
    /// Ramps of the fingers have one speed; the lift is `3 s² − 2 s³` of its height, whose greatest
    /// speed is 1.5 and whose greatest acceleration 6, over the time and its square.
    fn stretched(&self, way_s: f64) -> Protocol {
        let asked = self.protocol;
        let ramp_s = |angle: f64| angle.abs() / self.flexion_speed;
        let (reach_s, close_fraction) = match asked.approach {
            Approach::Follow => (way_s, asked.close_fraction),
            Approach::Open => {
                let closing_s = (asked.reach_s * closing(asked)).max(ramp_s(asked.open_rad));
                (way_s + closing_s, closing_s / (way_s + closing_s))
            }
        };
        let config = &self.limits.config;
        let height_m = asked.lift_m.abs();
        let lift_s = (1.5 * height_m / config.palm_speed_m_per_s)
            .max((6.0 * height_m / config.palm_acceleration_m_per_s2).sqrt());
        Protocol {
            reach_s,
            close_fraction,
            squeeze_s: asked.squeeze_s.max(ramp_s(asked.squeeze_rad)),
            lift_s: asked.lift_s.max(lift_s),
            ..asked.clone()
        }
    }

    fn check_joints(&self, steps: &[GoalStep]) -> Result<(), Refusal> {
        let tolerance = self.protocol.limit_tolerance_rad;
        for step in steps {
            for (joint, &q) in self.hand.joints().iter().zip(&step.q_rad) {
                let inside = q >= joint.lower - tolerance && q <= joint.upper + tolerance;
                if joint.kind != JointKind::Continuous && !inside {
                    return Err(Refusal::Limit {
                        joint: joint.name.clone(),
                        q,
                        time_s: step.time_s,
                        lower: joint.lower,
                        upper: joint.upper,
                    });
                }
            }
        }
        Ok(())
    }

    /// Refuses a hand that reaches deeper below the table than the protocol has it.
    fn check_table(
        &self,
        table_from_object: &Pose<Table, Object>,
        steps: &[GoalStep],
    ) -> Result<(), Refusal> {
        for step in steps {
            let table_from_palm = table_from_object * &step.object_from_palm;
            // The positions are those of the hand's joints.
            let palm_from_links = self
                .hand
                .forward_kinematics(&step.q_rad)
                .unwrap_or_default();
            for (link, palm_from_link) in self.hand.links().iter().zip(&palm_from_links) {
                for collision in &link.collisions {
                    let table_from_shape =
                        table_from_palm.isometry() * palm_from_link * collision.link_from_shape;
                    let up = table_from_shape
                        .rotation
                        .inverse_transform_vector(&Vector3::z());
                    let depth_m =
                        collision.shape.extent_m(&up) - table_from_shape.translation.vector.z;
                    if depth_m > self.protocol.table_tolerance_m {
                        return Err(Refusal::Table {
                            link: link.name.clone(),
                            depth_m,
                            time_s: step.time_s,
                        });
                    }
                }
            }
        }
        Ok(())
    }
}

/// Returns how long the palm is on its way as asked for, in seconds.
fn path_s(protocol: &Protocol) -> f64 {
    match protocol.approach {
        Approach::Follow => protocol.reach_s,
        Approach::Open => protocol.reach_s * (1.0 - closing(protocol)),
    }
}

/// Returns the share of the reach in which the fingers close.
fn closing(protocol: &Protocol) -> f64 {
    protocol.close_fraction.clamp(0.0, 1.0)
}

fn differences(from: &[f64], to: &[f64], rate_hz: f64) -> Vec<f64> {
    from.iter()
        .zip(to)
        .map(|(from, to)| (to - from) * rate_hz)
        .collect()
}

#[cfg(test)]
pub(crate) mod testing;
#[cfg(test)]
mod tests;
