//! What a cell measured, as it is published.

use std::sync::Arc;

use crate::{
    report::Sample,
    wire::{self, StateHeader, WireError},
};

/// One sample of a cell's stream.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Name of the stream: a cell that is started again begins another.
    pub epoch: String,
    /// Number of the sample in the stream, from 0.
    pub seq: u64,
    /// The goal being executed; empty if nothing moves.
    pub goal_id: String,
    /// Names of the joints, in the order of the sample's positions.
    pub joints: Arc<[String]>,
    /// What was measured last.
    pub sample: Sample,
}

/// Samples that follow each other.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct States {
    pub(crate) header: StateHeader,
    pub(crate) states: Vec<State>,
}

impl State {
    /// Reads samples as a cell publishes them, one or several that follow each other.
    ///
    /// # Errors
    ///
    /// Fails if the bytes are none.
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
        let states = rows.iter().zip(header.seq..).enumerate();
        let states = states
            .map(|(row, (numbers, seq))| {
                Ok(State {
                    epoch: header.epoch.clone(),
                    seq,
                    goal_id: header.goal_id.clone(),
                    joints: Arc::clone(&joints),
                    sample: Sample::from_row(row, numbers, dof)?,
                })
            })
            .collect::<Result<_, WireError>>()?;
        Ok(Self { header, states })
    }
}
