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
    /// Metadata of the artifact that it makes.
    pub output: OutputInfo,
    /// Source of each input: the wired output, or an earlier output of the same stage.
    pub reads: BTreeMap<ArtifactName, NodeName>,
}
