//! The reads between units of a run.

use std::collections::{BTreeMap, BTreeSet};

use dataflow::{
    ArtifactName, Digest, NodeName, PartitionKey, Record, RunRecord, UnitName, UnitRef,
};
use lake::{Lake, LakeError};
use serde::Serialize;

/// The readers of a partition.
type Readers = BTreeMap<UnitName, BTreeSet<UnitName>>;

/// Partitions of an output, by output.
type ByOutput = Vec<(NodeName, Vec<PartitionKey>)>;

/// The partitions that a unit reads through one input.
#[derive(Serialize)]
pub(super) struct Read {
    input: ArtifactName,
    #[serde(rename = "output", serialize_with = "as_text")]
    pub(super) node: NodeName,
    pub(super) partitions: Vec<PartitionKey>,
}

fn as_text<S: serde::Serializer>(node: &NodeName, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(node)
}

/// The units of a run, and their readers.
pub(super) struct Relations<'a> {
    lake: &'a Lake,
    run: &'a RunRecord,
    units: BTreeMap<UnitName, &'a UnitRef>,
    /// The readers of each partition; computed on first use.
    readers: Option<Readers>,
}

impl<'a> Relations<'a> {
    pub(super) fn new(lake: &'a Lake, run: &'a RunRecord) -> Self {
        let units = run.units.iter();
        let units = units.map(|unit| (UnitName::new(&unit.node, &unit.partition), unit));
        Self {
            lake,
            run,
            units: units.collect(),
            readers: None,
        }
    }

    /// Returns the fingerprint that a partition has in the run.
    pub(super) fn fingerprint(&self, unit: &UnitName) -> Option<Digest> {
        self.units.get(unit).map(|unit| unit.fingerprint)
    }

    /// Returns the output that a stage reads through an input: the one that is wired to it, or an
    /// output of its own.
    pub(super) fn source(&self, node: &NodeName, input: &ArtifactName) -> NodeName {
        let stage = self.run.stages.get(&node.stage);
        let wired = stage.and_then(|stage| stage.inputs.get(input));
        wired.cloned().unwrap_or_else(|| NodeName {
            stage: node.stage.clone(),
            artifact: input.clone(),
        })
    }

    /// Returns the reads of a unit, by input.
    pub(super) fn reads(
        &self,
        node: &NodeName,
        inputs: &BTreeMap<ArtifactName, BTreeMap<PartitionKey, Digest>>,
    ) -> Vec<Read> {
        let reads = inputs.iter().map(|(input, partitions)| Read {
            input: input.clone(),
            node: self.source(node, input),
            partitions: partitions.keys().cloned().collect(),
        });
        reads.filter(|read| !read.partitions.is_empty()).collect()
    }

    /// Returns the units that read a partition, by output.
    pub(super) fn readers(&mut self, unit: &UnitName) -> Result<ByOutput, LakeError> {
        if self.readers.is_none() {
            self.readers = Some(self.find_readers()?);
        }
        let readers = self.readers.as_ref();
        let readers = readers.and_then(|all| all.get(unit));
        let mut by_output: BTreeMap<NodeName, Vec<PartitionKey>> = BTreeMap::new();
        for UnitName { node, partition } in readers.into_iter().flatten().cloned() {
            by_output.entry(node).or_default().push(partition);
        }
        Ok(by_output.into_iter().collect())
    }

    fn find_readers(&self) -> Result<Readers, LakeError> {
        let mut readers = Readers::new();
        for unit in &self.run.units {
            let Some(record) = self.lake.record(&unit.fingerprint)? else {
                continue;
            };
            for read in self.reads(&unit.node, &record.fingerprint.inputs) {
                for partition in read.partitions {
                    let read = UnitName::new(&read.node, &partition);
                    let readers = readers.entry(read).or_default();
                    readers.insert(UnitName::new(&unit.node, &unit.partition));
                }
            }
        }
        Ok(readers)
    }

    /// Returns the records of an output's units.
    pub(super) fn records(&self, node: &NodeName) -> Result<Vec<Record>, LakeError> {
        let units = self.run.units.iter().filter(|unit| unit.node == *node);
        let mut records = Vec::new();
        for unit in units {
            records.extend(self.lake.record(&unit.fingerprint)?);
        }
        Ok(records)
    }
}
