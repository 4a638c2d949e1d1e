//! The state of every partition while a plan or a run traverses the graph.

use std::{
    collections::{BTreeMap, HashMap},
    fs, io,
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
};

use crate::{
    advice::BoxedDiagnostic,
    canonical_form::Form,
    code::Code,
    digest::Digest,
    elementary_functions,
    error::{Failure, NamedItems},
    fingerprint::{Fingerprint, OutputFingerprint},
    graph::Node,
    name::{NodeName, PartitionKey, UnitName},
    outcome::Labels,
    pipeline::Pipeline,
    record::RecordOutcome,
    scope::{Partition, RunFacts, Scope, SkippedItem},
    source_file::SourceFile,
    stamp::Stamp,
    store::Store,
    unit::{ListedUnit, Unit},
};

/// The state of a partition.
#[derive(Debug, Clone)]
pub(crate) enum PartitionState {
    /// Its bytes.
    Made(Arc<RecordOutcome>),
    /// Not made yet: its bytes are unknown, and it may be skipped or filtered.
    Open {
        /// The labels that it will or may have.
        labels: Labels,
        /// Whether they are certain.
        predicted: LabelsPredicted,
    },
}

impl PartitionState {
    /// Returns the state of a partition with this outcome; `None` if it was skipped or filtered.
    pub(crate) fn of(outcome: Arc<RecordOutcome>) -> Option<Self> {
        outcome.is_made().then_some(Self::Made(outcome))
    }
}

/// Whether labels are certain before the partition is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LabelsPredicted {
    Yes,
    No,
}

/// The units that a node's stage would make, given the state of its inputs.
pub(crate) struct Listing {
    /// The units in the order of their keys.
    pub(crate) units: Vec<ListedUnit>,
    /// Certainty of each unit, whatever the outcome of open partitions.
    pub(crate) certainty: Vec<Certainty>,
    /// Whether unlisted units may be added.
    pub(crate) may_grow: bool,
}

/// Certainty of a unit before all inputs of its node are made; more is greater.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Certainty {
    /// Nothing: it may not exist.
    Unknown,
    /// It exists, but its inputs, files and facts may change.
    Exists,
    /// It exists with these files and facts, but its input partitions may change.
    OwnFiles,
    /// It exists with exactly these inputs.
    Exact,
}

/// The partitions made so far, by node.
pub(crate) struct State<'a> {
    pipeline: &'a Pipeline,
    store: &'a dyn Store,
    made: BTreeMap<NodeName, BTreeMap<PartitionKey, PartitionState>>,
    /// Items that nodes skipped or filtered.
    left_out: BTreeMap<NodeName, Vec<SkippedItem>>,
    run: RunFacts,
    /// Nodes that may get more partitions than are known.
    growing: Vec<NodeName>,
    /// The recipe of each node, with its digest.
    recipes: HashMap<NodeName, (Arc<OutputFingerprint>, Digest)>,
    /// Digests of files outside the lake, each computed at most once.
    sources: Mutex<HashMap<(PathBuf, Option<&'static str>), Digest>>,
}

impl<'a> State<'a> {
    pub(crate) fn new(pipeline: &'a Pipeline, store: &'a dyn Store) -> Self {
        let recipes = pipeline.nodes.iter().map(|node| {
            let stage = pipeline.stage(node);
            let recipe = OutputFingerprint {
                kind: stage.kind.name.to_owned(),
                output: node.name.artifact.clone(),
                code: code_parts(node.output.code),
                config: stage.config_of(node.output.options),
                schema: node.output.schema.to_owned(),
            };
            let digest = recipe.digest();
            (node.name.clone(), (Arc::new(recipe), digest))
        });
        Self {
            pipeline,
            store,
            made: BTreeMap::new(),
            left_out: BTreeMap::new(),
            run: pipeline.facts(),
            growing: Vec::new(),
            recipes: recipes.collect(),
            sources: Mutex::new(HashMap::new()),
        }
    }

    pub(crate) fn pipeline(&self) -> &'a Pipeline {
        self.pipeline
    }

    pub(crate) fn store(&self) -> &'a dyn Store {
        self.store
    }

    pub(crate) fn insert(
        &mut self,
        node: &NodeName,
        partitions: BTreeMap<PartitionKey, PartitionState>,
    ) {
        self.made.insert(node.clone(), partitions);
    }

    /// Marks a node that may get more partitions than are known.
    pub(crate) fn grows(&mut self, node: &NodeName) {
        self.growing.push(node.clone());
    }

    /// Returns the state of a partition that a node reads.
    pub(crate) fn known(
        &self,
        node: &NodeName,
        partition: &PartitionKey,
    ) -> Option<&PartitionState> {
        self.made.get(node)?.get(partition)
    }

    /// Whether a node has open partitions, or may get more than are known.
    pub(crate) fn is_open(&self, node: &NodeName) -> bool {
        let mut partitions = self.made.get(node).into_iter().flatten();
        self.growing.contains(node)
            || partitions.any(|(_, known)| matches!(known, PartitionState::Open { .. }))
    }

    /// Lists the units of a node, all of whose inputs are made, in the order of their keys.
    pub(crate) fn units(&self, node: &Node) -> Result<Vec<ListedUnit>, Failure> {
        let asked = Arc::default();
        self.list(node, &self.scope(node, Presence::Assumed, &asked))
    }

    /// Recalls the units of a node from the store through `find`; fails if one is missing.
    pub(crate) fn recall(
        &mut self,
        node: &Node,
        find: impl Fn(&Digest) -> Result<Option<Arc<RecordOutcome>>, BoxedDiagnostic>,
    ) -> Result<Vec<ListedUnit>, Failure> {
        let units = self.units(node)?;
        let mut known = BTreeMap::new();
        for unit in &units {
            let outcome = match self.fingerprint(node, unit)? {
                Some((_, digest)) => find(&digest)?,
                None => None,
            };
            let outcome = outcome.ok_or_else(|| Failure::NotMade {
                unit: UnitName::new(&node.name, &unit.partition),
            })?;
            let made = self.learn(&node.name, &unit.partition, outcome);
            known.extend(made.map(|known| (unit.partition.clone(), known)));
        }
        self.insert(&node.name, known);
        Ok(units)
    }

    /// Recalls those units of a node that are in the store and at least this certain; the others
    /// are open.
    pub(crate) fn recall_some(
        &mut self,
        node: &Node,
        at_least: Certainty,
        mut find: impl FnMut(&Digest) -> Result<Option<Arc<RecordOutcome>>, BoxedDiagnostic>,
    ) -> Result<(), Failure> {
        let Some(listing) = self.listing(node)? else {
            self.grows(&node.name);
            return Ok(());
        };
        let mut partitions = BTreeMap::new();
        for (unit, certainty) in listing.units.iter().zip(listing.certainty) {
            let outcome = match self.fingerprint(node, unit)? {
                Some((_, digest)) if certainty >= at_least => find(&digest)?,
                _ => None,
            };
            let known = match outcome {
                Some(outcome) => self.learn(&node.name, &unit.partition, outcome),
                None => Some(PartitionState::Open {
                    labels: Labels::new(),
                    predicted: LabelsPredicted::No,
                }),
            };
            partitions.extend(known.map(|known| (unit.partition.clone(), known)));
        }
        self.insert(&node.name, partitions);
        if listing.may_grow {
            self.grows(&node.name);
        }
        Ok(())
    }

    /// Returns the first open partition that a node may read.
    pub(crate) fn first_open(&self, node: &Node) -> Option<UnitName> {
        node.reads.values().find_map(|source| {
            let mut partitions = self.made.get(source)?.iter();
            let (key, _) =
                partitions.find(|(_, known)| matches!(known, PartitionState::Open { .. }))?;
            Some(UnitName::new(source, key))
        })
    }

    /// Lists the units of a node with open inputs; `None` if they cannot be determined.
    pub(crate) fn listing(&self, node: &Node) -> Result<Option<Listing>, Failure> {
        if !node.reads.values().any(|source| self.is_open(source)) {
            let units = self.units(node)?;
            let certainty = vec![Certainty::Exact; units.len()];
            return Ok(Some(Listing {
                units,
                certainty,
                may_grow: false,
            }));
        }
        let asked = Arc::default();
        // A failure to list with open inputs says nothing about what a run will find.
        let Ok(units) = self.list(node, &self.scope(node, Presence::Assumed, &asked)) else {
            return Ok(None);
        };
        let may_grow = asked.load(Ordering::Relaxed)
            || node
                .reads
                .values()
                .any(|source| self.growing.contains(source));
        let certainty = if may_grow {
            vec![Certainty::Unknown; units.len()]
        } else {
            self.certainty(node, &units)
        };
        Ok(Some(Listing {
            units,
            certainty,
            may_grow,
        }))
    }

    /// Returns the certainty of each unit, whichever open partitions are made.
    fn certainty(&self, node: &Node, units: &[ListedUnit]) -> Vec<Certainty> {
        let asked = Arc::default();
        let without = self.list(node, &self.scope(node, Presence::Denied(None), &asked));
        if let Ok(without) = without {
            let certainty = units.iter().map(|unit| {
                match without.binary_search_by(|other| other.partition.cmp(&unit.partition)) {
                    Ok(idx) if without.get(idx) == Some(unit) => Certainty::Exact,
                    Ok(idx) => present(unit, without.get(idx)),
                    Err(_) => Certainty::Unknown,
                }
            });
            return certainty.collect();
        }
        // A stage without any input partition fails, so at least one will be made: a unit that is
        // listed for each choice of that one is certain.
        let mut certainty = vec![Certainty::OwnFiles; units.len()];
        for source in node.reads.values() {
            let open = self.made.get(source).into_iter().flatten();
            let open = open.filter(|(_, known)| matches!(known, PartitionState::Open { .. }));
            let alone = open.map(|(key, _)| Some(key)).chain([None]);
            for key in alone {
                if certainty
                    .iter()
                    .all(|certainty| *certainty == Certainty::Unknown)
                {
                    return certainty;
                }
                let only = Presence::Denied(Some((source, key)));
                if let Ok(listed) = self.list(node, &self.scope(node, only, &asked)) {
                    for (certainty, unit) in certainty.iter_mut().zip(units) {
                        let mut listed = listed.iter();
                        let found = listed.find(|found| found.partition == unit.partition);
                        *certainty = (*certainty).min(present(unit, found));
                    }
                }
            }
        }
        certainty
    }

    fn list(&self, node: &Node, scope: &Scope) -> Result<Vec<ListedUnit>, Failure> {
        let stage = self.pipeline.stage(node);
        let units = stage.units(node.output_idx, scope)?.into_iter();
        let units = units.map(Unit::listed).collect::<Result<Vec<_>, _>>();
        let mut units = units.map_err(|fault| Failure::NotAKey {
            node: node.name.clone(),
            fault,
        })?;
        units.sort_by(|a, b| a.partition.cmp(&b.partition));
        let mut pairs = units.windows(2);
        let twice = pairs.find_map(|pair| match pair {
            [a, b] if a.partition == b.partition => Some(&a.partition),
            _ => None,
        });
        if let Some(key) = twice {
            return Err(Failure::DuplicateName {
                stage: stage.name.clone(),
                name: key.to_string(),
                what: NamedItems::Partitions(node.name.artifact.clone()),
            });
        }
        Ok(units)
    }

    /// The scope of a node's stage; `asked` is set when it reads labels that may change.
    fn scope(&self, node: &Node, open: Presence<'_>, asked: &Arc<AtomicBool>) -> Scope {
        let is_denied = |source: &NodeName, key: &PartitionKey| match open {
            Presence::Assumed => false,
            Presence::Denied(None) => true,
            Presence::Denied(Some((of, but))) => of == source && but != Some(key),
        };
        let partition = |source: &NodeName, key: &PartitionKey, known: &PartitionState| match known
        {
            PartitionState::Made(outcome) => Some(Partition::made(key, outcome)),
            PartitionState::Open { .. } if is_denied(source, key) => None,
            PartitionState::Open {
                labels,
                predicted: LabelsPredicted::Yes,
            } => Some(Partition::new(key.clone(), labels.clone())),
            PartitionState::Open { labels, .. } => {
                Some(Partition::uncertain(key, labels.clone(), asked))
            }
        };
        let inputs = node.reads.iter().map(|(input, source)| {
            let made = self.made.get(source).into_iter().flatten();
            let made = made.filter_map(|(key, known)| partition(source, key, known));
            (input.to_string(), made.collect())
        });
        let left_out = node.reads.iter().filter_map(|(input, source)| {
            let left_out = self.left_out.get(source)?;
            Some((input.to_string(), left_out.clone()))
        });
        Scope::new(inputs.collect())
            .with_left_out(left_out.collect())
            .with_run(RunFacts {
                wired: node
                    .reads
                    .iter()
                    .map(|(input, source)| (input.to_string(), source.to_string()))
                    .collect(),
                ..self.run.clone()
            })
    }

    /// Returns the state of a partition with this outcome; of one that was skipped or filtered, remembers the
    /// reason.
    pub(crate) fn learn(
        &mut self,
        node: &NodeName,
        key: &PartitionKey,
        outcome: Arc<RecordOutcome>,
    ) -> Option<PartitionState> {
        if let Some(reason) = outcome.reason() {
            let left_out = self.left_out.entry(node.clone()).or_default();
            let one = SkippedItem {
                key: key.to_string(),
                is_fault: matches!(*outcome, RecordOutcome::Skipped { .. }),
                reason: reason.to_owned(),
            };
            if let Err(idx) = left_out.binary_search(&one) {
                left_out.insert(idx, one);
            }
        }
        PartitionState::of(outcome)
    }

    /// Returns the fingerprint of a unit and its digest, or `None` if an input is not made yet.
    pub(crate) fn fingerprint(
        &self,
        node: &Node,
        unit: &ListedUnit,
    ) -> Result<Option<(Fingerprint, Digest)>, Failure> {
        let stage = self.pipeline.stage(node);
        let mut inputs = BTreeMap::new();
        for (input, keys) in &unit.reads {
            let mut digests = BTreeMap::new();
            for key in keys {
                let source = node.reads.get(input);
                let known = source.and_then(|source| self.known(source, key));
                let digest = match known {
                    Some(PartitionState::Made(outcome)) => {
                        outcome.digest_of(unit.parts.get(input.as_str()))
                    }
                    Some(PartitionState::Open { .. }) => None,
                    // A listing from labels that may change may be wrong.
                    None if node.reads.values().any(|source| self.is_open(source)) => None,
                    None => {
                        return Err(Failure::MissingInput {
                            stage: stage.name.clone(),
                            input: input.clone(),
                            partition: key.clone(),
                        });
                    }
                };
                let Some(digest) = digest else {
                    return Ok(None);
                };
                digests.insert(key.clone(), digest);
            }
            inputs.insert(input.clone(), digests);
        }
        let Some((own, recipe_digest)) = self.own_fingerprint(node, unit)? else {
            return Ok(None);
        };
        let fingerprint = Fingerprint { inputs, ..own };
        let digest = fingerprint.digest_with(recipe_digest);
        Ok(Some((fingerprint, digest)))
    }

    /// Returns a unit's fingerprint without its inputs from other stages, and the recipe's digest.
    pub(crate) fn own_fingerprint(
        &self,
        node: &Node,
        unit: &ListedUnit,
    ) -> Result<Option<(Fingerprint, &Digest)>, Failure> {
        let stage = self.pipeline.stage(node);
        let mut files = BTreeMap::new();
        for file in &unit.files {
            let digest = self.source_digest(file, unit.forms.get(&file.name).copied())?;
            if files.insert(file.name.clone(), digest).is_some() {
                return Err(Failure::DuplicateName {
                    stage: stage.name.clone(),
                    name: file.name.clone(),
                    what: NamedItems::Files(unit.partition.clone()),
                });
            }
        }
        let Some((recipe, recipe_digest)) = self.recipes.get(&node.name) else {
            return Ok(None);
        };
        let fingerprint = Fingerprint {
            recipe: Arc::clone(recipe),
            stage: stage.name.clone(),
            partition: unit.partition.clone(),
            inputs: BTreeMap::new(),
            files,
            facts: unit.facts.clone(),
            seed: self.pipeline.seed,
        };
        Ok(Some((fingerprint, recipe_digest)))
    }

    fn source_digest(&self, file: &SourceFile, form: Option<Form>) -> Result<Digest, Failure> {
        // A poisoned lock only means that another unit failed; the digests in it are whole.
        let lock = || self.sources.lock().unwrap_or_else(PoisonError::into_inner);
        let key = (file.path.clone(), form.map(|form| form.name));
        if let Some(digest) = lock().get(&key) {
            return Ok(*digest);
        }
        let digest = digest_source(self.store, &file.path, file.stamp, form).map_err(|source| {
            Failure::SourceFile {
                path: file.path.clone(),
                source,
            }
        })?;
        lock().insert(key, digest);
        Ok(digest)
    }
}

/// Digests the current content of a file outside the lake, in its canonical form if it has one.
pub(crate) fn digest_source(
    store: &dyn Store,
    path: &Path,
    stamp: Option<Stamp>,
    form: Option<Form>,
) -> Result<Digest, io::Error> {
    match form {
        None => store.source_digest(path, stamp),
        Some(form) => fs::read(path).map(|bytes| form.digest(&bytes)),
    }
}

/// Open partitions that are assumed to be made.
#[derive(Debug, Clone, Copy)]
enum Presence<'a> {
    /// All of them.
    Assumed,
    /// None of them; or only this one of one node, and all of the other nodes'.
    Denied(Option<(&'a NodeName, Option<&'a PartitionKey>)>),
}

/// Returns the certainty of a unit, given its counterpart in another listing.
fn present(unit: &ListedUnit, other: Option<&ListedUnit>) -> Certainty {
    match other {
        None => Certainty::Unknown,
        Some(other) if other.files == unit.files && other.facts == unit.facts => {
            Certainty::OwnFiles
        }
        Some(_) => Certainty::Exists,
    }
}

/// Returns the digests of an output's code by crate, and of the elementary functions if their values are unusual.
pub(crate) fn code_parts(code: Code) -> BTreeMap<String, String> {
    let rounding = elementary_functions::unusual();
    let rounding = rounding.map(|digest| (elementary_functions::PART.to_owned(), digest.to_hex()));
    code.iter()
        .map(|(part, digest)| (part.to_owned(), digest.to_owned()))
        .chain(rounding)
        .collect()
}
