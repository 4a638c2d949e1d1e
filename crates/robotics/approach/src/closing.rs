//! A hand that goes on until it touches: its palm along the approach, its fingers joint by joint.

use motion::HandState;
use posture::Environment;
use spatial::Object;

use crate::{ApproachError, HandBody};

/// Steps by which joints close, in radians: first fast, at last by 0.2 mm at a fingertip.
const STEPS_RAD: [f64; 3] = [0.04, 0.01, 0.002];
/// Longest step of the palm, in meters: beyond the grid of distances the way left is only bounded.
const PALM_STEP_M: f64 = 0.01;
/// Gap at which the palm has arrived, in meters.
const ARRIVED_M: f64 = 2e-4;

impl HandBody {
    /// Returns the hand with its flexion joints closed, one step each in turn: a joint stops at its limit, and where
    /// a link that it moves would enter the object or the table; those beyond it go on (`GraspIt`'s automatic grasp).
    /// Fingers do not stop at each other.
    ///
    /// # Errors
    ///
    /// Fails if there is not one position per joint.
    pub fn closed(
        &self,
        environment: &Environment,
        hand: &HandState<Object>,
    ) -> Result<HandState<Object>, ApproachError> {
        let mut hand = hand.clone();
        for step_rad in STEPS_RAD {
            let mut closes = self.flexion().to_vec();
            while !closes.is_empty() {
                let mut still = Vec::with_capacity(closes.len());
                for joint in closes {
                    if self.bent_by(environment, &mut hand, joint, step_rad)? {
                        still.push(joint);
                    }
                }
                closes = still;
            }
        }
        Ok(hand)
    }

    /// Bends a joint by a step, or returns that it must stay where it is.
    fn bent_by(
        &self,
        environment: &Environment,
        hand: &mut HandState<Object>,
        joint: usize,
        step_rad: f64,
    ) -> Result<bool, ApproachError> {
        let before = hand.q_rad[joint];
        if before + step_rad > self.model().joints()[joint].upper {
            return Ok(false);
        }
        let here = self.placed(hand)?;
        hand.q_rad[joint] = before + step_rad;
        let there = self.placed(hand)?;
        let gap_m = self
            .clearance_of_joint(environment, &there, joint)
            .least_m();
        if gap_m >= 0.0 {
            return Ok(true);
        }
        // What is inside already may go outward.
        let least_m = self.clearance_of_joint(environment, &here, joint).least_m();
        if gap_m > least_m {
            return Ok(true);
        }
        hand.q_rad[joint] = before;
        Ok(false)
    }

    /// Returns the hand moved along its approach until a link touches the object or the table, or by `most_m`.
    ///
    /// # Errors
    ///
    /// Fails if there is not one position per joint.
    pub fn advanced(
        &self,
        environment: &Environment,
        hand: &HandState<Object>,
        most_m: f64,
    ) -> Result<HandState<Object>, ApproachError> {
        let mut hand = hand.clone();
        let way = hand.frame_from_palm.rotation * *self.axes().approach_in_palm;
        let mut left_m = most_m;
        while left_m > 0.0 {
            // No point comes nearer to anything by more than the way gone.
            let gap_m = self.clearance(environment, &hand)?.least_m();
            if gap_m < ARRIVED_M {
                break;
            }
            let step_m = gap_m.min(PALM_STEP_M).min(left_m);
            hand.frame_from_palm = hand.frame_from_palm.translated(&(way * step_m));
            left_m -= step_m;
        }
        Ok(hand)
    }

    /// Returns the hand backed off against its approach.
    #[must_use]
    pub fn backed_off(&self, hand: &HandState<Object>, by_m: f64) -> HandState<Object> {
        let way = hand.frame_from_palm.rotation * *self.axes().approach_in_palm;
        HandState {
            frame_from_palm: hand.frame_from_palm.translated(&(way * -by_m)),
            q_rad: hand.q_rad.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};
    use spatial::Pose;

    use super::*;
    use crate::fixture;

    /// The open hand before the box's broad side, its fingers upward.
    fn before() -> HandState<Object> {
        HandState {
            frame_from_palm: Pose::from_parts([-0.2, 0.0, 0.06], UnitQuaternion::identity()),
            q_rad: fixture::body().open(),
        }
    }

    #[test]
    fn the_palm_goes_on_until_it_touches_and_no_farther_than_it_may() {
        let (body, environment) = (fixture::body(), fixture::environment());
        let arrived = body.advanced(&environment, &before(), 1.0).unwrap();
        let clearance = body.clearance(&environment, &arrived).unwrap();
        assert!((-1e-3..1e-3).contains(&clearance.object_m), "{clearance:?}");
        let partly = body.advanced(&environment, &before(), 0.02).unwrap();
        let gone =
            partly.frame_from_palm.translation.vector - before().frame_from_palm.translation.vector;
        assert!((gone.norm() - 0.02).abs() < 1e-9);
        let back = body
            .backed_off(&partly, 0.02)
            .frame_from_palm
            .translation
            .vector;
        assert!((back - before().frame_from_palm.translation.vector).norm() < 1e-9);
    }

    #[test]
    fn fingers_close_on_the_box_and_not_into_it() {
        let (body, environment) = (fixture::body(), fixture::environment());
        // From above, the fingers on one of the narrow box's broad sides and the thumb on the other.
        let down = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::FRAC_PI_2);
        let center = down * body.axes().center_in_palm.coords;
        let above = HandState {
            frame_from_palm: Pose::from_parts(Vector3::new(0.0, 0.0, 0.25) - center, down),
            q_rad: body.open(),
        };
        let arrived = body.advanced(&environment, &above, 0.22).unwrap();
        let closed = body.closed(&environment, &arrived).unwrap();
        let clearance = body.clearance(&environment, &closed).unwrap();
        assert!((-1e-4..5e-4).contains(&clearance.object_m), "{clearance:?}");
        let touching = body.touches(&environment, &closed, 1e-3).unwrap();
        let links: std::collections::BTreeSet<usize> =
            touching.iter().map(|touch| touch.link).collect();
        assert!(links.len() >= 3, "{links:?}");
        for (q, joint) in closed.q_rad.iter().zip(body.model().joints()) {
            assert!((joint.lower..=joint.upper).contains(q), "{q} {joint:?}");
        }
        // Joints that do not bend stay, and no finger opens.
        for (joint, (closed, open)) in closed.q_rad.iter().zip(&arrived.q_rad).enumerate() {
            assert!(closed >= open);
            assert!(body.flexion().contains(&joint) || closed == open);
        }
    }

    #[test]
    fn fingers_in_the_air_close_to_their_limits() {
        let (body, environment) = (fixture::body(), fixture::environment());
        let mut hand = before();
        hand.frame_from_palm = Pose::from_parts([-1.0, 0.0, 1.0], UnitQuaternion::identity());
        let closed = body.closed(&environment, &hand).unwrap();
        for &joint in body.flexion() {
            let left = body.model().joints()[joint].upper - closed.q_rad[joint];
            assert!((0.0..=STEPS_RAD[2]).contains(&left), "{joint}: {left}");
        }
    }
}
