//! Lineage of an output, over all its partitions.

use std::collections::{BTreeMap, BTreeSet};

use dataflow::{NodeName, PartitionKey, RunRecord};
use serde::Serialize;

use super::{
    Direction,
    relations::Relations,
    tree::{Group, TreeNode},
};
use crate::outcome::CommandError;

/// One output in the lineage.
#[derive(Serialize)]
pub(super) struct Member {
    output: String,
    n_made: usize,
    n_skipped: usize,
    n_filtered: usize,
    reads: Vec<Read>,
    /// Number of files outside the lake that its units read.
    n_files: usize,
    #[serde(skip)]
    below: Vec<usize>,
}

/// The reads of an output's units from another output.
#[derive(Serialize)]
struct Read {
    output: String,
    n_partitions: usize,
}

/// The reads from each output, and from outside.
struct Reads {
    partitions: BTreeMap<NodeName, BTreeSet<PartitionKey>>,
    n_files: usize,
}

/// Lists the output and its ancestors or descendants, each once.
pub(super) fn family(
    run: &RunRecord,
    relations: &Relations,
    node: &NodeName,
    direction: Direction,
) -> Result<Vec<Member>, CommandError> {
    let mut all = BTreeMap::new();
    for record in &run.nodes {
        all.insert(record.node.clone(), reads(run, relations, &record.node)?);
    }
    let mut nodes = vec![node.clone()];
    let mut members: Vec<Member> = Vec::new();
    while let Some(node) = nodes.get(members.len()).cloned() {
        let mut member = member(run, &node, all.get(&node));
        let relatives: Vec<NodeName> = match direction {
            Direction::Up => {
                let reads = all.get(&node).into_iter();
                reads
                    .flat_map(|reads| reads.partitions.keys().cloned())
                    .collect()
            }
            Direction::Down => {
                let is_reader = |reader: &&NodeName| {
                    let reads = all.get(*reader);
                    reads.is_some_and(|reads| reads.partitions.contains_key(&node))
                };
                let readers = run.nodes.iter().map(|record| &record.node);
                readers.filter(is_reader).cloned().collect()
            }
        };
        for other in relatives {
            let known = nodes.iter().position(|known| *known == other);
            member.below.push(known.unwrap_or_else(|| {
                nodes.push(other);
                nodes.len() - 1
            }));
        }
        members.push(member);
    }
    Ok(members)
}

fn reads(run: &RunRecord, relations: &Relations, node: &NodeName) -> Result<Reads, CommandError> {
    let mut partitions: BTreeMap<NodeName, BTreeSet<PartitionKey>> = BTreeMap::new();
    let mut files = BTreeSet::new();
    let records = relations.records(node)?;
    for record in &records {
        for read in relations.reads(node, &record.fingerprint.inputs) {
            partitions
                .entry(read.node)
                .or_default()
                .extend(read.partitions);
        }
        let read = record.fingerprint.files.iter();
        files.extend(read.map(|(name, digest)| (name.clone(), *digest)));
    }
    // Without records, the wires are used.
    if records.is_empty()
        && let Some(stage) = run.stages.get(&node.stage)
    {
        let wired = stage.inputs.values().cloned();
        partitions.extend(wired.map(|source| (source, BTreeSet::new())));
    }
    Ok(Reads {
        partitions,
        n_files: files.len(),
    })
}

fn member(run: &RunRecord, node: &NodeName, reads: Option<&Reads>) -> Member {
    let record = run.nodes.iter().find(|record| record.node == *node);
    let count = |of: fn(&dataflow::NodeRecord) -> usize| record.map_or(0, of);
    let partitions = reads.into_iter().flat_map(|reads| &reads.partitions);
    let partitions = partitions.map(|(node, partitions)| Read {
        output: node.to_string(),
        n_partitions: partitions.len(),
    });
    Member {
        output: node.to_string(),
        n_made: count(|node| node.n_made),
        n_skipped: count(|node| node.n_skipped),
        n_filtered: count(|node| node.n_filtered),
        reads: partitions.collect(),
        n_files: reads.map_or(0, |reads| reads.n_files),
        below: Vec::new(),
    }
}

impl Member {
    /// Returns its node of the tree.
    pub(super) fn node(&self) -> TreeNode {
        let mut counts = vec![format!("{} made", self.n_made)];
        for (n, word) in [(self.n_skipped, "skipped"), (self.n_filtered, "filtered")] {
            if n > 0 {
                counts.push(format!("{n} {word}"));
            }
        }
        let files = match self.n_files {
            0 => String::new(),
            1 => "1 file outside".to_owned(),
            n => format!("{n} files outside"),
        };
        // Each by itself, so that none is cut.
        let groups = self.below.iter().map(|&member| Group {
            name: String::new(),
            members: vec![member],
        });
        TreeNode {
            cells: vec![self.output.clone(), counts.join(", "), files],
            groups: groups.collect(),
            leaves: Vec::new(),
        }
    }
}
