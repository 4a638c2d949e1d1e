//! The graph of a pipeline: one node per output of a stage, in the order in which they are made.

use std::{collections::BTreeMap, fmt};

use serde::{Deserialize, Serialize};

use crate::{error::Problem, output::OutputInfo, pipeline::StageEntry};

/// One output of one stage, written `stage.artifact`.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct NodeName {
    /// The stage's name in the pipeline file.
    pub stage: String,
    /// The artifact's name.
    pub artifact: String,
}

impl NodeName {
    /// Names an output.
    pub fn new(stage: impl Into<String>, artifact: impl Into<String>) -> Self {
        Self {
            stage: stage.into(),
            artifact: artifact.into(),
        }
    }

    /// Reads `stage.artifact`.
    pub fn parse(text: &str) -> Option<Self> {
        let (stage, artifact) = text.split_once('.')?;
        let is_name = |word: &str| !word.is_empty() && !word.contains('.');
        (is_name(stage) && is_name(artifact)).then(|| Self::new(stage, artifact))
    }
}

impl fmt::Display for NodeName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.stage, self.artifact)
    }
}

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
    pub reads: BTreeMap<String, NodeName>,
}

/// Orders the stages so that each comes after what it reads, and lists their outputs.
///
/// Stages that do not depend on each other keep the order of the file.
pub(crate) fn order(stages: &[StageEntry]) -> Result<Vec<Node>, Problem> {
    let mut nodes = Vec::new();
    let mut placed = vec![false; stages.len()];
    while placed.contains(&false) {
        let next = stages.iter().enumerate().position(|(idx, stage)| {
            !placed[idx]
                && stage.inputs.values().all(|source| {
                    stages
                        .iter()
                        .position(|other| other.name == source.stage)
                        .is_some_and(|other| placed[other])
                })
        });
        let Some(idx) = next else {
            let cycle: Vec<&str> = stages
                .iter()
                .zip(&placed)
                .filter(|(_, placed)| !**placed)
                .map(|(stage, _)| stage.name.as_str())
                .collect();
            return Err(Problem::new(format!(
                "stages read each other in a circle: {}",
                cycle.join(", ")
            )));
        };
        placed[idx] = true;
        let stage = &stages[idx];
        let mut reads = stage.inputs.clone();
        for (output_idx, output) in stage.kind.outputs().into_iter().enumerate() {
            let name = NodeName::new(&stage.name, output.artifact);
            nodes.push(Node {
                name: name.clone(),
                stage_idx: idx,
                output_idx,
                output,
                reads: reads.clone(),
            });
            reads.insert(output.artifact.to_owned(), name);
        }
    }
    Ok(nodes)
}
