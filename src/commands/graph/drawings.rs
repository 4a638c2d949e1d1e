//! The graph as Graphviz and Mermaid.

use std::collections::BTreeSet;

use dataflow::{Node, NodeName};

use super::Graph;

/// Writes the graph in Graphviz's language: a box per stage, a node per output.
pub(super) fn dot(graph: &Graph) -> String {
    let mut text = format!(
        "digraph {} {{\n    rankdir = LR;\n    node [shape = box];\n",
        quoted(&graph.pipeline.name)
    );
    for stage in &graph.pipeline.stages {
        let name = quoted(&format!("cluster_{}", stage.name));
        text.push_str(&format!(
            "    subgraph {name} {{\n        label = {};\n",
            quoted(stage.name.as_str())
        ));
        for node in graph.outputs_of(&stage.name) {
            let label = format!("{}\n{}", node.name.artifact, graph.partitions(node));
            text.push_str(&format!(
                "        {} [label = {}];\n",
                quoted(&node.name.to_string()),
                quoted(&label)
            ));
        }
        text.push_str("    }\n");
    }
    for (from, to) in edges(graph) {
        text.push_str(&format!(
            "    {} -> {};\n",
            quoted(&from.to_string()),
            quoted(&to.to_string())
        ));
    }
    text.push_str("}\n");
    text
}

/// Text quoted for Graphviz, with its line breaks.
fn quoted(text: &str) -> String {
    let escaped = text.replace('\\', "\\\\").replace('"', "\\\"");
    format!("\"{}\"", escaped.replace('\n', "\\n"))
}

/// Writes the graph in Mermaid's language. Nodes are numbered: only labels may hold any text.
pub(super) fn mermaid(graph: &Graph) -> String {
    let number = |name: &NodeName| {
        let mut nodes = graph.pipeline.nodes.iter();
        nodes.position(|node| node.name == *name).unwrap_or(0)
    };
    let mut text = "flowchart LR\n".to_owned();
    for (idx, stage) in graph.pipeline.stages.iter().enumerate() {
        text.push_str(&format!(
            "    subgraph s{idx}[{}]\n",
            label(stage.name.as_str())
        ));
        for node in graph.outputs_of(&stage.name) {
            let words = format!("{}<br/>{}", node.name.artifact, graph.partitions(node));
            text.push_str(&format!(
                "        n{}[{}]\n",
                number(&node.name),
                label(&words)
            ));
        }
        text.push_str("    end\n");
    }
    for (from, to) in edges(graph) {
        text.push_str(&format!("    n{} --> n{}\n", number(from), number(to)));
    }
    text
}

/// Text quoted for Mermaid.
fn label(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "#quot;"))
}

/// Every pair of an output and one that reads it, once.
fn edges<'g>(graph: &'g Graph) -> BTreeSet<(&'g NodeName, &'g NodeName)> {
    let pairs = |node: &'g Node| {
        let sources = node.reads.values();
        sources.map(move |source| (source, &node.name))
    };
    graph.pipeline.nodes.iter().flat_map(pairs).collect()
}
