//! A cell's published measurements.

use std::sync::Arc;

use crate::{
    report::Sample,
    wire::{self, StateHeader, WireError},
};

/// One sample of a cell's stream.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Name of the stream: a restarted cell begins another.
    pub epoch: String,
    /// Number of the sample in the stream, from 0.
    pub seq: u64,
    /// The goal being executed; empty if nothing moves.
    pub goal_id: String,
    /// Names of the joints, in the order of the sample's positions.
    pub joints: Arc<[String]>,
    /// The latest measurement.
    pub sample: Sample,
}

/// Consecutive samples.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct States {
    pub(crate) header: StateHeader,
    pub(crate) states: Vec<State>,
}

impl State {
    /// Parses published samples, one or several consecutive ones.
    ///
    /// # Errors
    ///
    /// Fails if the bytes are not samples.
    pub fn from_bytes(bytes: &[u8]) -> Result<Vec<Self>, WireError> {
        Ok(States::from_bytes(bytes)?.states)
    }
}

impl States {
    pub(crate) fn from_bytes(bytes: &[u8]) -> Result<Self, WireError> {
        let (header, numbers): (StateHeader, _) = wire::split_line("state", bytes)?;
        let joints: Arc<[String]> = header.joints.clone().into();
        let dof = joints.len();
        let rows = wire::rows(numbers, Sample::width(dof))?;
        let states = rows
            .iter()
            .enumerate()
            .map(|(row, numbers)| {
                let seq = header.seq.checked_add(row as u64);
                Ok(State {
                    epoch: header.epoch.clone(),
                    // The count must not overflow.
                    seq: seq
                        .filter(|&seq| seq < u64::MAX)
                        .ok_or_else(|| WireError::Row {
                            row,
                            message: "its number is too large".to_owned(),
                        })?,
                    goal_id: header.goal_id.clone(),
                    joints: Arc::clone(&joints),
                    sample: Sample::from_row(row, numbers, dof)?,
                })
            })
            .collect::<Result<_, WireError>>()?;
        Ok(Self { header, states })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn history_rows_are_numbered_consecutively() {
        let bytes = |seq: u64, rows: usize| {
            let mut bytes = wire::line(&StateHeader {
                epoch: "e".to_owned(),
                goal_id: String::new(),
                seq,
                joints: vec!["a".to_owned()],
            });
            let mut row = [0.0; 17];
            (row[7], row[14], row[15]) = (1.0, 1.0, 0.5);
            (0..rows).for_each(|_| wire::push_numbers(&mut bytes, row));
            bytes
        };
        let states = State::from_bytes(&bytes(5, 2)).unwrap();
        assert_eq!(states.iter().map(|s| s.seq).collect::<Vec<_>>(), [5, 6]);
        assert_eq!(states[1].sample.q_rad, [0.5]);
        assert!(State::from_bytes(&bytes(5, 0)).unwrap().is_empty());
        let cut = bytes(5, 2);
        assert!(State::from_bytes(&cut[..cut.len() - 1]).is_err());
        assert!(State::from_bytes(&bytes(u64::MAX - 1, 2)).is_err());
    }
}
