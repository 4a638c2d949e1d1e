//! What is known of every partition while a plan or a run goes through the graph.

use std::{
    collections::{BTreeMap, HashMap},
    path::PathBuf,
    sync::Mutex,
};

use crate::{
    code::Code,
    digest::Digest,
    error::Failure,
    fingerprint::Fingerprint,
    graph::{Node, NodeName},
    pipeline::{Pipeline, StageEntry},
    stage::{Partition, Scope},
    store::{RecordOutcome, Store},
    unit::Unit,
};

/// What planning knows of a partition.
#[derive(Debug, Clone)]
pub(crate) struct Known {
    pub(crate) labels: BTreeMap<String, String>,
    /// Its files; `None` if it is to be made and its bytes are not known yet.
    pub(crate) outcome: Option<RecordOutcome>,
}

impl Known {
    /// Returns the digest of the partition, or of the named files of it.
    fn digest_of(&self, parts: Option<&Vec<String>>) -> Option<Digest> {
        let outcome = self.outcome.as_ref()?;
        if parts.is_none() {
            return outcome.artifact_digest();
        }
        let files = outcome.files(parts)?;
        let digests: BTreeMap<_, _> = files
            .into_iter()
            .map(|(name, file)| (name, file.digest))
            .collect();
        Some(Digest::of_json(&serde_json::json!(digests)))
    }
}

/// The partitions made so far, by node.
pub(crate) struct State<'a> {
    pipeline: &'a Pipeline,
    store: &'a dyn Store,
    made: BTreeMap<NodeName, BTreeMap<String, Known>>,
    /// Digests of files outside the lake, each computed at most once.
    sources: Mutex<HashMap<PathBuf, Digest>>,
}

impl<'a> State<'a> {
    pub(crate) fn new(pipeline: &'a Pipeline, store: &'a dyn Store) -> Self {
        Self {
            pipeline,
            store,
            made: BTreeMap::new(),
            sources: Mutex::new(HashMap::new()),
        }
    }

    pub(crate) fn insert(&mut self, node: &NodeName, partitions: BTreeMap<String, Known>) {
        self.made.insert(node.clone(), partitions);
    }

    /// Returns what is known of a partition that a node reads.
    pub(crate) fn known(&self, node: &NodeName, partition: &str) -> Option<&Known> {
        self.made.get(node)?.get(partition)
    }

    /// Lists the units of a node in the order of their keys.
    pub(crate) fn units(&self, node: &Node) -> Result<Vec<Unit>, Failure> {
        let stage = self.pipeline.stage(node);
        let partitions = node
            .reads
            .iter()
            .map(|(input, source)| {
                let made = self.made.get(source).into_iter().flatten();
                let partitions = made
                    .map(|(key, known)| Partition {
                        key: key.clone(),
                        labels: known.labels.clone(),
                    })
                    .collect();
                (input.clone(), partitions)
            })
            .collect();
        let mut units = stage
            .configured
            .units(node.output.artifact, &Scope::new(partitions))
            .map_err(|source| Failure::Stage {
                stage: stage.name.clone(),
                partition: None,
                source,
            })?;
        units.sort_by(|a, b| a.partition.cmp(&b.partition));
        units.dedup_by(|a, b| a.partition == b.partition);
        Ok(units)
    }

    /// Returns the fingerprint of a unit, or `None` if it reads something that is yet to be made.
    pub(crate) fn fingerprint(
        &self,
        node: &Node,
        unit: &Unit,
    ) -> Result<Option<Fingerprint>, Failure> {
        let stage = self.pipeline.stage(node);
        let mut inputs = BTreeMap::new();
        for (input, keys) in &unit.reads {
            let mut digests = BTreeMap::new();
            for key in keys {
                let known = node
                    .reads
                    .get(input)
                    .and_then(|source| self.known(source, key))
                    .ok_or_else(|| Failure::MissingInput {
                        stage: stage.name.clone(),
                        input: input.clone(),
                        partition: key.clone(),
                    })?;
                let Some(digest) = known.digest_of(unit.parts.get(input)) else {
                    return Ok(None);
                };
                digests.insert(key.clone(), digest);
            }
            inputs.insert(input.clone(), digests);
        }
        let mut files = BTreeMap::new();
        for file in &unit.files {
            files.insert(file.name.clone(), self.source_digest(&file.path)?);
        }
        Ok(Some(Fingerprint {
            kind: stage.kind.name.to_owned(),
            output: node.output.artifact.to_owned(),
            partition: unit.partition.clone(),
            code: code_parts(stage.kind.code),
            config: stage.config(),
            inputs,
            files,
            schema: node.output.schema.to_owned(),
            seed: unit_seed(self.pipeline.seed, stage, &unit.partition),
        }))
    }

    fn source_digest(&self, path: &std::path::Path) -> Result<Digest, Failure> {
        let known = |sources: &HashMap<PathBuf, Digest>| sources.get(path).cloned();
        // A poisoned lock only means that another unit failed; the digests in it are whole.
        let lock = || {
            self.sources
                .lock()
                .unwrap_or_else(std::sync::PoisonError::into_inner)
        };
        if let Some(digest) = known(&lock()) {
            return Ok(digest);
        }
        let digest = self
            .store
            .source_digest(path)
            .map_err(|source| Failure::SourceFile {
                path: path.to_owned(),
                source,
            })?;
        lock().insert(path.to_owned(), digest.clone());
        Ok(digest)
    }
}

fn code_parts(code: Code) -> BTreeMap<String, String> {
    code.iter()
        .map(|(part, digest)| (part.to_owned(), digest.to_owned()))
        .collect()
}

/// The seed of one unit: of the pipeline's seed, the stage's name and the partition alone.
fn unit_seed(seed: u64, stage: &StageEntry, partition: &str) -> u64 {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&seed.to_le_bytes());
    hasher.update(stage.name.as_bytes());
    hasher.update(&[0]);
    hasher.update(partition.as_bytes());
    let mut first = [0; 8];
    first.copy_from_slice(&hasher.finalize().as_bytes()[..8]);
    u64::from_le_bytes(first)
}
