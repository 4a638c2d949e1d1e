//! The graph as a list of stages in layers.

use std::collections::{BTreeMap, BTreeSet};

use dataflow::StageName;

use super::Graph;

/// Lists the stages in layers: each reads only layers above its own.
pub(super) fn text(graph: &Graph) -> String {
    let names = graph
        .pipeline
        .nodes
        .iter()
        .map(|node| node.name.to_string());
    let width = names.map(|name| name.chars().count()).max().unwrap_or(0);
    let mut text = String::new();
    for (depth, stages) in layers(graph) {
        if depth > 0 {
            text.push_str("  │\n  ▼\n");
        }
        for stage in stages {
            text.push_str(&stage_lines(graph, stage, width));
        }
    }
    text
}

fn stage_lines(graph: &Graph, stage: &StageName, width: usize) -> String {
    let entry = graph.pipeline.find(stage.as_str());
    let kind = entry.map_or("", |entry| entry.kind.name);
    let mut text = if *stage == *kind {
        format!("{stage}\n")
    } else {
        format!("{stage} ({kind})\n")
    };
    let sources: BTreeSet<String> = entry
        .into_iter()
        .flat_map(|entry| entry.inputs.values())
        .map(ToString::to_string)
        .collect();
    let sources: Vec<String> = sources.into_iter().collect();
    if !sources.is_empty() {
        text.push_str(&format!("  reads  {}\n", sources.join(", ")));
    }
    for node in graph.outputs_of(stage) {
        // Inputs from earlier outputs of the same stage.
        let own: Vec<&str> = node
            .reads
            .values()
            .filter(|source| source.stage == *stage)
            .map(|source| source.artifact.as_str())
            .collect();
        let own = if own.is_empty() {
            String::new()
        } else {
            format!(", from its {}", own.join(", "))
        };
        text.push_str(&format!(
            "  makes  {:width$}  {}{own}\n",
            node.name.to_string(),
            graph.partitions(node),
        ));
    }
    text
}

/// The stages by the length of the longest path to them.
fn layers<'g>(graph: &'g Graph) -> BTreeMap<usize, Vec<&'g StageName>> {
    let mut depths: BTreeMap<&StageName, usize> = BTreeMap::new();
    let mut layers: BTreeMap<usize, Vec<&StageName>> = BTreeMap::new();
    // The outputs are ordered, so that what a stage reads has come before it.
    for node in &graph.pipeline.nodes {
        let stage = &node.name.stage;
        if depths.contains_key(stage) {
            continue;
        }
        let above = node
            .reads
            .values()
            .filter_map(|source| depths.get(&source.stage));
        let depth = above.max().map_or(0, |above| above + 1);
        depths.insert(stage, depth);
        layers.entry(depth).or_default().push(stage);
    }
    layers
}
