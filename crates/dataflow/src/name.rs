//! Names of outputs and of units.

use std::fmt;

use serde::{Deserialize, Serialize};

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

/// One partition of one output.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UnitName {
    /// The output.
    pub node: NodeName,
    /// The partition's key.
    pub partition: String,
}

impl UnitName {
    /// Names a unit.
    pub fn new(node: &NodeName, partition: &str) -> Self {
        Self {
            node: node.clone(),
            partition: partition.to_owned(),
        }
    }
}

impl fmt::Display for UnitName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} `{}`", self.node, self.partition)
    }
}
