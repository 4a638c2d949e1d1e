//! The points of a goal's controllers as rows of numbers.

use motion::{JointPoint, JointRates, JointTrack, PalmPoint};
use spatial::Twist;

use crate::wire::{self, WireError};

/// Numbers of a palm's point: time, pose, velocity, acceleration.
const PALM_WIDTH: usize = 1 + 7 + 6 + 6;

/// Appends the points of a joint controller.
pub(crate) fn push_joints(points: &[JointPoint], bytes: &mut Vec<u8>) {
    for point in points {
        let rates = &point.rates;
        wire::push_numbers(bytes, [point.time_s]);
        let parts = [&point.q_rad, &rates.velocity, &rates.acceleration];
        wire::push_numbers(bytes, parts.into_iter().flatten().copied());
    }
}

/// Reads the points of a joint controller, one number per name; returns the remaining bytes.
pub(crate) fn read_joints(
    joints: Vec<String>,
    points_n: usize,
    bytes: &[u8],
) -> Result<(JointTrack, &[u8]), WireError> {
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
            rates: JointRates {
                velocity: velocity.to_vec(),
                acceleration: acceleration.to_vec(),
            },
        })
    };
    let points = rows.iter().enumerate().map(point);
    let points = points.collect::<Result<_, WireError>>()?;
    Ok((JointTrack { joints, points }, rest))
}

/// Appends the points of a free-flying palm.
pub(crate) fn push_palm(points: &[PalmPoint], bytes: &mut Vec<u8>) {
    for point in points {
        wire::push_numbers(bytes, [point.time_s]);
        wire::push_numbers(bytes, point.table_from_palm.to_array());
        wire::push_numbers(bytes, point.velocity.to_array());
        wire::push_numbers(bytes, point.acceleration.to_array());
    }
}

/// Reads the points of a free-flying palm; returns the remaining bytes.
pub(crate) fn read_palm(
    points_n: usize,
    bytes: &[u8],
) -> Result<(Vec<PalmPoint>, &[u8]), WireError> {
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
        Ok(PalmPoint {
            time_s,
            table_from_palm,
            velocity: twist(velocity).ok_or_else(short)?,
            acceleration: twist(acceleration).ok_or_else(short)?,
        })
    };
    let points = rows.iter().enumerate().map(point);
    Ok((points.collect::<Result<_, _>>()?, rest))
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
    use super::*;

    #[test]
    fn point_count_beyond_message_length_is_refused() {
        let point = |time_s: f64, q: f64, velocity: f64| JointPoint {
            time_s,
            q_rad: vec![q],
            rates: JointRates {
                velocity: vec![velocity],
                acceleration: vec![0.0],
            },
        };
        let track = JointTrack {
            joints: vec!["a".to_owned()],
            points: vec![
                point(0.0, 0.0, 0.0),
                point(1.0, 0.5, 1.0),
                point(2.0, 1.5, 1.0),
            ],
        };
        let mut bytes = Vec::new();
        push_joints(&track.points, &mut bytes);
        let names = || track.joints.clone();
        assert_eq!(read_joints(names(), 3, &bytes).unwrap().0, track);
        for wrong in [4, usize::MAX, usize::MAX / 32] {
            assert!(read_joints(names(), wrong, &bytes).is_err());
            assert!(read_palm(wrong, &bytes).is_err());
        }
    }
}
