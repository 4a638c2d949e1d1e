//! A tree of configurations, each joined to its parent by a free edge.

use crate::configuration::{Configuration, Metric};

/// A tree of configurations.
#[derive(Debug, Clone)]
pub(crate) struct Tree {
    nodes: Vec<Configuration>,
    /// The parent of each node; the root's own is itself.
    parents: Vec<usize>,
}

impl Tree {
    /// Returns a tree of a root alone.
    pub(crate) fn new(root: Configuration) -> Self {
        Self {
            nodes: vec![root],
            parents: vec![0],
        }
    }

    /// Returns the number of nodes.
    pub(crate) fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Returns the root.
    pub(crate) fn root(&self) -> &Configuration {
        &self.nodes[0]
    }

    /// Returns a node by its number.
    pub(crate) fn node(&self, number: usize) -> &Configuration {
        &self.nodes[number]
    }

    /// Adds a node; returns its number.
    pub(crate) fn add(&mut self, node: Configuration, parent: usize) -> usize {
        self.nodes.push(node);
        self.parents.push(parent);
        self.nodes.len() - 1
    }

    /// Returns the number of the node that is nearest to a configuration, the first of several.
    pub(crate) fn nearest(&self, to: &Configuration, metric: &Metric) -> usize {
        let mut nearest = (0, f64::INFINITY);
        for (number, node) in self.nodes.iter().enumerate() {
            let squared = metric.squared(node, to);
            if squared < nearest.1 {
                nearest = (number, squared);
            }
        }
        nearest.0
    }

    /// Returns the way from the root to a node.
    pub(crate) fn way_to(&self, node: usize) -> Vec<Configuration> {
        let mut way = vec![self.nodes[node].clone()];
        let mut at = node;
        while at != 0 {
            at = self.parents[at];
            way.push(self.nodes[at].clone());
        }
        way.reverse();
        way
    }
}
