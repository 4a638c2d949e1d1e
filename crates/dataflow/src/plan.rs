//! What a run would do, and why.

use std::collections::{BTreeMap, HashMap};

use serde::Serialize;

use crate::{
    error::Failure,
    fingerprint::{Cause, Fingerprint},
    graph::{Node, NodeName},
    pipeline::Pipeline,
    run::RunOptions,
    state::{Known, State},
    store::{Record, RecordOutcome, Store},
    unit::Unit,
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
            stage.prepare()?;
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
            let unit_state = match (&fingerprint, &cached) {
                (Some(_), Some(_)) => UnitState::Cached,
                (Some(_), None) if forced => UnitState::Run {
                    causes: vec![Cause::Forced],
                },
                (Some(fingerprint), None) => UnitState::Run {
                    causes: causes(fingerprint, remembered.as_ref()),
                },
                (None, _) => UnitState::Perhaps {
                    upstream: waits_for(&state, node, &unit),
                },
            };
            let is_cached = unit_state == UnitState::Cached;
            if let Some(record) = cached.or(remembered) {
                if let Some(known) = known_from(&record.outcome, is_cached) {
                    partitions.insert(unit.partition.clone(), known);
                }
            } else if !unknown.contains(&&node.name) {
                // A unit that was never made has labels nobody knows yet.
                unknown.push(&node.name);
            }
            units.push(PlannedUnit {
                partition: unit.partition,
                state: unit_state,
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

/// What differs from the last time; a unit of which nothing differs has lost its files.
fn causes(fingerprint: &Fingerprint, last: Option<&Record>) -> Vec<Cause> {
    let Some(last) = last else {
        return vec![Cause::New];
    };
    let differences = fingerprint.differences(&last.fingerprint);
    if differences.is_empty() {
        vec![Cause::Lost]
    } else {
        differences
    }
}

/// The outputs read by a unit of which a partition is yet to be made.
fn waits_for(state: &State, node: &Node, unit: &Unit) -> Vec<NodeName> {
    let is_open = |source: &NodeName, key: &String| {
        let known = state.known(source, key);
        known.is_some_and(|known| known.outcome.is_none())
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
