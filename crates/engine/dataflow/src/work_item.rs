//! A work item: everything that is needed to make one unit, wherever that is.
//!
//! Whoever has a work item neither reads the pipeline file nor plans: it makes sure of the digests that the
//! item names, and of nothing else.

use std::{collections::BTreeMap, path::PathBuf, sync::Arc};

use serde::{Deserialize, Serialize};

use crate::{
    digest::Digest,
    error::Failure,
    fingerprint::{Fingerprint, OutputFingerprint},
    graph::Node,
    name::{ArtifactName, FileName, NodeName, PartitionKey, UnitName},
    outcome::Labels,
    record::FileRef,
    state::{PartitionState, State, digest_source},
    unit::ListedUnit,
};

/// Whether a unit is made even if its result is in the store.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Recompute {
    /// The unit is made again.
    Yes,
    /// The stored result is used.
    No,
}

/// Everything that is needed to make one unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WorkItem {
    /// The unit.
    pub unit: UnitName,
    /// Digest of its fingerprint.
    pub fingerprint: Digest,
    /// Whether it is made even if its result is in the store.
    pub(crate) forced: Recompute,
    /// Kind, code, configuration and schema.
    pub(crate) recipe: Arc<OutputFingerprint>,
    /// The stage's table as TOML, with all values of the pipeline's files and of the command line.
    pub(crate) options: String,
    /// The outputs that the inputs come from.
    pub(crate) wires: BTreeMap<ArtifactName, NodeName>,
    /// The partitions read, by input.
    pub(crate) inputs: BTreeMap<ArtifactName, Vec<WorkItemInput>>,
    /// The files outside the lake.
    pub(crate) files: Vec<WorkItemFile>,
    /// Facts found while the unit was listed.
    pub(crate) facts: BTreeMap<String, String>,
    /// Labels of the artifact, unless its data decide them.
    pub(crate) labels: Option<Labels>,
    /// The pipeline's seed.
    pub(crate) seed: u64,
}

/// One partition that a unit reads.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct WorkItemInput {
    pub(crate) key: PartitionKey,
    /// As the unit's fingerprint has it.
    pub(crate) digest: Digest,
    /// The labels, which are not read where only some files are.
    pub(crate) labels: Labels,
    /// The files that are read.
    pub(crate) files: BTreeMap<FileName, FileRef>,
}

/// One file outside the lake that a unit reads.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct WorkItemFile {
    pub(crate) name: String,
    pub(crate) path: PathBuf,
    /// As the unit's fingerprint has it: of the canonical form, if the file counts by one.
    pub(crate) digest: Digest,
    /// Digest of all bytes.
    pub(crate) bytes: Digest,
}

impl WorkItem {
    /// Returns the work item of a unit whose inputs are all made.
    pub(crate) fn new(
        state: &State,
        node: &Node,
        unit: &ListedUnit,
        forced: Recompute,
    ) -> Result<Self, Failure> {
        let name = UnitName::new(&node.name, &unit.partition);
        let (fingerprint, digest) = state
            .fingerprint(node, unit)?
            .ok_or_else(|| Failure::NotMade { unit: name.clone() })?;
        Ok(Self {
            fingerprint: digest,
            forced,
            options: state.pipeline().stage(node).text.clone(),
            wires: node.reads.clone(),
            inputs: inputs_of(state, node, unit, &fingerprint)?,
            files: files_of(state, &name, unit, &fingerprint)?,
            recipe: fingerprint.recipe,
            facts: fingerprint.facts,
            labels: unit.labels.clone(),
            seed: fingerprint.seed,
            unit: name,
        })
    }

    /// Whether the unit is made even if its result is there.
    pub fn is_forced(&self) -> bool {
        self.forced == Recompute::Yes
    }

    /// Returns the fingerprint of the unit.
    pub(crate) fn whole_fingerprint(&self) -> Fingerprint {
        let inputs = self.inputs.iter().map(|(input, read)| {
            let digests = read.iter().map(|read| (read.key.clone(), read.digest));
            (input.clone(), digests.collect())
        });
        let files = self.files.iter();
        Fingerprint {
            recipe: Arc::clone(&self.recipe),
            stage: self.unit.node.stage.clone(),
            partition: self.unit.partition.clone(),
            inputs: inputs.collect(),
            files: files.map(|file| (file.name.clone(), file.digest)).collect(),
            facts: self.facts.clone(),
            seed: self.seed,
        }
    }

    /// Iterates over the files of the lake that the unit reads, each with the unit that it is of.
    pub fn reads(&self) -> impl Iterator<Item = (UnitName, &FileRef)> {
        self.inputs.iter().flat_map(|(input, read)| {
            let node = self.wires.get(input);
            read.iter().flat_map(move |read| {
                let unit = node.map(|node| UnitName::new(node, &read.key));
                let files = read.files.values();
                files.filter_map(move |file| Some((unit.clone()?, file)))
            })
        })
    }
}

fn inputs_of(
    state: &State,
    node: &Node,
    unit: &ListedUnit,
    fingerprint: &Fingerprint,
) -> Result<BTreeMap<ArtifactName, Vec<WorkItemInput>>, Failure> {
    let mut inputs = BTreeMap::new();
    for (input, keys) in &unit.reads {
        let parts = unit.parts.get(input.as_str());
        let mut read = Vec::with_capacity(keys.len());
        for key in keys {
            let ordered = || {
                let source = node.reads.get(input)?;
                let PartitionState::Made(outcome) = state.known(source, key)? else {
                    return None;
                };
                Some(WorkItemInput {
                    key: key.clone(),
                    digest: *fingerprint.inputs.get(input)?.get(key)?,
                    labels: match parts {
                        None => outcome.labels().clone(),
                        Some(_) => Labels::new(),
                    },
                    files: outcome.parts(parts)?,
                })
            };
            read.push(ordered().ok_or_else(|| Failure::MissingInput {
                stage: node.name.stage.clone(),
                input: input.clone(),
                partition: key.clone(),
            })?);
        }
        inputs.insert(input.clone(), read);
    }
    Ok(inputs)
}

fn files_of(
    state: &State,
    name: &UnitName,
    unit: &ListedUnit,
    fingerprint: &Fingerprint,
) -> Result<Vec<WorkItemFile>, Failure> {
    let ordered = unit.files.iter().map(|file| {
        let changed = || Failure::ChangedMeanwhile {
            stage: name.node.stage.clone(),
            partition: name.partition.clone(),
            path: file.path.clone(),
        };
        let unreadable = |source| Failure::SourceFile {
            path: file.path.clone(),
            source,
        };
        let digest = *fingerprint.files.get(&file.name).ok_or_else(changed)?;
        let bytes = match unit.forms.get(&file.name) {
            None => digest,
            Some(form) => {
                let store = state.store();
                let bytes = store.source_digest(&file.path, None).map_err(unreadable)?;
                // The bytes are those of which the form was digested before.
                let now =
                    digest_source(store, &file.path, None, Some(*form)).map_err(unreadable)?;
                if now != digest {
                    return Err(changed());
                }
                bytes
            }
        };
        Ok(WorkItemFile {
            name: file.name.clone(),
            path: file.path.clone(),
            digest,
            bytes,
        })
    });
    ordered.collect()
}
