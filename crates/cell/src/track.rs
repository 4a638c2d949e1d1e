//! What one controller is told over time: points with positions, velocities and accelerations.

use spatial::{MovingPose, Palm, Passage, Pose, QuinticSegment, Table, Twist, quintic};

use crate::wire::{self, WireError};

/// What the controller of some joints is told.
///
/// Between two points the joints move along the polynomial of fifth degree that has both points'
/// positions, velocities and accelerations ([`spatial::quintic`]); after the last they rest.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// Names of the joints, in the order of the points' numbers.
    pub joints: Vec<String>,
    /// The points in time order.
    pub points: Vec<JointPoint>,
}

/// One point of a [`Track`].
#[derive(Debug, Clone, PartialEq)]
pub struct JointPoint {
    /// Seconds since the start of the goal.
    pub time_s: f64,
    /// Joint positions in radians (meters if prismatic).
    pub q_rad: Vec<f64>,
    /// Joint velocities in rad/s (m/s).
    pub velocity_rad_per_s: Vec<f64>,
    /// Joint accelerations in rad/s² (m/s²).
    pub acceleration_rad_per_s2: Vec<f64>,
}

/// What moves the palm.
#[derive(Debug, Clone, PartialEq)]
pub enum Carrier {
    /// Nothing: the hand flies, along [`Passage`]s between these points.
    Palm(Vec<PalmPoint>),
    /// An arm.
    Arm(Track),
}

/// Where a palm that flies is at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct PalmPoint {
    /// Seconds since the start of the goal.
    pub time_s: f64,
    /// Pose of the palm.
    pub table_from_palm: Pose<Table, Palm>,
    /// Its velocity along the table's axes.
    pub velocity: Twist,
    /// Its acceleration along the table's axes.
    pub acceleration: Twist,
}

/// Numbers of a palm's point: time, pose, velocity, acceleration.
const PALM_WIDTH: usize = 1 + 7 + 6 + 6;

impl Track {
    /// Returns the joints at a time of the goal; `None` without points.
    pub fn at(&self, time_s: f64) -> Option<JointPoint> {
        let (from, to, after_s) = around(&self.points, time_s)?;
        let mut found = JointPoint {
            time_s,
            q_rad: Vec::with_capacity(self.joints.len()),
            velocity_rad_per_s: Vec::with_capacity(self.joints.len()),
            acceleration_rad_per_s2: Vec::with_capacity(self.joints.len()),
        };
        for (from_end, to_end) in from.ends().zip(to.ends()) {
            let [q, velocity, acceleration] =
                quintic(from_end, to_end, to.time_s - from.time_s, after_s);
            found.q_rad.push(q);
            found.velocity_rad_per_s.push(velocity);
            found.acceleration_rad_per_s2.push(acceleration);
        }
        Some(found)
    }

    pub(crate) fn push(&self, bytes: &mut Vec<u8>) {
        for point in &self.points {
            wire::push_numbers(bytes, [point.time_s]);
            let parts = [
                &point.q_rad,
                &point.velocity_rad_per_s,
                &point.acceleration_rad_per_s2,
            ];
            wire::push_numbers(bytes, parts.into_iter().flatten().copied());
        }
    }

    /// Reads as many points as there are names to; returns what follows.
    pub(crate) fn read(
        joints: Vec<String>,
        points_n: usize,
        bytes: &[u8],
    ) -> Result<(Self, &[u8]), WireError> {
        let dof = joints.len();
        if dof == 0 {
            return Err(WireError::Json {
                part: "controllers",
                message: "a controller has no joints".to_owned(),
            });
        }
        let (rows, rest) = rows(bytes, points_n, 1 + 3 * dof)?;
        let point = |(row, numbers): (usize, &Vec<f64>)| {
            let short = || WireError::Row {
                row,
                message: format!("{} numbers for {dof} joints", numbers.len()),
            };
            let (time_s, numbers) = numbers.split_first().ok_or_else(short)?;
            let (q, numbers) = numbers.split_at_checked(dof).ok_or_else(short)?;
            let (velocity, acceleration) = numbers.split_at_checked(dof).ok_or_else(short)?;
            Ok(JointPoint {
                time_s: *time_s,
                q_rad: q.to_vec(),
                velocity_rad_per_s: velocity.to_vec(),
                acceleration_rad_per_s2: acceleration.to_vec(),
            })
        };
        let points = rows.iter().enumerate().map(point);
        let points = points.collect::<Result<_, WireError>>()?;
        Ok((Self { joints, points }, rest))
    }
}

impl JointPoint {
    /// Position, velocity and acceleration of each joint.
    pub fn ends(&self) -> impl Iterator<Item = [f64; 3]> {
        let rates = self.velocity_rad_per_s.iter();
        let rates = rates.zip(&self.acceleration_rad_per_s2);
        let joints = self.q_rad.iter().zip(rates);
        joints.map(|(&q, (&velocity, &acceleration))| [q, velocity, acceleration])
    }

    /// Returns the way of each joint to the next point.
    pub fn segments(&self, to: &Self) -> impl Iterator<Item = QuinticSegment<f64>> {
        let duration_s = to.time_s - self.time_s;
        let ends = self.ends().zip(to.ends());
        ends.map(move |(from, to)| QuinticSegment::new(from, to, duration_s))
    }
}

impl PalmPoint {
    /// Returns where a palm is at a time of the goal; `None` without points, or where no palm can turn
    /// from one point to the next.
    pub fn between(points: &[Self], time_s: f64) -> Option<Pose<Table, Palm>> {
        let (from, to, after_s) = around(points, time_s)?;
        let duration_s = to.time_s - from.time_s;
        if duration_s <= 0.0 {
            return Some(to.table_from_palm);
        }
        Some(Pose::new(from.passage(to)?.at(after_s).pose))
    }

    /// Returns the palm's way to the next point; `None` where no palm can turn so.
    pub fn passage(&self, to: &Self) -> Option<Passage> {
        Passage::new(&self.moving(), &to.moving(), to.time_s - self.time_s)
    }

    fn moving(&self) -> MovingPose {
        MovingPose {
            pose: *self.table_from_palm.isometry(),
            velocity: self.velocity,
            acceleration: self.acceleration,
        }
    }

    pub(crate) fn push_all(points: &[Self], bytes: &mut Vec<u8>) {
        for point in points {
            wire::push_numbers(bytes, [point.time_s]);
            wire::push_numbers(bytes, point.table_from_palm.to_array());
            wire::push_numbers(bytes, point.velocity.to_array());
            wire::push_numbers(bytes, point.acceleration.to_array());
        }
    }

    /// Reads so many points; returns what follows.
    pub(crate) fn read_all(points_n: usize, bytes: &[u8]) -> Result<(Vec<Self>, &[u8]), WireError> {
        let (rows, rest) = rows(bytes, points_n, PALM_WIDTH)?;
        let point = |(row, numbers): (usize, &Vec<f64>)| {
            let short = || WireError::Row {
                row,
                message: format!("{} numbers for a palm", numbers.len()),
            };
            let (&time_s, numbers) = numbers.split_first().ok_or_else(short)?;
            let (table_from_palm, numbers) = wire::pose(row, numbers)?;
            let (velocity, acceleration) = numbers.split_at_checked(6).ok_or_else(short)?;
            let twist = |numbers: &[f64]| numbers.try_into().map(Twist::from_array).ok();
            Ok(Self {
                time_s,
                table_from_palm,
                velocity: twist(velocity).ok_or_else(short)?,
                acceleration: twist(acceleration).ok_or_else(short)?,
            })
        };
        let points = rows
            .iter()
            .enumerate()
            .map(point)
            .collect::<Result<_, _>>()?;
        Ok((points, rest))
    }
}

/// What has a time in the goal.
pub(crate) trait Timed {
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

/// Returns the two points that a time lies between, and the seconds since the first; before all points
/// and after them, the end that is near.
fn around<T: Timed>(points: &[T], time_s: f64) -> Option<(&T, &T, f64)> {
    let after = points.partition_point(|point| point.time_s() <= time_s);
    let to = points.get(after).or(points.last())?;
    let from = points.get(after.saturating_sub(1))?;
    let within = (time_s - from.time_s()).clamp(0.0, (to.time_s() - from.time_s()).max(0.0));
    Some((from, to, within))
}

/// Takes rows of finite numbers off the front of a message.
fn rows(bytes: &[u8], rows_n: usize, width: usize) -> Result<(Vec<Vec<f64>>, &[u8]), WireError> {
    let whole = WireError::Rows {
        bytes: bytes.len(),
        width,
    };
    let length = width
        .checked_mul(size_of::<f64>())
        .and_then(|row| row.checked_mul(rows_n));
    let split = length.and_then(|length| bytes.split_at_checked(length));
    let (numbers, rest) = split.ok_or(whole)?;
    Ok((wire::rows(numbers, width)?, rest))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Vector3};

    use super::*;

    fn track() -> Track {
        let point = |time_s: f64, q: f64, velocity: f64| JointPoint {
            time_s,
            q_rad: vec![q],
            velocity_rad_per_s: vec![velocity],
            acceleration_rad_per_s2: vec![0.0],
        };
        Track {
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
            assert_eq!(found.velocity_rad_per_s, point.velocity_rad_per_s);
        }
        let middle = track.at(1.5).unwrap();
        assert!((middle.q_rad[0] - 1.0).abs() < 1e-12);
        assert_eq!(track.at(-1.0).unwrap().q_rad, [0.0]);
        assert_eq!(track.at(9.0).unwrap().q_rad, [1.5]);
        assert_eq!(
            Track {
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
            let off = found.isometry().inv_mul(pose.isometry());
            assert!(off.translation.vector.norm() == 0.0 && off.rotation.angle() < 1e-7);
        }
    }

    #[test]
    fn more_points_than_there_are_bytes_are_refused() {
        let mut bytes = Vec::new();
        track().push(&mut bytes);
        let names = || vec!["a".to_owned()];
        assert_eq!(Track::read(names(), 3, &bytes).unwrap().0, track());
        for wrong in [4, usize::MAX, usize::MAX / 32] {
            assert!(Track::read(names(), wrong, &bytes).is_err());
            assert!(PalmPoint::read_all(wrong, &bytes).is_err());
        }
    }
}
