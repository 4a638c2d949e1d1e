//! The order in which the outputs of a pipeline are made.

use super::StageEntry;
use crate::{error::Problem, graph::Node, name::NodeName};

/// Orders the stages so that each comes after what it reads, and lists their outputs.
///
/// Stages that do not depend on each other keep the order of the file.
pub(super) fn order(stages: &[StageEntry]) -> Result<Vec<Node>, Problem> {
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
        for (output_idx, output) in stage.kind.outputs.iter().enumerate() {
            let name = NodeName::new(&stage.name, output.artifact);
            nodes.push(Node {
                name: name.clone(),
                stage_idx: idx,
                output_idx,
                output: *output,
                reads: reads.clone(),
            });
            reads.insert(output.artifact.to_owned(), name);
        }
    }
    Ok(nodes)
}
