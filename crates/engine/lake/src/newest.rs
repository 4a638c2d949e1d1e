//! The newest state of a pipeline: one small file for all its units.
//!
//! It is a cache: all of it can be recomputed from records, blobs and published files, at the price
//! of reading them.

mod format;

use std::{
    collections::{BTreeMap, BTreeSet, HashMap, HashSet},
    path::PathBuf,
    sync::Arc,
};

use dataflow::{Digest, NewestUnit, NodeName, PartitionKey, RecordOutcome, Stamp, UnitRef};

use crate::folder::Folder;

/// Extension of the files in it.
const ENDING: &str = ".cache";

/// The newest state of a pipeline.
#[derive(Default)]
pub(crate) struct Newest {
    units: BTreeMap<NodeName, BTreeMap<PartitionKey, NewestOf>>,
    outcomes: HashMap<Digest, Arc<RecordOutcome>>,
    /// Fingerprints of units that the newest runs still had, when this was read.
    current: HashSet<Digest>,
    /// The published files of each node, as far as known.
    pub(crate) published: BTreeMap<NodeName, PublishedFiles>,
    /// Nodes whose published files this process has changed.
    published_now: BTreeSet<NodeName>,
    /// Nodes no longer in the pipeline.
    retired: BTreeSet<NodeName>,
    /// Stamps of whole blobs, as they were read.
    pub(crate) stamps: Vec<(Digest, Stamp)>,
    /// Stamps of whole records of units, as they were read.
    pub(crate) records: Vec<(Digest, Stamp)>,
}

/// The newest state of a unit.
#[derive(Clone, Copy)]
struct NewestOf {
    fingerprint: Digest,
    current: bool,
}

/// The published files of a node, by path below the lake.
pub(crate) type PublishedFiles = BTreeMap<String, PublishedFile>;

/// A published file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PublishedFile {
    pub(crate) digest: Digest,
    /// The unit that made it: another unit's equal bytes are a separate file below `every/`.
    pub(crate) fingerprint: Digest,
    pub(crate) stamp: Stamp,
}

/// Path of the newest state of a pipeline.
pub(crate) fn path(folder: &Folder, pipeline: &str) -> PathBuf {
    folder.newest().join(format!("{pipeline}{ENDING}"))
}

/// The pipeline of the state file of this name.
pub(crate) fn pipeline_of(name: &str) -> &str {
    name.strip_suffix(ENDING).unwrap_or(name)
}

impl Newest {
    /// Returns the result of a unit that the newest runs still had, when this was read.
    pub(crate) fn current_outcome(&self, fingerprint: &Digest) -> Option<&Arc<RecordOutcome>> {
        let is_current = self.current.contains(fingerprint);
        is_current.then(|| self.outcome(fingerprint)).flatten()
    }

    /// Returns the result of a unit that is or was newest.
    pub(crate) fn outcome(&self, fingerprint: &Digest) -> Option<&Arc<RecordOutcome>> {
        self.outcomes.get(fingerprint)
    }

    /// Returns the published files of nodes no longer in the pipeline.
    pub(crate) fn published_by_others(
        &self,
        is_kept: impl Fn(&NodeName) -> bool,
    ) -> PublishedFiles {
        let others = self.published.iter().filter(|(node, _)| !is_kept(node));
        others
            .flat_map(|(_, published)| published.clone())
            .collect()
    }

    /// Sets the published files of a node.
    pub(crate) fn set_published(&mut self, node: &NodeName, published: PublishedFiles) {
        self.published_now.insert(node.clone());
        self.published.insert(node.clone(), published);
    }

    /// Whether this process has published or retired anything since it was read.
    pub(crate) fn is_changed(&self) -> bool {
        !self.published_now.is_empty() || !self.retired.is_empty()
    }

    /// Lists the units, each as of the newest run that reached it.
    pub(crate) fn list(&self) -> Vec<NewestUnit> {
        let units = self.units.iter().flat_map(|(node, units)| {
            units.iter().map(|(partition, unit)| NewestUnit {
                node: node.clone(),
                partition: partition.clone(),
                fingerprint: unit.fingerprint,
                current: unit.current,
            })
        });
        units.collect()
    }

    /// Merges the units that a run found or made in the nodes that it visited.
    pub(crate) fn merge_run(&mut self, units: &[(UnitRef, Arc<RecordOutcome>)]) {
        let nodes: BTreeSet<_> = units.iter().map(|(unit, _)| &unit.node).collect();
        for node in nodes {
            for unit in self.units.entry(node.clone()).or_default().values_mut() {
                unit.current = false;
            }
        }
        for (unit, outcome) in units {
            self.outcomes.insert(unit.fingerprint, Arc::clone(outcome));
            let newest = NewestOf {
                fingerprint: unit.fingerprint,
                current: true,
            };
            let of_node = self.units.entry(unit.node.clone()).or_default();
            of_node.insert(unit.partition.clone(), newest);
        }
    }

    /// Marks the nodes no longer in the pipeline as not current.
    pub(crate) fn retire(&mut self, is_kept: impl Fn(&NodeName) -> bool) {
        for (node, units) in &mut self.units {
            let is_current = units.values().any(|unit| unit.current);
            let is_published = self
                .published
                .get(node)
                .is_some_and(|published| !published.is_empty());
            if (is_current || is_published) && !is_kept(node) {
                self.retired.insert(node.clone());
                for unit in units.values_mut() {
                    unit.current = false;
                }
            }
        }
        self.published.retain(|node, _| is_kept(node));
    }

    /// Merges what this process has published and retired since it read the state.
    pub(crate) fn merge_published(&mut self, mine: &mut Self) {
        self.retire(|node| !mine.retired.contains(node));
        self.retired.clear();
        for node in &mine.published_now {
            if let Some(published) = mine.published.remove(node) {
                self.published.insert(node.clone(), published);
            }
        }
    }

    /// Forgets units whose records are gone.
    pub(crate) fn forget(&mut self, is_gone: impl Fn(&Digest) -> bool) {
        for units in self.units.values_mut() {
            units.retain(|_, unit| unit.current || !is_gone(&unit.fingerprint));
        }
    }
}
