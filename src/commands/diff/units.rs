//! The units of an output in two runs, with their records.

use std::collections::{BTreeMap, BTreeSet};

use dataflow::{Digest, NodeName, PartitionKey, Record, UnitRef};
use lake::{Lake, LakeError};

/// An output in one run: its units' fingerprints by partition.
type Fingerprints<'a> = BTreeMap<&'a PartitionKey, Digest>;

/// An output that two runs visited, with the records of its units.
pub(super) struct Pair {
    pub(super) node: NodeName,
    pub(super) old: Side,
    pub(super) new: Side,
}

/// An output in one run.
#[derive(Default)]
pub(super) struct Side {
    /// Records by partition.
    pub(super) records: BTreeMap<PartitionKey, Record>,
    /// Partitions whose records are no longer in the lake, with their fingerprints.
    pub(super) lost: BTreeMap<PartitionKey, Digest>,
}

impl Side {
    fn read(lake: &Lake, fingerprints: &Fingerprints) -> Result<Self, LakeError> {
        let mut side = Self::default();
        for (&partition, fingerprint) in fingerprints {
            match lake.record(fingerprint)? {
                Some(record) => {
                    side.records.insert(partition.clone(), record);
                }
                None => {
                    side.lost.insert(partition.clone(), *fingerprint);
                }
            }
        }
        Ok(side)
    }

    /// The existing partitions: made ones, and those without a record.
    pub(super) fn partitions(&self) -> BTreeSet<&PartitionKey> {
        let made = self.records.iter();
        let made = made.filter(|(_, record)| record.outcome.is_made());
        let made = made.map(|(partition, _)| partition);
        made.chain(self.lost.keys()).collect()
    }

    /// The identity of a partition: its artifact's digest, or the fingerprint if its record is
    /// lost.
    pub(super) fn content(&self, partition: &PartitionKey) -> Option<Digest> {
        match self.records.get(partition) {
            Some(record) => record.outcome.artifact_digest(),
            None => self.lost.get(partition).copied(),
        }
    }
}

/// Reads the records of the outputs that both runs visited and that differ.
pub(super) fn pairs(lake: &Lake, old: &[UnitRef], new: &[UnitRef]) -> Result<Vec<Pair>, LakeError> {
    let (old, new) = (by_node(old), by_node(new));
    let mut pairs = Vec::new();
    for (node, after) in &new {
        if let Some(before) = old.get(node)
            && before != after
        {
            pairs.push(Pair {
                node: (*node).clone(),
                old: Side::read(lake, before)?,
                new: Side::read(lake, after)?,
            });
        }
    }
    Ok(pairs)
}

fn by_node(units: &[UnitRef]) -> BTreeMap<&NodeName, Fingerprints<'_>> {
    let mut nodes: BTreeMap<&NodeName, Fingerprints> = BTreeMap::new();
    for unit in units {
        let fingerprints = nodes.entry(&unit.node).or_default();
        fingerprints.insert(&unit.partition, unit.fingerprint);
    }
    nodes
}
