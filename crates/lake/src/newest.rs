//! What is newest of a pipeline: one small file that answers for all its units at once.
//!
//! It is a cache: everything in it can be found out again from records, blobs and the files shown,
//! at the price of reading them.

use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    path::{Path, PathBuf},
    sync::Arc,
};

use dataflow::{Digest, NewestUnit, NodeName, RecordOutcome, UnitRef};
use serde::{Deserialize, Serialize};

use crate::{LakeError, sealed, stamp::Stamp};

/// The newest state of a pipeline.
#[derive(Default)]
pub(crate) struct Newest {
    units: BTreeMap<NodeName, BTreeMap<String, NewestOf>>,
    outcomes: HashMap<Digest, Arc<RecordOutcome>>,
    shown: BTreeMap<NodeName, Shown>,
    /// Nodes that the pipeline no longer has.
    retired: BTreeSet<NodeName>,
    /// Stamps of whole blobs, as they were read.
    pub(crate) stamps: Vec<(Digest, Stamp)>,
}

/// The newest state of a unit.
#[derive(Clone, Copy)]
struct NewestOf {
    fingerprint: Digest,
    current: bool,
}

/// The files that a node shows, by path below the lake.
pub(crate) type Shown = BTreeMap<String, ShownFile>;

/// A file that people see.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct ShownFile {
    pub(crate) digest: Digest,
    /// The unit that made it: equal bytes of another are shown among every table as well.
    pub(crate) fingerprint: Digest,
    pub(crate) stamp: Stamp,
}

/// The file's form.
#[derive(Serialize, Deserialize)]
struct Stored {
    nodes: Vec<StoredNode>,
    stamps: Vec<(Digest, Stamp)>,
}

#[derive(Serialize, Deserialize)]
struct StoredNode {
    node: NodeName,
    units: Vec<(String, Digest, bool)>,
    outcomes: Vec<Arc<RecordOutcome>>,
    shown: Vec<(String, ShownFile)>,
}

/// Where the newest state of a pipeline lies.
pub(crate) fn path(root: &Path, pipeline: &str) -> PathBuf {
    root.join("newest").join(format!("{pipeline}.json"))
}

impl Newest {
    /// Reads the file; one that cannot be used is as good as none.
    pub(crate) fn read(path: &Path) -> Result<Self, LakeError> {
        let Some(stored) = sealed::read_if_whole::<Stored>(path)? else {
            return Ok(Self::default());
        };
        let mut newest = Self {
            stamps: stored.stamps,
            ..Self::default()
        };
        for node in stored.nodes {
            let mut units = BTreeMap::new();
            for ((partition, fingerprint, current), outcome) in
                node.units.into_iter().zip(node.outcomes)
            {
                newest.outcomes.insert(fingerprint, outcome);
                let unit = NewestOf {
                    fingerprint,
                    current,
                };
                units.insert(partition, unit);
            }
            newest.units.insert(node.node.clone(), units);
            newest
                .shown
                .insert(node.node, node.shown.into_iter().collect());
        }
        Ok(newest)
    }

    /// Writes the file, with the stamps of the blobs that its units gave.
    pub(crate) fn write(
        &self,
        staging: &Path,
        path: &Path,
        stamp: impl Fn(&Digest) -> Option<Stamp>,
    ) -> Result<(), LakeError> {
        let mut stamps = BTreeMap::new();
        for unit in self.units.values().flat_map(BTreeMap::values) {
            let outcome = self.outcomes.get(&unit.fingerprint);
            if let Some(RecordOutcome::Made { files, .. }) = outcome.map(AsRef::as_ref) {
                let known = files
                    .values()
                    .filter_map(|file| Some((file.digest, stamp(&file.digest)?)));
                stamps.extend(known);
            }
        }
        let nodes = self.units.iter().map(|(node, units)| {
            let known = units.iter().filter_map(|(partition, unit)| {
                let outcome = self.outcomes.get(&unit.fingerprint)?;
                let key = (partition.clone(), unit.fingerprint, unit.current);
                Some((key, Arc::clone(outcome)))
            });
            let (units, outcomes) = known.unzip();
            let shown = self.shown.get(node).into_iter().flatten();
            StoredNode {
                node: node.clone(),
                units,
                outcomes,
                shown: shown.map(|(path, file)| (path.clone(), *file)).collect(),
            }
        });
        let stored = Stored {
            nodes: nodes.collect(),
            stamps: stamps.into_iter().collect(),
        };
        sealed::write(staging, path, &stored)
    }

    /// Returns the result of a unit that is or was newest.
    pub(crate) fn outcome(&self, fingerprint: &Digest) -> Option<&Arc<RecordOutcome>> {
        self.outcomes.get(fingerprint)
    }

    pub(crate) fn shown(&self, node: &NodeName) -> Option<&Shown> {
        self.shown.get(node)
    }

    pub(crate) fn all_shown_mut(&mut self) -> &mut BTreeMap<NodeName, Shown> {
        &mut self.shown
    }

    /// Lists the units, each as the newest run that came to it left it.
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

    /// Takes over what a run found or made in the nodes that it went through.
    pub(crate) fn take_over(&mut self, units: &[(UnitRef, Arc<RecordOutcome>)]) {
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

    /// Stops counting nodes as current that the pipeline no longer has.
    pub(crate) fn retire(&mut self, is_kept: impl Fn(&NodeName) -> bool) {
        for (node, units) in &mut self.units {
            if !is_kept(node) {
                self.retired.insert(node.clone());
                for unit in units.values_mut() {
                    unit.current = false;
                }
            }
        }
        self.shown.retain(|node, _| is_kept(node));
    }

    /// Takes over what this process has shown and retired from what it had read before.
    pub(crate) fn take_over_shown(&mut self, mine: &mut Self) {
        let retired = std::mem::take(&mut mine.retired);
        self.retire(|node| !retired.contains(node));
        self.shown.append(&mut mine.shown);
    }

    /// Forgets units whose records are gone.
    pub(crate) fn forget(&mut self, is_gone: impl Fn(&Digest) -> bool) {
        for units in self.units.values_mut() {
            units.retain(|_, unit| unit.current || !is_gone(&unit.fingerprint));
        }
    }
}
