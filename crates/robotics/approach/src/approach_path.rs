//! The approach path from a start by a pregrasp to a grasp: two straight lines.

use std::sync::Arc;

use motion::{HandRates, HandState, JointRates, Motion, MotionError, Step};
use nalgebra::{UnitQuaternion, Vector3};
use posture::Environment;
use spatial::{Object, Pose, Twist};

use crate::{ApproachConfig, ApproachError, HandBody};

/// Number of points of a straight line that are checked.
const CHECKS: u32 = 16;
/// Depth up to which a path counts as clear, in meters: the accuracy of the grid of distances.
const CLEAR_DEPTH_M: f64 = 1e-3;

/// Timing of the two parts of the path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ApproachPath {
    steps: usize,
    duration_s: f64,
    /// Time at which the hand is in its pregrasp, in seconds.
    knee_s: f64,
}

/// A hand that moves at constant rates between two times.
struct PathSegment<'a> {
    from: &'a HandState<Object>,
    to: &'a HandState<Object>,
    start_s: f64,
    duration_s: f64,
}

impl ApproachPath {
    /// Returns the path of the options.
    pub fn new(config: &ApproachConfig) -> Self {
        Self {
            steps: config.steps.max(2),
            duration_s: config.duration_s,
            knee_s: config.duration_s * (1.0 - config.closing_share),
        }
    }

    /// Returns the motion of a hand from a start straight to a pregrasp and from there straight to a grasp: palm
    /// and joints at constant rates in each part, the palm about one axis by the smaller angle. Steps are at equal
    /// times, from 0. At the pregrasp itself the rates are those of the first part; accelerations are zero, that
    /// of the turn between the parts left out.
    ///
    /// # Errors
    ///
    /// Fails if rates are not finite, or the hands have not one position per joint.
    pub fn motion(
        &self,
        joints: &Arc<[String]>,
        start: &HandState<Object>,
        pregrasp: &HandState<Object>,
        grasp: &HandState<Object>,
    ) -> Result<Motion<Object>, MotionError> {
        let reach = PathSegment {
            from: start,
            to: pregrasp,
            start_s: 0.0,
            duration_s: self.knee_s,
        };
        let close = PathSegment {
            from: pregrasp,
            to: grasp,
            start_s: self.knee_s,
            duration_s: self.duration_s - self.knee_s,
        };
        let last = self.steps - 1;
        let steps = (0..self.steps).map(|idx| {
            let time_s = self.duration_s * idx as f64 / last as f64;
            let leg = if time_s <= self.knee_s {
                &reach
            } else {
                &close
            };
            let mut step = leg.at(time_s);
            if idx == last {
                // Free of rounding.
                step.frame_from_palm = grasp.frame_from_palm;
                step.q_rad.clone_from(&grasp.q_rad);
            }
            step
        });
        Motion::of_joints(Arc::clone(joints), steps.collect())
    }
}

/// Returns whether the straight line from one hand to another is clear of object and table.
///
/// # Errors
///
/// Fails if there is not one position per joint.
pub(crate) fn is_clear(
    body: &HandBody,
    environment: &Environment,
    from: &HandState<Object>,
    to: &HandState<Object>,
) -> Result<bool, ApproachError> {
    let leg = PathSegment {
        from,
        to,
        start_s: 0.0,
        duration_s: 1.0,
    };
    for idx in (0..CHECKS).rev() {
        let hand = HandState::from(leg.at(f64::from(idx) / f64::from(CHECKS)));
        if !body.is_clear(environment, &body.placed(&hand)?, CLEAR_DEPTH_M) {
            return Ok(false);
        }
    }
    Ok(true)
}

impl PathSegment<'_> {
    fn at(&self, time_s: f64) -> Step<Object> {
        let share = (time_s - self.start_s) / self.duration_s;
        let [from, to] = [self.from, self.to].map(|hand| &hand.frame_from_palm);
        let way = to.translation.vector - from.translation.vector;
        // Of the two quaternions of a rotation, `scaled_axis` takes the one with the smaller angle.
        let turn: Vector3<f64> = (to.rotation * from.rotation.inverse()).scaled_axis();
        let rotation = UnitQuaternion::from_scaled_axis(turn * share) * from.rotation;
        let joints = || self.from.q_rad.iter().zip(&self.to.q_rad);
        let dof = self.from.q_rad.len();
        Step {
            time_s,
            frame_from_palm: Pose::from_parts(from.translation.vector + way * share, rotation),
            q_rad: joints()
                .map(|(from, to)| from + (to - from) * share)
                .collect(),
            rates: HandRates {
                palm_velocity: Twist::new(way / self.duration_s, turn / self.duration_s),
                joints: JointRates {
                    velocity: joints()
                        .map(|(from, to)| (to - from) / self.duration_s)
                        .collect(),
                    ..JointRates::zero(dof)
                },
                ..HandRates::zero(dof)
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;
    use crate::fixture;

    fn hand(place: [f64; 3], yaw: f64, q_rad: f64) -> HandState<Object> {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
        HandState {
            frame_from_palm: Pose::from_parts(place, turn),
            q_rad: vec![q_rad],
        }
    }

    fn motion(steps: usize) -> Motion<Object> {
        let config = ApproachConfig {
            steps,
            duration_s: 2.0,
            closing_share: 0.25,
            ..ApproachConfig::default()
        };
        let [start, pregrasp, grasp] = [
            hand([0.0, 0.0, 0.0], 0.0, 0.0),
            hand([0.3, 0.0, 0.6], FRAC_PI_2, 0.3),
            hand([0.3, 0.1, 0.6], FRAC_PI_2, 1.3),
        ];
        let joints: Arc<[String]> = ["j".to_owned()].into();
        ApproachPath::new(&config)
            .motion(&joints, &start, &pregrasp, &grasp)
            .unwrap()
    }

    #[test]
    fn the_hand_is_at_the_pregrasp_when_it_begins_to_close_and_at_the_grasp_at_the_end() {
        let motion = motion(5);
        let steps = motion.steps();
        assert_eq!(steps.len(), 5);
        let check = |idx: usize, time_s: f64, place: [f64; 3], yaw: f64, q: f64| {
            let step = &steps[idx];
            assert!((step.time_s - time_s).abs() < 1e-12);
            let off = step.frame_from_palm.translation.vector - Vector3::from(place);
            assert!(off.norm() < 1e-12, "{idx}: {off}");
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
            assert!(
                step.frame_from_palm.rotation.angle_to(&turn) < 1e-7,
                "{idx}"
            );
            assert!((step.q_rad[0] - q).abs() < 1e-12, "{idx}: {:?}", step.q_rad);
        };
        check(0, 0.0, [0.0, 0.0, 0.0], 0.0, 0.0);
        check(1, 0.5, [0.1, 0.0, 0.2], FRAC_PI_2 / 3.0, 0.1);
        check(3, 1.5, [0.3, 0.0, 0.6], FRAC_PI_2, 0.3);
        check(4, 2.0, [0.3, 0.1, 0.6], FRAC_PI_2, 1.3);
    }

    #[test]
    fn a_way_through_the_box_is_not_clear_and_one_beside_it_is() {
        let (body, environment) = (fixture::body(), fixture::environment());
        let at = |x: f64, y: f64| HandState {
            frame_from_palm: Pose::from_parts([x, y, 0.06], UnitQuaternion::identity()),
            q_rad: body.open(),
        };
        let check = |from: HandState<Object>, to: HandState<Object>| {
            is_clear(&body, &environment, &from, &to).unwrap()
        };
        assert!(!check(at(-0.5, 0.0), at(0.5, 0.0)));
        assert!(check(at(-0.5, 0.4), at(0.5, 0.4)));
        assert!(check(at(-0.5, 0.0), at(-0.3, 0.0)));
    }

    #[test]
    fn rates_are_those_of_each_straight_part() {
        let motion = motion(9);
        let rates = |idx: usize| motion.steps()[idx].rates.clone();
        let first = rates(1);
        assert!((first.palm_velocity.linear - Vector3::new(0.2, 0.0, 0.4)).norm() < 1e-12);
        let turn = Vector3::new(0.0, 0.0, FRAC_PI_2 / 1.5);
        assert!((first.palm_velocity.angular - turn).norm() < 1e-9);
        assert!((first.joints.velocity[0] - 0.2).abs() < 1e-12);
        let last = rates(8);
        assert!((last.palm_velocity.linear - Vector3::new(0.0, 0.2, 0.0)).norm() < 1e-12);
        assert!(last.palm_velocity.angular.norm() < 1e-9);
        assert!((last.joints.velocity[0] - 2.0).abs() < 1e-12);
        // Between two steps of a part the positions differ by the rates.
        for idx in [1, 7] {
            let [here, next] = [idx, idx + 1].map(|idx| &motion.steps()[idx]);
            let moved =
                next.frame_from_palm.translation.vector - here.frame_from_palm.translation.vector;
            let expected = here.rates.palm_velocity.linear * (next.time_s - here.time_s);
            assert!((moved - expected).norm() < 1e-12, "{idx}");
        }
    }
}
