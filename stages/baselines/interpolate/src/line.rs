//! The straight line between the ends of one motion.

use std::sync::Arc;

use motion::{HandRates, JointRates, Motion, MotionError, Step};
use nalgebra::{UnitQuaternion, Vector3};
use schemas::candidates::{Candidate, Origin};
use spatial::{Object, Pose, Twist};

/// Generator name of the candidates.
const GENERATOR: &str = "interpolate";

/// Returns the motion that goes from the first step of another straight to its last one, at its times:
/// the linear baseline (Ye et al., *Learning Continuous Grasping Function with a Dexterous Hand from
/// Human Demonstrations*, 2023, section IV). A motion of one step stays there, at rest.
///
/// # Errors
///
/// Fails if the motion is so fast that its rates are not finite.
pub(crate) fn line(given: &Candidate) -> Result<Candidate, MotionError> {
    let motion = &given.motion;
    let steps = match motion.steps() {
        [first, .., last] => {
            let line = Line::between(first, last);
            let times = motion.steps().iter().map(|step| step.time_s);
            times.map(|time_s| line.at(time_s)).collect()
        }
        only => {
            let at_rest = |step: &Step<Object>| Step {
                rates: HandRates::zero(step.q_rad.len()),
                ..step.clone()
            };
            only.iter().map(at_rest).collect()
        }
    };
    let motion = Motion::of_joints(Arc::clone(motion.joints()), steps)?;
    // Both ends are within the limits, and so is what lies between them.
    Ok(remade(given, motion))
}

/// Returns the candidate of this motion to the grasp of another one.
pub(crate) fn remade(given: &Candidate, motion: Motion<Object>) -> Candidate {
    given.remade("line", GENERATOR, Origin::Line, motion)
}

/// A hand that moves at constant rates.
struct Line<'a> {
    first: &'a Step<Object>,
    last: &'a Step<Object>,
    duration_s: f64,
    /// From the first orientation to the last: an axis, object frame, times an angle of at most π.
    turn: Vector3<f64>,
    rates: HandRates<Object>,
}

impl<'a> Line<'a> {
    /// The last step is after the first.
    fn between(first: &'a Step<Object>, last: &'a Step<Object>) -> Self {
        let duration_s = last.time_s - first.time_s;
        let [from, to] = [first, last].map(|step| &step.frame_from_palm);
        let way = to.translation.vector - from.translation.vector;
        // Of the two quaternions of a rotation, `scaled_axis` takes the one with the smaller angle.
        let turn = (to.rotation * from.rotation.inverse()).scaled_axis();
        let joints = first.q_rad.iter().zip(&last.q_rad);
        let q_velocity = joints.map(|(from, to)| (to - from) / duration_s);
        let dof = first.q_rad.len();
        let rates = HandRates {
            // A turn leaves its own axis where it is: the angular velocity is the same all along.
            palm_velocity: Twist::new(way / duration_s, turn / duration_s),
            joints: JointRates {
                velocity: q_velocity.collect(),
                ..JointRates::zero(dof)
            },
            ..HandRates::zero(dof)
        };
        Self {
            first,
            last,
            duration_s,
            turn,
            rates,
        }
    }

    /// Returns the hand at a time, in seconds on the motion's clock.
    fn at(&self, time_s: f64) -> Step<Object> {
        let share = (time_s - self.first.time_s) / self.duration_s;
        let [from, to] = [self.first, self.last].map(|step| &step.frame_from_palm);
        let position = from.translation.vector.lerp(&to.translation.vector, share);
        let rotation = UnitQuaternion::from_scaled_axis(self.turn * share) * from.rotation;
        let joints = self.first.q_rad.iter().zip(&self.last.q_rad);
        Step {
            time_s,
            frame_from_palm: Pose::from_parts(position, rotation),
            q_rad: joints
                .map(|(from, to)| from * (1.0 - share) + to * share)
                .collect(),
            rates: self.rates.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;
    use schemas::candidates::{DrawSource, ObjectSplit};

    use super::*;

    fn step(
        time_s: f64,
        place: [f64; 3],
        rotation: UnitQuaternion<f64>,
        q_rad: [f64; 2],
    ) -> Step<Object> {
        Step {
            time_s,
            frame_from_palm: Pose::from_parts(place, rotation),
            q_rad: q_rad.to_vec(),
            rates: HandRates {
                palm_velocity: Twist::from_array([9.0; 6]),
                palm_acceleration: Twist::from_array([9.0; 6]),
                joints: JointRates {
                    velocity: vec![9.0; 2],
                    acceleration: vec![9.0; 2],
                },
            },
        }
    }

    fn turned(axis_angle: [f64; 3]) -> UnitQuaternion<f64> {
        UnitQuaternion::from_scaled_axis(Vector3::from(axis_angle))
    }

    /// A motion at unequal times, with a detour in the middle.
    fn motion() -> Candidate {
        Candidate {
            candidate_id: "can-00007".to_owned(),
            generator: "cgf".to_owned(),
            source: DrawSource {
                draw_n: 3,
                origin: Origin::Posterior,
                demonstration: "a".to_owned(),
                object_split: Some(ObjectSplit::Seen),
            },
            latent: vec![0.5],
            table_from_object: Pose::new(Isometry3::translation(0.0, 0.0, 0.05)),
            limit_excess_rad: 0.3,
            depth_m: Some(0.002),
            residual_m2: None,
            motion: of_steps(vec![
                step(0.5, [0.3, -0.1, 0.2], turned([0.4, -1.0, 0.2]), [0.1, 1.2]),
                step(0.7, [9.0, 9.0, 9.0], turned([0.0, 0.0, 3.0]), [5.0, -5.0]),
                step(1.1, [8.0, 8.0, 8.0], turned([3.0, 0.0, 0.0]), [5.0, -5.0]),
                step(2.0, [0.0, 0.05, 0.1], turned([-0.8, 0.6, 1.1]), [0.7, 0.3]),
            ]),
        }
    }

    fn of_steps(steps: Vec<Step<Object>>) -> Motion<Object> {
        Motion::new(&["j", "k"], steps).unwrap()
    }

    fn assert_near(found: &Step<Object>, expected: &Step<Object>) {
        let [a, b] = [found, expected].map(|step| step.frame_from_palm);
        let way = (a.translation.vector - b.translation.vector).norm();
        assert!(way < 1e-12 && a.rotation.angle_to(&b.rotation) < 1e-7);
        for (a, b) in found.q_rad.iter().zip(&expected.q_rad) {
            assert!((a - b).abs() < 1e-12, "{a} {b}");
        }
    }

    #[test]
    fn a_line_keeps_the_ends_the_times_and_the_source_of_its_motion() {
        let motion = motion();
        let line = line(&motion).unwrap();
        assert_eq!(line.candidate_id, "can-00007-line");
        assert_eq!(line.generator, "interpolate");
        let expected = DrawSource {
            draw_n: 1,
            origin: Origin::Line,
            ..motion.source.clone()
        };
        assert_eq!(line.source, expected);
        assert_eq!(line.table_from_object, motion.table_from_object);
        assert_eq!(line.limit_excess_rad, 0.0);
        let times = |motion: &Candidate| -> Vec<f64> {
            let steps = motion.motion.steps().iter();
            steps.map(|step| step.time_s).collect()
        };
        assert_eq!(times(&line), times(&motion));
        let (steps, given) = (line.motion.steps(), motion.motion.steps());
        assert_near(&steps[0], &given[0]);
        assert_near(&steps[3], &given[3]);
        // 0.2 s of 1.5 s later, not a third of the steps.
        let share = 0.2 / 1.5;
        let place = steps[1].frame_from_palm.translation;
        assert!((place.x - 0.3 * (1.0 - share)).abs() < 1e-12, "{place}");
        assert!((steps[1].q_rad[0] - (0.1 + 0.6 * share)).abs() < 1e-12);
    }

    #[test]
    fn rates_are_those_of_central_differences() {
        const H_S: f64 = 1e-4;
        let motion = motion().motion;
        let line = Line::between(motion.first(), motion.grasp());
        for time_s in [0.6, 1.0, 1.9] {
            let [before, now, after] = [-H_S, 0.0, H_S].map(|by_s| line.at(time_s + by_s));
            let [a, b, c] = [&before, &now, &after].map(|step| *step.frame_from_palm);
            let near = |found: f64, expected: f64, tolerance: f64| {
                assert!((found - expected).abs() < tolerance, "{found} {expected}");
            };
            let velocity = (c.translation.vector - a.translation.vector) / (2.0 * H_S);
            let spin = (c.rotation * a.rotation.inverse()).scaled_axis() / (2.0 * H_S);
            // How the spin changes, and the velocity: not at all.
            let spins = [(&b, &a), (&c, &b)]
                .map(|(to, from)| (to.rotation * from.rotation.inverse()).scaled_axis() / H_S);
            let changes = [
                c.translation.vector + a.translation.vector - 2.0 * b.translation.vector,
                (spins[1] - spins[0]) * H_S,
            ]
            .map(|change| change / H_S.powi(2));
            for k in 0..3 {
                near(now.rates.palm_velocity.linear[k], velocity[k], 1e-9);
                near(now.rates.palm_velocity.angular[k], spin[k], 1e-9);
                near(now.rates.palm_acceleration.linear[k], changes[0][k], 1e-6);
                near(now.rates.palm_acceleration.angular[k], changes[1][k], 1e-6);
            }
            for joint in 0..2 {
                let [a, b, c] = [&before, &now, &after].map(|step| step.q_rad[joint]);
                let velocity = (c - a) / (2.0 * H_S);
                near(now.rates.joints.velocity[joint], velocity, 1e-9);
                let change = (c + a - 2.0 * b) / H_S.powi(2);
                near(now.rates.joints.acceleration[joint], change, 1e-6);
            }
        }
    }

    #[test]
    fn the_palm_turns_the_shorter_way_whichever_quaternion_it_is_given() {
        let [from, to] = [turned([0.0, 0.0, -2.0]), turned([0.0, 0.0, 2.5])];
        for to in [to, UnitQuaternion::new_unchecked(-to.into_inner())] {
            let first = step(0.0, [0.0; 3], from, [0.0; 2]);
            let last = step(2.0, [0.0; 3], to, [0.0; 2]);
            let line = Line::between(&first, &last);
            // 4.5 rad one way is 1.78 rad the other way.
            let angle = 2.0 * std::f64::consts::PI - 4.5;
            assert!((line.rates.palm_velocity.angular.z + angle / 2.0).abs() < 1e-12);
            let middle = line.at(1.0);
            let expected = turned([0.0, 0.0, -2.0 - angle / 2.0]);
            let found = middle.frame_from_palm.rotation;
            assert!(found.angle_to(&expected) < 1e-7);
        }
    }

    #[test]
    fn a_motion_without_two_ends_stays_where_it_is() {
        let mut short = motion();
        short.motion = of_steps(short.motion.steps()[..1].to_vec());
        let line = line(&short).unwrap();
        assert_eq!(line.motion.steps().len(), 1);
        let (found, given) = (line.motion.first(), short.motion.first());
        assert_eq!(found.frame_from_palm, given.frame_from_palm);
        assert_eq!((&found.q_rad, found.time_s), (&given.q_rad, given.time_s));
        assert_eq!(found.rates, HandRates::zero(2));
    }
}
