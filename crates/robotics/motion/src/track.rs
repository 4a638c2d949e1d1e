//! Commands of one controller: points with positions, velocities and accelerations.

use robot::JointOrder;
use spatial::{Palm, Pose, PoseSegment, PoseState, QuinticSegment, Table, Twist};

use crate::{JointRates, MotionError, Rates, interpolation::ends, joints_between};

/// Commands of a joint controller.
///
/// Between two points the joints follow the quintic polynomial that matches both points' positions,
/// velocities and accelerations ([`spatial::quintic`]); after the last they rest.
#[derive(Debug, Clone, PartialEq)]
pub struct JointTrack {
    /// Names of the joints, in the order of the points' numbers.
    pub joints: Vec<String>,
    /// The points in time order.
    pub points: Vec<JointPoint>,
}

/// One point of a [`JointTrack`].
#[derive(Debug, Clone, PartialEq)]
pub struct JointPoint {
    /// Seconds since the start of the goal.
    pub time_s: f64,
    /// Joint positions in radians (meters if prismatic).
    pub q_rad: Vec<f64>,
    /// Velocities and accelerations.
    pub rates: JointRates,
}

/// The trajectory of what carries the hand.
#[derive(Debug, Clone, PartialEq)]
pub enum PalmTrajectory {
    /// A free-flying palm, along [`PoseSegment`]s between these points.
    Palm(Vec<PalmPoint>),
    /// An arm.
    Arm(JointTrack),
}

/// State of a free-flying palm at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct PalmPoint {
    /// Seconds since the start of the goal.
    pub time_s: f64,
    /// Pose of the palm.
    pub table_from_palm: Pose<Table, Palm>,
    /// Its velocity.
    pub velocity: Twist<Table>,
    /// Its acceleration.
    pub acceleration: Twist<Table>,
}

impl JointTrack {
    /// Returns the joints at a time of the goal; `None` without points.
    pub fn at(&self, time_s: f64) -> Option<JointPoint> {
        let (from, to, after_s) = around(&self.points, time_s)?;
        let (q_rad, rates) = joints_between(
            (&from.q_rad, &from.rates),
            (&to.q_rad, &to.rates),
            to.time_s - from.time_s,
            after_s,
        );
        let ends = [self.points.first()?.time_s, self.points.last()?.time_s];
        let rates = if (ends[0]..=ends[1]).contains(&time_s) {
            rates
        } else {
            JointRates::zero(q_rad.len())
        };
        Some(JointPoint {
            time_s,
            q_rad,
            rates,
        })
    }

    /// Returns the same track with its joints in the given order.
    ///
    /// # Errors
    ///
    /// Fails unless both are orders of the same joints, and every point has one number for each.
    pub fn reordered(&self, joints: &[String]) -> Result<Self, MotionError> {
        let order = JointOrder::new(&self.joints, joints)?;
        let point = |point: &JointPoint| {
            Ok(JointPoint {
                time_s: point.time_s,
                q_rad: order.apply(&point.q_rad)?,
                rates: point.rates.reordered(&order)?,
            })
        };
        let points = self.points.iter().map(point);
        Ok(Self {
            joints: joints.to_vec(),
            points: points.collect::<Result<_, MotionError>>()?,
        })
    }
}

impl JointPoint {
    /// Returns each joint's segment to the next point.
    pub fn segments(&self, to: &Self) -> impl Iterator<Item = QuinticSegment<f64>> {
        let duration_s = to.time_s - self.time_s;
        let ends = ends(&self.q_rad, &self.rates).zip(ends(&to.q_rad, &to.rates));
        ends.map(move |(from, to)| QuinticSegment::new(from, to, duration_s))
    }
}

impl PalmPoint {
    /// Returns a palm's pose at a time of the goal; `None` without points, or if the palm's turn
    /// between two points cannot be interpolated.
    pub fn between(points: &[Self], time_s: f64) -> Option<Pose<Table, Palm>> {
        let (from, to, after_s) = around(points, time_s)?;
        let duration_s = to.time_s - from.time_s;
        if duration_s <= 0.0 {
            return Some(to.table_from_palm);
        }
        Some(from.segment(to)?.at(after_s).frame_from_palm)
    }

    /// Returns the palm's segment to the next point; `None` if its turn cannot be interpolated.
    pub fn segment(&self, to: &Self) -> Option<PoseSegment<Table>> {
        PoseSegment::new(&self.moving(), &to.moving(), to.time_s - self.time_s)
    }

    fn moving(&self) -> PoseState<Table> {
        PoseState {
            frame_from_palm: self.table_from_palm,
            velocity: self.velocity,
            acceleration: self.acceleration,
        }
    }
}

/// A point with a time in the goal.
pub trait Timed {
    /// Seconds since the start of the goal.
    fn time_s(&self) -> f64;
}

impl Timed for JointPoint {
    fn time_s(&self) -> f64 {
        self.time_s
    }
}

impl Timed for PalmPoint {
    fn time_s(&self) -> f64 {
        self.time_s
    }
}

/// Returns the two points around a time, and the seconds since the first; before and after all
/// points, the nearest end.
fn around<T: Timed>(points: &[T], time_s: f64) -> Option<(&T, &T, f64)> {
    let after = points.partition_point(|point| point.time_s() <= time_s);
    let to = points.get(after).or(points.last())?;
    let from = points.get(after.saturating_sub(1))?;
    let within = (time_s - from.time_s()).clamp(0.0, (to.time_s() - from.time_s()).max(0.0));
    Some((from, to, within))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Vector3};

    use super::*;

    fn track() -> JointTrack {
        let point = |time_s: f64, q: f64, velocity: f64| JointPoint {
            time_s,
            q_rad: vec![q],
            rates: JointRates {
                velocity: vec![velocity],
                acceleration: vec![0.0],
            },
        };
        JointTrack {
            joints: vec!["a".to_owned()],
            points: vec![
                point(0.0, 0.0, 0.0),
                point(1.0, 0.5, 1.0),
                point(2.0, 1.5, 1.0),
            ],
        }
    }

    #[test]
    fn a_track_goes_through_its_points_and_rests_outside() {
        let track = track();
        for point in &track.points[..2] {
            let found = track.at(point.time_s).unwrap();
            assert_eq!(found.q_rad, point.q_rad);
            assert_eq!(found.rates.velocity, point.rates.velocity);
        }
        let middle = track.at(1.5).unwrap();
        assert!((middle.q_rad[0] - 1.0).abs() < 1e-12);
        assert_eq!(track.at(-1.0).unwrap().q_rad, [0.0]);
        assert_eq!(track.at(9.0).unwrap().q_rad, [1.5]);
        // The last point moves on at 1 rad/s; nothing is commanded after it.
        assert_eq!(track.at(2.0).unwrap().rates.velocity, [1.0]);
        for outside_s in [-1.0, 9.0] {
            assert_eq!(track.at(outside_s).unwrap().rates, JointRates::zero(1));
        }
        assert_eq!(
            JointTrack {
                points: Vec::new(),
                ..track
            }
            .at(0.0),
            None
        );
    }

    #[test]
    fn a_palm_stands_where_its_points_do_to_the_last_bit() {
        let pose = Pose::new(Isometry3::new(
            Vector3::new(0.1, -0.2, 0.3),
            Vector3::new(0.4, -1.1, 0.2),
        ));
        let point = |time_s: f64| PalmPoint {
            time_s,
            table_from_palm: pose,
            velocity: Twist::zero(),
            acceleration: Twist::zero(),
        };
        let points = [point(0.0), point(1.0)];
        for time_s in [-1.0, 0.0, 0.3, 1.0, 2.0] {
            let found = PalmPoint::between(&points, time_s).unwrap();
            let off = found.inv_mul(&pose);
            assert!(off.translation.vector.norm() == 0.0 && off.rotation.angle() < 1e-7);
        }
    }
}
