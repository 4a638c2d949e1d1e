//! The graph of a pipeline: one node per output of a stage, in the order in which they are made.

use std::collections::BTreeMap;

use crate::{
    name::{ArtifactName, NodeName},
    output::OutputInfo,
};

/// A node of the graph.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Node {
    /// Its name.
    pub name: NodeName,
    /// Position of its stage in [`crate::Pipeline::stages`].
    pub(crate) stage_idx: usize,
    /// Position of its output in [`crate::Kind::outputs`].
    pub(crate) output_idx: usize,
    /// What it makes.
    pub output: OutputInfo,
    /// Where each input comes from: wired ones, and earlier outputs of the same stage.
    pub reads: BTreeMap<ArtifactName, NodeName>,
}
