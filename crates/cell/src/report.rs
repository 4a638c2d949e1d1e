//! A cell's report on a goal.

use robot::{Joint, JointOrder, WrongDof};
use schemas::executions::Outcome;
use serde::{Deserialize, Serialize};
use spatial::{Object, Palm, Pose, Table};

use crate::{
    Goal, Rejection,
    contradiction::{self, Contradiction},
    text::plain_line,
    wire::{self, WireError},
};

/// Numbers of a pose.
const POSE: usize = 7;

/// A trusted report on a goal: made by [`UncheckedReport::check`], or where nothing has moved.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Report {
    /// The goal's id.
    pub goal_id: String,
    /// Why the cell refused the goal, if it did.
    pub rejection: Option<Rejection>,
    /// The outcome.
    pub outcome: Outcome,
    /// The cell's message.
    pub message: String,
    /// Rise of the object at the end, in meters.
    pub lift_m: f64,
    /// Names of the joints, in the order of the samples' positions.
    pub joints: Vec<String>,
    /// The measurements in time order; empty if nothing moved.
    pub samples: Vec<Sample>,
}

/// A report as received: not to be used before it is checked against its goal.
#[derive(Debug, Clone, PartialEq)]
pub struct UncheckedReport(Report);

/// A cell's measurement at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Seconds since the goal's first row was due; negative on the way to it.
    pub time_s: f64,
    /// Pose of the palm.
    pub table_from_palm: Pose<Table, Palm>,
    /// Pose of the object.
    pub table_from_object: Pose<Table, Object>,
    /// Joint positions in radians.
    pub q_rad: Vec<f64>,
    /// Commanded joint positions in radians.
    pub q_command_rad: Vec<f64>,
}

/// End of a motion: outcome, reason and lift.
#[derive(Debug, Clone, PartialEq)]
pub struct Ending {
    /// The outcome.
    pub outcome: Outcome,
    /// The reason, for people.
    pub message: String,
    /// Rise of the object from the first to the last sample, in meters.
    pub lift_m: f64,
}

/// First line of a report; its samples follow.
#[derive(Debug, Serialize, Deserialize)]
struct Header {
    goal_id: String,
    outcome: String,
    message: String,
    lift_m: f64,
    joints: Vec<String>,
    /// Number of samples that follow; not in reports of version 4.
    #[serde(default)]
    samples_n: Option<usize>,
}

impl Header {
    fn outcome(&self) -> Result<Outcome, WireError> {
        Outcome::parse(&self.outcome).ok_or_else(|| WireError::Json {
            part: "report",
            message: format!("`{}` is not an outcome", plain_line(&self.outcome)),
        })
    }
}

impl Ending {
    /// Parses the first line of a report.
    pub(crate) fn read(bytes: &[u8]) -> Option<Self> {
        let (header, _): (Header, _) = wire::split_line("report", bytes).ok()?;
        Some(Self {
            outcome: Outcome::parse(&header.outcome)?,
            message: plain_line(&header.message),
            lift_m: header.lift_m,
        })
    }

    /// Returns the ending of a goal whose report the cell has lost.
    pub(crate) fn lost() -> Self {
        Self {
            outcome: Outcome::Unknown,
            message: "the cell has lost its report on this motion".to_owned(),
            lift_m: 0.0,
        }
    }
}

impl Sample {
    /// Returns the number of values in a sample of `dof` joints.
    pub(crate) fn width(dof: usize) -> usize {
        1 + 2 * POSE + 2 * dof
    }

    /// Returns the sample as one row: time, palm, object, positions, commands.
    pub(crate) fn to_row(&self) -> Vec<f64> {
        let mut row = vec![self.time_s];
        row.extend(self.table_from_palm.to_array());
        row.extend(self.table_from_object.to_array());
        row.extend(&self.q_rad);
        row.extend(&self.q_command_rad);
        row
    }

    /// Returns the sample with its positions in another joint order.
    ///
    /// # Errors
    ///
    /// Fails unless it has one position for each joint.
    pub fn in_order(self, order: &JointOrder) -> Result<Self, WrongDof> {
        Ok(Self {
            q_rad: order.apply(&self.q_rad)?,
            q_command_rad: order.apply(&self.q_command_rad)?,
            ..self
        })
    }

    pub(crate) fn from_row(row: usize, numbers: &[f64], dof: usize) -> Result<Self, WireError> {
        let short = || WireError::Row {
            row,
            message: format!("{} numbers for {dof} joints", numbers.len()),
        };
        let (&time_s, rest) = numbers.split_first().ok_or_else(short)?;
        let (table_from_palm, rest) = wire::pose(row, rest)?;
        let (table_from_object, rest) = wire::pose(row, rest)?;
        let (q_rad, q_command_rad) = rest.split_at_checked(dof).ok_or_else(short)?;
        Ok(Self {
            time_s,
            table_from_palm,
            table_from_object,
            q_rad: q_rad.to_vec(),
            q_command_rad: q_command_rad.to_vec(),
        })
    }
}

impl Report {
    /// Returns the report on a goal with an unknown outcome.
    pub(crate) fn unknown(goal_id: &str, message: String) -> Self {
        Self::without_motion(goal_id, Outcome::Unknown, message, None)
    }

    /// Returns the report on a goal that the cell refused.
    pub(crate) fn rejected(goal_id: &str, rejection: Rejection) -> Self {
        let message = rejection.reason.clone();
        Self::without_motion(goal_id, Outcome::Rejected, message, Some(rejection))
    }

    /// Returns the report on an accepted goal that the cell did not execute.
    pub(crate) fn aborted(goal_id: &str, message: String) -> Self {
        Self::without_motion(goal_id, Outcome::Aborted, message, None)
    }

    /// Returns the report on a goal that was executed, as far as `ending` says: `joints` are the
    /// goal's, in its order, and so are the samples' positions.
    pub fn of_motion(
        goal_id: &str,
        joints: Vec<String>,
        ending: Ending,
        samples: Vec<Sample>,
    ) -> Self {
        Self {
            outcome: ending.outcome,
            message: ending.message,
            lift_m: ending.lift_m,
            joints,
            samples,
            ..Self::without_motion(goal_id, ending.outcome, String::new(), None)
        }
    }

    fn without_motion(
        goal_id: &str,
        outcome: Outcome,
        message: String,
        rejection: Option<Rejection>,
    ) -> Self {
        Self {
            goal_id: goal_id.to_owned(),
            rejection,
            outcome,
            message,
            lift_m: 0.0,
            joints: Vec::new(),
            samples: Vec::new(),
        }
    }

    /// Parses a report that was believed when it was recorded.
    ///
    /// # Errors
    ///
    /// Fails if the bytes are not a report.
    pub fn from_record(bytes: &[u8]) -> Result<Self, WireError> {
        UncheckedReport::from_bytes(bytes).map(|UncheckedReport(report)| report)
    }

    /// Returns the duration of the motion, in seconds.
    pub fn duration_s(&self) -> f64 {
        self.samples.last().map_or(0.0, |sample| sample.time_s)
    }

    /// Returns the largest difference of a joint's position from its command, in radians.
    pub fn tracking_error_rad(&self) -> f64 {
        self.samples
            .iter()
            .flat_map(|sample| sample.q_rad.iter().zip(&sample.q_command_rad))
            .map(|(q, command)| (q - command).abs())
            .fold(0.0, f64::max)
    }

    /// Serializes the report's first line.
    pub(crate) fn to_line(&self) -> Vec<u8> {
        wire::line(&Header {
            goal_id: self.goal_id.clone(),
            outcome: self.outcome.as_str().to_owned(),
            message: self.message.clone(),
            lift_m: self.lift_m,
            joints: self.joints.clone(),
            samples_n: Some(self.samples.len()),
        })
    }

    /// Serializes the report.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = self.to_line();
        for sample in &self.samples {
            wire::push_numbers(&mut bytes, sample.to_row());
        }
        bytes
    }
}

impl UncheckedReport {
    /// Parses a report.
    ///
    /// # Errors
    ///
    /// Fails if the bytes are not a report.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, WireError> {
        let (header, numbers): (Header, &[u8]) = wire::split_line("report", bytes)?;
        let outcome = header.outcome()?;
        let dof = header.joints.len();
        let samples = wire::rows(numbers, Sample::width(dof))?
            .iter()
            .enumerate()
            .map(|(row, numbers)| Sample::from_row(row, numbers, dof))
            .collect::<Result<Vec<_>, WireError>>()?;
        if let Some(told) = header.samples_n.filter(|told| *told != samples.len()) {
            return Err(WireError::Json {
                part: "report",
                message: format!("it announces {told} samples and has {}", samples.len()),
            });
        }
        Ok(Self(Report {
            goal_id: header.goal_id,
            rejection: None,
            outcome,
            message: plain_line(&header.message),
            lift_m: header.lift_m,
            joints: header.joints,
            samples,
        }))
    }

    /// Parses the first line of a report whose samples did not arrive: the outcome is the cell's own word,
    /// which no sample confirms, and the message says so.
    ///
    /// # Errors
    ///
    /// Fails if the line is not that of a report on this goal, or its samples are no more than `most` bytes:
    /// those should have arrived.
    pub(crate) fn without_samples(
        bytes: &[u8],
        goal_id: &str,
        most: usize,
    ) -> Result<Report, WireError> {
        let wrong = |message: String| WireError::Json {
            part: "report",
            message,
        };
        let (header, _): (Header, _) = wire::split_line("report", bytes)?;
        let outcome = header.outcome()?;
        if header.goal_id != goal_id {
            let found = plain_line(&header.goal_id);
            return Err(wrong(format!("it is about goal `{found}`")));
        }
        let row = Sample::width(header.joints.len()) * size_of::<f64>();
        let size = match header
            .samples_n
            .map(|samples_n| samples_n.saturating_mul(row))
        {
            Some(bytes) if bytes <= most => {
                return Err(wrong(format!("its samples, {bytes} bytes, do not arrive")));
            }
            Some(bytes) => format!("of {} MB ", bytes / 1_000_000),
            None => String::new(),
        };
        let message = format!(
            "{} (its report {size}was not read, so no sample confirms it: the longest has {} MiB)",
            plain_line(&header.message),
            most >> 20
        );
        let ending = Ending {
            outcome,
            message,
            lift_m: header.lift_m,
        };
        Ok(Report::of_motion(goal_id, Vec::new(), ending, Vec::new()))
    }

    /// Checks the report against its goal, itself, and the robot, whose joints have the goal's names.
    ///
    /// The id is the one that the goal was sent under: a goal that was parsed may encode to another, since a parsed
    /// quaternion is normalized.
    ///
    /// # Errors
    ///
    /// Fails with the contradiction: the goal's outcome is then unknown.
    pub fn check(
        self,
        goal_id: &str,
        goal: &Goal,
        robot: &[Joint],
    ) -> Result<Report, Contradiction> {
        contradiction::check(&self.0, goal_id, goal, robot)?;
        Ok(self.0)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Vector3};

    use super::*;

    #[test]
    fn a_report_arrives_to_the_last_bit() {
        let sample = |time_s: f64| Sample {
            time_s,
            table_from_palm: Pose::new(Isometry3::new(Vector3::x() / 3.0, Vector3::y() / 7.0)),
            table_from_object: Pose::new(Isometry3::new(Vector3::y() * time_s, Vector3::zeros())),
            q_rad: vec![0.1, time_s / 3.0],
            q_command_rad: vec![0.15, time_s],
        };
        let report = Report {
            goal_id: "00ff".to_owned(),
            rejection: None,
            outcome: Outcome::Failed,
            message: "dropped".to_owned(),
            lift_m: 0.1 + 0.2,
            joints: vec!["a".to_owned(), "b".to_owned()],
            samples: vec![sample(0.0), sample(0.1), sample(0.3)],
        };
        let bytes = report.to_bytes();
        let UncheckedReport(again) = UncheckedReport::from_bytes(&bytes).unwrap();
        assert_eq!(again.to_bytes(), bytes);
        assert_eq!(again.samples.len(), 3);
        assert!((again.tracking_error_rad() - 0.2).abs() < 1e-12);
        assert!(UncheckedReport::from_bytes(&bytes[..bytes.len() - 1]).is_err());
        // A row is missing, or one that nobody announced is there.
        let row = 8 * Sample::width(2);
        assert!(UncheckedReport::from_bytes(&bytes[..bytes.len() - row]).is_err());
        let twice = [&bytes[..], &bytes[bytes.len() - row..]].concat();
        assert!(UncheckedReport::from_bytes(&twice).is_err());
        let mut reader = blake3::Hasher::new().update(b"reports").finalize_xof();
        for _ in 0..2000 {
            let mut bits = [0; 8];
            reader.fill(&mut bits);
            let lift_m = f64::from_le_bytes(bits);
            if lift_m.is_finite() {
                let report = Report {
                    lift_m,
                    ..report.clone()
                };
                let again = UncheckedReport::from_bytes(&report.to_bytes()).unwrap();
                assert_eq!(again.0.lift_m.to_bits(), lift_m.to_bits());
            }
        }
    }
}
