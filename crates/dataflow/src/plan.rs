//! What a run would do, and why.

use std::collections::{BTreeMap, HashMap};

use serde::Serialize;

use crate::{
    error::Failure,
    fingerprint::Cause,
    graph::NodeName,
    pipeline::Pipeline,
    run::RunOptions,
    state::{Known, State},
    store::{RecordOutcome, Store},
};

/// What a run would do.
#[derive(Debug, Clone, Serialize)]
pub struct Plan {
    /// Every output in the order in which it would be made.
    pub nodes: Vec<PlannedNode>,
}

/// What a run would do for one output.
#[derive(Debug, Clone, Serialize)]
pub struct PlannedNode {
    /// The output.
    pub node: NodeName,
    /// Its units; `None` if they are only known when what it reads has been made.
    pub units: Option<Vec<PlannedUnit>>,
}

/// What a run would do for one unit.
#[derive(Debug, Clone, Serialize)]
pub struct PlannedUnit {
    /// The partition's key.
    pub partition: String,
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
    /// It would run.
    Run {
        /// Everything that differs from the last time.
        causes: Vec<Cause>,
    },
    /// It would run unless what it reads comes out with the same bytes as before.
    Perhaps {
        /// The outputs it waits for.
        upstream: Vec<NodeName>,
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

/// Finds out what a run would do, without making anything in the lake.
///
/// # Errors
///
/// Fails if a stage cannot list its units or the store cannot be read.
pub fn plan(pipeline: &Pipeline, store: &dyn Store, options: &RunOptions) -> Result<Plan, Failure> {
    let nodes = options.nodes(pipeline)?;
    for stage in &pipeline.stages {
        if nodes.iter().any(|node| node.name.stage == stage.name) {
            stage
                .configured
                .prepare()
                .map_err(|source| Failure::Stage {
                    stage: stage.name.clone(),
                    partition: None,
                    source,
                })?;
        }
    }
    let last: HashMap<(NodeName, String), _> = store
        .newest_units(&pipeline.name)?
        .into_iter()
        .map(|unit| ((unit.node, unit.partition), unit.fingerprint))
        .collect();
    let mut state = State::new(pipeline, store);
    let mut planned = Vec::new();
    // Outputs whose partitions are not known before something else has run.
    let mut unknown: Vec<&NodeName> = Vec::new();
    for node in &nodes {
        if node.reads.values().any(|source| unknown.contains(&source)) {
            unknown.push(&node.name);
            planned.push(PlannedNode {
                node: node.name.clone(),
                units: None,
            });
            continue;
        }
        let mut units = Vec::new();
        let mut partitions = BTreeMap::new();
        for unit in state.units(node)? {
            let fingerprint = state.fingerprint(node, &unit)?;
            let last = last.get(&(node.name.clone(), unit.partition.clone()));
            let remembered = match last {
                Some(fingerprint) => store.remembered(fingerprint)?,
                None => None,
            };
            let forced = options.is_forced(&node.name.stage);
            let cached = match &fingerprint {
                Some(fingerprint) if !forced => store.lookup(&fingerprint.digest())?,
                _ => None,
            };
            let state_of_unit = match (&fingerprint, &cached) {
                (Some(_), Some(_)) => UnitState::Cached,
                (Some(fingerprint), None) => {
                    let causes = match &remembered {
                        _ if forced => vec![Cause::Forced],
                        Some(record) => fingerprint.differences(&record.fingerprint),
                        None => vec![Cause::New],
                    };
                    let causes = if causes.is_empty() {
                        vec![Cause::Lost]
                    } else {
                        causes
                    };
                    UnitState::Run { causes }
                }
                (None, _) => UnitState::Perhaps {
                    upstream: node
                        .reads
                        .iter()
                        .filter(|(input, source)| {
                            unit.reads.get(*input).is_some_and(|keys| {
                                keys.iter().any(|key| {
                                    state
                                        .known(source, key)
                                        .is_some_and(|known| known.outcome.is_none())
                                })
                            })
                        })
                        .map(|(_, source)| source.clone())
                        .collect(),
                },
            };
            let known = match cached
                .or_else(|| remembered.filter(|_| state_of_unit != UnitState::Cached))
            {
                Some(record) => known_from(&record.outcome, state_of_unit == UnitState::Cached),
                None => {
                    // A unit that was never made has labels nobody knows yet.
                    if !unknown.contains(&&node.name) {
                        unknown.push(&node.name);
                    }
                    None
                }
            };
            if let Some(known) = known {
                partitions.insert(unit.partition.clone(), known);
            }
            units.push(PlannedUnit {
                partition: unit.partition,
                state: state_of_unit,
            });
        }
        state.insert(&node.name, partitions);
        planned.push(PlannedNode {
            node: node.name.clone(),
            units: Some(units),
        });
    }
    Ok(Plan { nodes: planned })
}

/// What later outputs may assume of a unit: its bytes if it is cached, its labels if it was made
/// before, nothing if it was left out.
fn known_from(outcome: &RecordOutcome, is_cached: bool) -> Option<Known> {
    match outcome {
        RecordOutcome::Made { labels, .. } => Some(Known {
            labels: labels.clone(),
            outcome: is_cached.then(|| outcome.clone()),
        }),
        RecordOutcome::Skipped { .. } | RecordOutcome::Filtered { .. } => None,
    }
}
