//! Plans: the units that a run would make, and the reasons.
//!
//! A unit whose fingerprint is known is either cached or runs. A unit with an input that is not
//! made yet has no fingerprint: it may run, since a rerun of equal bytes stops there. If open
//! partitions decide which units exist (they may be skipped, or their labels may change), every
//! unit that depends on them may run, too. A unit that exists in any case, and of which its own
//! part (such as a file that it reads) matches no stored unit, runs whatever its inputs turn out to
//! be. So a run makes every unit that is certain here, and some of those that are possible.

use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    sync::Arc,
};

use serde::Serialize;

use crate::{
    digest::Digest,
    error::Failure,
    fingerprint::{Cause, Fingerprint},
    graph::Node,
    name::{NodeName, PartitionKey, StageName},
    options::RunOptions,
    outcome::Labels,
    pipeline::Pipeline,
    record::RecordOutcome,
    state::{Certainty, LabelsPredicted, Listing, PartitionState, State},
    store::Store,
    unit::ListedUnit,
};

/// Prediction of a run.
#[derive(Debug, Clone, Serialize)]
pub struct Plan {
    /// Every output in the order in which it would be made.
    pub nodes: Vec<PlannedNode>,
}

/// Prediction for one output.
#[derive(Debug, Clone, Serialize)]
pub struct PlannedNode {
    /// The output.
    pub node: NodeName,
    /// Its units; `None` if they are only known once its inputs are made.
    pub units: Option<Vec<PlannedUnit>>,
    /// Whether unlisted units may be added, because the labels that select them may change.
    pub may_grow: bool,
}

/// Prediction for one unit.
#[derive(Debug, Clone, Serialize)]
pub struct PlannedUnit {
    /// The partition's key.
    pub partition: PartitionKey,
    /// Whether it would run.
    #[serde(flatten)]
    pub state: UnitState,
}

/// Whether a unit would run.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "state", rename_all = "snake_case")]
pub enum UnitState {
    /// Its result is in the lake.
    Cached,
    /// Its result is in the depot, from where a run fetches what it needs.
    Depot {
        /// Bytes that are not in the lake.
        bytes: u64,
    },
    /// It would run.
    Run {
        /// Every difference from the last time; while it waits, those known so far.
        causes: Vec<Cause>,
        /// The outputs it waits for.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        upstream: Vec<NodeName>,
    },
    /// It would run unless its inputs come out unchanged.
    Pending {
        /// The outputs it waits for.
        upstream: Vec<NodeName>,
        /// Differences from the last time that are known so far.
        causes: Vec<Cause>,
    },
}

impl Plan {
    /// Returns whether nothing would run.
    pub fn is_up_to_date(&self) -> bool {
        self.nodes.iter().all(|node| {
            node.units
                .as_ref()
                .is_some_and(|units| units.iter().all(|unit| unit.state == UnitState::Cached))
        })
    }
}

/// Predicts what a run would do, and makes nothing.
///
/// # Errors
///
/// Fails if a stage cannot list its units or the store cannot be read.
pub fn plan(pipeline: &Pipeline, store: &dyn Store, options: &RunOptions) -> Result<Plan, Failure> {
    let nodes = options.nodes(pipeline)?;
    pipeline.prepare(&nodes)?;
    store.enter(&pipeline.name)?;
    let newest = store.newest_units(&pipeline.name)?;
    let mut last: BTreeMap<NodeName, HashMap<PartitionKey, Digest>> = BTreeMap::new();
    for unit in newest {
        let of_node = last.entry(unit.node).or_default();
        of_node.insert(unit.partition, unit.fingerprint);
    }
    let mut planner = Planner {
        store,
        options,
        last,
        stages: pipeline.stages.iter().map(|stage| &stage.name).collect(),
        state: State::new(pipeline, store),
        unknown: Vec::new(),
    };
    let nodes = nodes
        .iter()
        .map(|node| planner.node(node))
        .collect::<Result<_, _>>()?;
    Ok(Plan { nodes })
}

struct Planner<'a> {
    store: &'a dyn Store,
    options: &'a RunOptions,
    /// The newest fingerprint of every unit.
    last: BTreeMap<NodeName, HashMap<PartitionKey, Digest>>,
    /// The names of the pipeline's stages.
    stages: BTreeSet<&'a StageName>,
    state: State<'a>,
    /// Outputs whose partitions are unknown until others have run.
    unknown: Vec<NodeName>,
}

impl Planner<'_> {
    fn node(&mut self, node: &Node) -> Result<PlannedNode, Failure> {
        if self.options.only_recalls(&node.name.stage) {
            return self.recalled(node);
        }
        let waits = node
            .reads
            .values()
            .any(|source| self.unknown.contains(source));
        let listing = if waits {
            None
        } else {
            self.state.listing(node)?
        };
        let Some(listing) = listing else {
            self.unknown.push(node.name.clone());
            return Ok(PlannedNode {
                node: node.name.clone(),
                units: None,
                may_grow: true,
            });
        };
        let Listing {
            units,
            certainty,
            may_grow,
        } = listing;
        let mut planned = Vec::with_capacity(units.len());
        let mut known = BTreeMap::new();
        let mut open = Vec::new();
        for (unit, certainty) in units.iter().zip(certainty) {
            let (state, outcome) = self.unit(node, unit, certainty)?;
            match (&state, outcome) {
                (UnitState::Cached | UnitState::Depot { .. }, Some(outcome)) => {
                    let made = self.state.learn(&node.name, &unit.partition, outcome);
                    known.extend(made.map(|known| (unit.partition.clone(), known)));
                }
                _ => open.push(unit),
            }
            planned.push(PlannedUnit {
                partition: unit.partition.clone(),
                state,
            });
        }
        for unit in open {
            let (labels, predicted) = match &unit.labels {
                Some(labels) => (labels.clone(), LabelsPredicted::Yes),
                None => (self.last_labels(node, unit)?, LabelsPredicted::No),
            };
            known.insert(
                unit.partition.clone(),
                PartitionState::Open { labels, predicted },
            );
        }
        self.state.insert(&node.name, known);
        if may_grow {
            self.state.grows(&node.name);
        }
        Ok(PlannedNode {
            node: node.name.clone(),
            units: Some(planned),
            may_grow,
        })
    }

    /// A node that a run takes from the store as it is.
    fn recalled(&mut self, node: &Node) -> Result<PlannedNode, Failure> {
        let store = self.store;
        let units = self.state.recall(node, |digest| store.lookup(digest))?;
        let units = units.into_iter().map(|unit| PlannedUnit {
            partition: unit.partition,
            state: UnitState::Cached,
        });
        Ok(PlannedNode {
            node: node.name.clone(),
            units: Some(units.collect()),
            may_grow: false,
        })
    }

    /// Returns whether a unit would run, and its result if it is in the store.
    fn unit(
        &self,
        node: &Node,
        unit: &ListedUnit,
        certainty: Certainty,
    ) -> Result<(UnitState, Option<Arc<RecordOutcome>>), Failure> {
        let forced = self.options.is_forced(&node.name.stage);
        let Some((fingerprint, digest)) = self.state.fingerprint(node, unit)? else {
            let upstream = self.waits_for(node, unit);
            let (causes, is_certain) = if forced {
                (vec![Cause::Forced], certainty >= Certainty::Exists)
            } else {
                let (causes, is_new) = self.causes_so_far(node, unit)?;
                (causes, is_new && certainty >= Certainty::OwnFiles)
            };
            let state = if is_certain {
                UnitState::Run { causes, upstream }
            } else {
                UnitState::Pending { upstream, causes }
            };
            return Ok((state, None));
        };
        let cached = if forced {
            None
        } else {
            let outcome = self.store.lookup(&digest)?;
            outcome.filter(|outcome| !outcome.is_provisional())
        };
        let state = match &cached {
            Some(outcome) if certainty == Certainty::Exact => {
                match self.store.bytes_elsewhere(outcome) {
                    0 => UnitState::Cached,
                    bytes => UnitState::Depot { bytes },
                }
            }
            Some(_) => UnitState::Pending {
                upstream: self.open_inputs(node),
                causes: Vec::new(),
            },
            None => {
                let causes = if forced {
                    vec![Cause::Forced]
                } else {
                    self.causes(node, &fingerprint)?
                };
                if certainty == Certainty::Exact || (forced && certainty >= Certainty::Exists) {
                    let upstream = Vec::new();
                    UnitState::Run { causes, upstream }
                } else {
                    let upstream = self.open_inputs(node);
                    UnitState::Pending { upstream, causes }
                }
            }
        };
        Ok((state, cached))
    }

    fn last(&self, node: &Node, partition: &PartitionKey) -> Option<&Digest> {
        self.last.get(&node.name)?.get(partition)
    }

    /// The differences from the last time; a unit without differences has lost its files.
    fn causes(&self, node: &Node, fingerprint: &Fingerprint) -> Result<Vec<Cause>, Failure> {
        let Some(last) = self.last(node, &fingerprint.partition) else {
            let renamed = self.renamed(node, fingerprint)?;
            return Ok(renamed.map_or_else(
                || vec![Cause::New],
                |before| fingerprint.differences(&before),
            ));
        };
        let Some(record) = self.store.remembered(last)? else {
            return Ok(vec![Cause::Lost]);
        };
        let differences = fingerprint.differences(&record.fingerprint);
        Ok(
            if differences.is_empty() && record.outcome.is_provisional() {
                vec![Cause::Provisional]
            } else if differences.is_empty() {
                vec![Cause::Lost]
            } else {
                differences
            },
        )
    }

    /// The known differences from the last time of a unit whose fingerprint is incomplete, and
    /// whether they alone distinguish it from every stored unit.
    fn causes_so_far(&self, node: &Node, unit: &ListedUnit) -> Result<(Vec<Cause>, bool), Failure> {
        let Some((own, _)) = self.state.own_fingerprint(node, unit)? else {
            return Ok((Vec::new(), false));
        };
        let causes = match self.last(node, &unit.partition) {
            Some(last) => {
                let record = self.store.remembered(last)?;
                record.map_or_else(Vec::new, |record| own.own_differences(&record.fingerprint))
            }
            None => self
                .renamed(node, &own)?
                .map_or_else(|| vec![Cause::New], |before| own.own_differences(&before)),
        };
        let is_new = !causes.is_empty() && !self.store.may_hold(&own)?;
        Ok((causes, is_new))
    }

    /// Finds the unit of a removed stage that differs from this one only by name and inputs; of
    /// several, the one that differs least.
    fn renamed(&self, node: &Node, unit: &Fingerprint) -> Result<Option<Fingerprint>, Failure> {
        let mut found: Option<(usize, Fingerprint)> = None;
        for (name, units) in &self.last {
            let Some(last) = units.get(&unit.partition) else {
                continue;
            };
            let is_gone = !self.stages.contains(&name.stage);
            if !is_gone || name.artifact != node.name.artifact {
                continue;
            }
            let Some(record) = self.store.remembered(last)? else {
                continue;
            };
            let before = record.fingerprint;
            if before.recipe == unit.recipe {
                let n = unit.differences(&before).len();
                if found.as_ref().is_none_or(|(least, _)| n < *least) {
                    found = Some((n, before));
                }
            }
        }
        Ok(found.map(|(_, before)| before))
    }

    /// The labels that a unit had the last time.
    fn last_labels(&self, node: &Node, unit: &ListedUnit) -> Result<Labels, Failure> {
        let outcome = match self.last(node, &unit.partition) {
            Some(last) => self.store.recall(last)?,
            None => None,
        };
        Ok(outcome.map_or_else(Labels::new, |outcome| outcome.labels().clone()))
    }

    /// The outputs of which a unit reads a partition that is not made yet.
    fn waits_for(&self, node: &Node, unit: &ListedUnit) -> Vec<NodeName> {
        let is_open = |source: &NodeName, key: &PartitionKey| {
            matches!(
                self.state.known(source, key),
                Some(PartitionState::Open { .. })
            )
        };
        node.reads
            .iter()
            .filter(|(input, source)| {
                let keys = unit.reads.get(*input);
                keys.is_some_and(|keys| keys.iter().any(|key| is_open(source, key)))
            })
            .map(|(_, source)| source.clone())
            .collect()
    }

    /// The incomplete outputs among a node's inputs.
    fn open_inputs(&self, node: &Node) -> Vec<NodeName> {
        let sources = node.reads.values();
        sources
            .filter(|source| self.state.is_open(source))
            .cloned()
            .collect()
    }
}
