//! The path of all joints over time, and the brake that ends it early.
//!
//! A controller is never given the whole path. It is given slices of it: a little of the past, so that
//! a late message changes nothing, the next quarter of a second, and a brake at its end. While slices
//! come, none of these brakes is reached. When none comes any more, because the cell, the network or
//! the machine between has died, the robot stops by itself.

use cell::{Goal, JointPoint, JointRates, JointTrack, PalmTrajectory};

/// Extents of a slice into the past and into the future, in seconds.
const PAST_S: f64 = 0.05;
const HORIZON_S: f64 = 0.25;
/// Longest brake, in seconds: two slices may be lost before it would begin.
pub(crate) const MAX_BRAKE_S: f64 = 0.15;
/// Time between the points of a slice, in seconds: between them a controller interpolates.
pub(crate) const POINT_S: f64 = 0.01;
/// Shortest time from where the robot is to the goal's first row, in seconds.
const MIN_APPROACH_S: f64 = 0.3;
/// Greatest speed of a quintic from rest to rest, as a multiple of its mean.
const PEAK: f64 = 1.875;
/// Greatest deceleration of a brake, as a multiple of speed over duration.
pub(crate) const BRAKE_PEAK: f64 = 1.5;

/// Rounding of a time, as a share of a brake.
const ROUNDING: f64 = 1e-9;

/// The path of arm and hand; times are seconds since the goal's first row, negative before it.
pub(crate) struct JointPath {
    /// The arm's joints, then the hand's.
    pub(crate) tracks: [JointTrack; 2],
    /// Its start time.
    pub(crate) begin_s: f64,
    brake_s: f64,
    braked_at_s: Option<f64>,
}

/// The points of a slice, for each controller; its first point is at the time of the slice.
pub(crate) struct Slice {
    /// Time of the first point.
    pub(crate) begin_s: f64,
    /// The points, their times counted from there.
    pub(crate) points: [Vec<JointPoint>; 2],
}

impl JointPath {
    /// Returns the path from `measured`, where arm and hand rest, along the goal; `None` if the goal
    /// has no arm or no points.
    pub(crate) fn new(
        goal: &Goal,
        measured: [&[f64]; 2],
        approach_rad_per_s: f64,
        brake_s: f64,
    ) -> Option<Self> {
        let PalmTrajectory::Arm(arm) = &goal.carrier else {
            return None;
        };
        let mut tracks = [arm.clone(), goal.hand.clone()];
        let off_rad = start_error(&tracks, measured)?;
        let approach_s = MIN_APPROACH_S.max(PEAK * off_rad / approach_rad_per_s);
        for (track, q) in tracks.iter_mut().zip(measured) {
            let rest = JointPoint {
                time_s: -approach_s,
                q_rad: q.to_vec(),
                rates: JointRates::zero(q.len()),
            };
            track.points.insert(0, rest);
        }
        Some(Self {
            tracks,
            begin_s: -approach_s,
            brake_s,
            braked_at_s: None,
        })
    }

    /// Brakes from a time on; the first brake counts.
    pub(crate) fn brake(&mut self, at_s: f64) {
        self.braked_at_s.get_or_insert(at_s);
    }

    /// Returns whether no brake came before the goal's first row.
    pub(crate) fn is_on_the_goal(&self) -> bool {
        self.braked_at_s.is_none_or(|at_s| at_s > 0.0)
    }

    /// Returns the time at which the brake has ended, if there is one.
    pub(crate) fn rests_from_s(&self) -> Option<f64> {
        Some(self.braked_at_s? + self.brake_s)
    }

    /// Returns the time until which a slice made at `time_s` follows the path: there its own brake begins.
    pub(crate) fn followed_until_s(&self, time_s: f64) -> f64 {
        time_s + HORIZON_S - self.brake_s
    }

    /// Returns the commands at a time, for each controller.
    pub(crate) fn at(&self, time_s: f64) -> Option<[JointPoint; 2]> {
        let brake = self.braked_at_s.unwrap_or(f64::INFINITY);
        let [arm, hand] = &self.tracks;
        Some([
            self.point(arm, time_s, brake)?,
            self.point(hand, time_s, brake)?,
        ])
    }

    /// Returns the slice of a time.
    pub(crate) fn slice(&self, time_s: f64) -> Option<Slice> {
        let begin_s = time_s - PAST_S;
        let tail = self.followed_until_s(time_s);
        let brake = self.braked_at_s.map_or(tail, |at_s| at_s.min(tail));
        let steps = ((PAST_S + HORIZON_S) / POINT_S).round();
        let points = |track: &JointTrack| {
            let point = |step: u32| {
                let after_s = f64::from(step) * POINT_S;
                let point = self.point(track, begin_s + after_s, brake)?;
                Some(JointPoint {
                    time_s: after_s,
                    ..point
                })
            };
            (0..=steps_n(steps)).map(point).collect::<Option<Vec<_>>>()
        };
        let [arm, hand] = &self.tracks;
        Some(Slice {
            begin_s,
            points: [points(arm)?, points(hand)?],
        })
    }

    /// Returns the greatest deceleration that a brake may ask of each controller, in rad/s².
    pub(crate) fn brake_deceleration(track: &JointTrack, brake_s: f64) -> f64 {
        let pairs = track.points.iter().zip(track.points.iter().skip(1));
        let speeds = pairs.flat_map(|(from, to)| {
            let segments = from.segments(to);
            segments.map(|segment| segment.max_speed(0.0))
        });
        BRAKE_PEAK * speeds.fold(0.0, f64::max) / brake_s
    }

    /// Returns a point of a track whose brake begins at `brake`: along the path, ever slower.
    fn point(&self, track: &JointTrack, time_s: f64, brake: f64) -> Option<JointPoint> {
        if time_s <= brake {
            return track.at(time_s);
        }
        // The last point of a slice is at rest, to the last bit.
        let share = ((time_s - brake) / self.brake_s + ROUNDING).min(1.0);
        let (square, cube) = (share * share, share * share * share);
        let along_s = brake + self.brake_s * (share - cube + 0.5 * square * square);
        let speed = 1.0 - 3.0 * square + 2.0 * cube;
        let change = 6.0 * (square - share) / self.brake_s;
        let JointPoint { q_rad, rates, .. } = track.at(along_s)?;
        let both = rates.velocity.iter().zip(&rates.acceleration);
        let acceleration = both.map(|(v, a)| a * speed * speed + v * change);
        Some(JointPoint {
            time_s,
            q_rad,
            rates: JointRates {
                acceleration: acceleration.collect(),
                velocity: rates.velocity.iter().map(|v| v * speed).collect(),
            },
        })
    }
}

/// Returns the largest distance of a joint from the first row, in radians.
pub(crate) fn start_error(tracks: &[JointTrack; 2], measured: [&[f64]; 2]) -> Option<f64> {
    let mut off_rad = 0.0_f64;
    for (track, q) in tracks.iter().zip(measured) {
        let first = track.points.first()?;
        let both = first.q_rad.iter().zip(q);
        off_rad = both.fold(off_rad, |off, (to, from)| off.max((to - from).abs()));
    }
    Some(off_rad)
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a slice has some dozen points"
)]
fn steps_n(steps: f64) -> u32 {
    steps as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A joint that goes from 0 to 1 rad in a second.
    fn path() -> JointPath {
        let track = |points: [(f64, f64); 3]| JointTrack {
            joints: vec!["j".to_owned()],
            points: points
                .map(|(time_s, q)| JointPoint {
                    time_s,
                    q_rad: vec![q],
                    rates: JointRates::zero(1),
                })
                .to_vec(),
        };
        let moving = track([(-0.3, 0.0), (0.0, 0.0), (1.0, 1.0)]);
        JointPath {
            tracks: [moving.clone(), moving],
            begin_s: -0.3,
            brake_s: 0.03,
            braked_at_s: None,
        }
    }

    #[test]
    fn slices_agree_where_they_follow_the_path_and_each_ends_at_rest() {
        let path = path();
        for step in 0..150 {
            let time_s = f64::from(step) * 0.01 - 0.3 + 1e-4;
            let slice = path.slice(time_s).unwrap();
            let points = &slice.points[0];
            assert_eq!(points.last().unwrap().rates.velocity, [0.0]);
            for point in points {
                let at_s = slice.begin_s + point.time_s;
                let on_path = path.at(at_s).unwrap();
                let off_rad = (point.q_rad[0] - on_path[0].q_rad[0]).abs();
                let is_followed = at_s <= path.followed_until_s(time_s);
                assert!(
                    off_rad < if is_followed { 1e-12 } else { 0.04 },
                    "{at_s} s: {off_rad}"
                );
            }
        }
    }

    #[test]
    fn brake_is_smooth_stays_on_the_path_and_ends_in_time() {
        let (free, mut braked) = (path(), path());
        braked.brake(0.5);
        braked.brake(0.7);
        assert_eq!(braked.rests_from_s(), Some(0.53));
        let limit = JointPath::brake_deceleration(&free.tracks[0], free.brake_s);
        let at = |path: &JointPath, time_s: f64| path.at(time_s).unwrap()[0].clone();
        let step_s = 1e-4;
        for step in 0..800 {
            let time_s = 0.48 + f64::from(step) * step_s;
            let [before, now] = [at(&braked, time_s - step_s), at(&braked, time_s)];
            let rate = (now.q_rad[0] - before.q_rad[0]) / step_s;
            assert!((rate - now.rates.velocity[0]).abs() < 0.02, "{time_s} s");
            assert!(now.rates.acceleration[0] > -1.01 * limit);
            assert!(now.q_rad[0] <= at(&free, time_s).q_rad[0] + 1e-12);
        }
        let rest = at(&braked, 0.6);
        assert_eq!(
            (rest.rates.velocity[0], rest.rates.acceleration[0]),
            (0.0, 0.0)
        );
        assert!((rest.q_rad[0] - at(&free, 0.515).q_rad[0]).abs() < 1e-9);
    }
}
