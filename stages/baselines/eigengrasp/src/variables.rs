//! Annealed variables: the palm's pose about an object and the amplitudes of eigengrasps.

use std::f64::consts::PI;

use motion::HandState;
use nalgebra::{Point3, Unit, UnitQuaternion, Vector3};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use robot::RobotModel;
use spatial::{Object, Pose};

use crate::{annealing::jump, basis::Basis};

/// Draws of a jump until it stays in its range; then it ends at the range's end.
const MAX_DRAWS: usize = 20;

/// One number that is annealed.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Variable {
    least: f64,
    most: f64,
    longest_jump: f64,
    /// Whether the ends of the range are one.
    is_circular: bool,
}

/// The numbers that are annealed: the palm's place (m), the angles of the axis and about it (rad), amplitudes.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Variables(Vec<Variable>);

impl Variables {
    /// Returns `GraspIt`'s ranges and longest jumps, with amplitudes in standard deviations.
    pub(crate) fn new(eigengrasps: usize, max_amplitude: f64) -> Self {
        let bounded = |least: f64, most: f64, longest_jump: f64| Variable {
            least,
            most,
            longest_jump,
            is_circular: false,
        };
        let place = bounded(-0.25, 0.25, 0.15);
        let about_axis = bounded(0.0, PI, PI / 2.0);
        let mut all = vec![
            place,
            place,
            bounded(-0.25, 0.35, 0.15),
            bounded(0.0, PI, PI / 5.0),
            Variable {
                is_circular: true,
                ..bounded(-PI, PI, PI / 5.0)
            },
            about_axis,
        ];
        let amplitude = bounded(-max_amplitude, max_amplitude, 0.5 * max_amplitude);
        all.extend(std::iter::repeat_n(amplitude, eigengrasps));
        Self(all)
    }

    /// Draws a state, every one as likely.
    pub(crate) fn draw(&self, rng: &mut ChaCha8Rng) -> Vec<f64> {
        let draw = |one: &Variable| one.least + (one.most - one.least) * rng.random::<f64>();
        self.0.iter().map(draw).collect()
    }

    /// Returns a neighbor of a state: each number jumps by itself.
    pub(crate) fn neighbor(
        &self,
        state: &[f64],
        temperature: f64,
        rng: &mut ChaCha8Rng,
    ) -> Vec<f64> {
        let numbers = self.0.iter().zip(state);
        numbers
            .map(|(variable, at)| variable.neighbor(*at, temperature, rng))
            .collect()
    }

    /// Returns the hand of a state about a center.
    pub(crate) fn hand(
        state: &[f64],
        center_in_object: &Point3<f64>,
        basis: &Basis,
        model: &RobotModel,
    ) -> HandState<Object> {
        let (pose, amplitudes) = state.split_at(6);
        let (polar, azimuth) = (pose[3], pose[4]);
        let axis = Vector3::new(
            polar.sin() * azimuth.cos(),
            polar.sin() * azimuth.sin(),
            polar.cos(),
        );
        let rotation = UnitQuaternion::from_axis_angle(&Unit::new_normalize(axis), pose[5]);
        let place = center_in_object.coords + Vector3::new(pose[0], pose[1], pose[2]);
        HandState {
            frame_from_palm: Pose::from_parts(place, rotation),
            q_rad: basis.joints(amplitudes, model),
        }
    }
}

impl Variable {
    fn neighbor(&self, at: f64, temperature: f64, rng: &mut ChaCha8Rng) -> f64 {
        let range = self.most - self.least;
        let mut to = at;
        for _ in 0..MAX_DRAWS {
            to = at + self.longest_jump * jump(temperature, rng.random());
            if self.is_circular {
                return self.least + (to - self.least).rem_euclid(range);
            }
            if (self.least..=self.most).contains(&to) {
                return to;
            }
        }
        to.clamp(self.least, self.most)
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;
    use crate::fixture;

    #[test]
    fn neighbors_stay_in_their_ranges_and_circles_go_around() {
        let variables = Variables::new(2, 3.0);
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut state = vec![0.25, 0.0, 0.35, 0.0, PI - 1e-3, PI, 3.0, -3.0];
        let mut went_around = false;
        for _ in 0..500 {
            let next = variables.neighbor(&state, 1.0, &mut rng);
            for (variable, at) in variables.0.iter().zip(&next) {
                assert!(
                    (variable.least..=variable.most).contains(at),
                    "{variable:?} {at}"
                );
            }
            went_around |= (next[4] - state[4]).abs() > PI;
            state = next;
        }
        assert!(went_around);
    }

    #[test]
    fn a_state_is_a_turn_about_an_axis_at_a_place_with_amplitudes() {
        let body = fixture::body();
        let basis = fixture::basis();
        let state = [0.1, -0.2, 0.3, PI / 2.0, PI / 2.0, 0.7, 1.0, 0.0];
        let center = Point3::new(0.0, 0.0, 0.05);
        let hand = Variables::hand(&state, &center, &basis, body.model());
        let place = hand.frame_from_palm.translation.vector;
        assert!((place - Vector3::new(0.1, -0.2, 0.35)).norm() < 1e-12);
        // The axis of polar angle and azimuth of a quarter turn is y.
        let expected = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 0.7);
        assert!(hand.frame_from_palm.rotation.angle_to(&expected) < 1e-9);
        assert_eq!(hand.q_rad, basis.joints(&[1.0, 0.0], body.model()));
    }
}
