//! Making one unit by its name, or by its work item.

use std::collections::BTreeMap;

use toml_edit::{Document, Value};

use crate::{
    error::Failure,
    event::Events,
    executor::UnitOutcome,
    fingerprint::OutputFingerprint,
    kind::Kind,
    name::UnitName,
    output::Execution,
    pipeline::{Pipeline, StageEntry},
    resources::Resources,
    retry_scheduler::{RetryScheduler, UnitReport},
    state::{Certainty, Listing, State, code_parts},
    store::Store,
    unit_runner::UnitRunner,
    work_item::{Recompute, WorkItem},
};

/// Makes one unit of a pipeline whose inputs are all in the store.
///
/// # Errors
///
/// Fails if there is no such unit, if one of its inputs is not made yet, or if its stage fails.
pub fn make_one(
    pipeline: &Pipeline,
    store: &dyn Store,
    unit: &UnitName,
    forced: Recompute,
    events: &Events,
) -> Result<UnitReport, Failure> {
    let mut state = State::new(pipeline, store);
    store.enter(&pipeline.name)?;
    for node in pipeline.upstream_of(&unit.node) {
        state.recall_some(node, Certainty::Exact, |digest| store.recall(digest))?;
    }
    let mut nodes = pipeline.nodes.iter();
    let no_node = || Failure::NoNode {
        name: unit.node.to_string(),
        known: pipeline
            .nodes
            .iter()
            .map(|node| node.name.to_string())
            .collect(),
    };
    let node = nodes
        .find(|node| node.name == unit.node)
        .ok_or_else(no_node)?;
    let not_made = |unit| Failure::NotMade { unit };
    let Some(Listing {
        units, certainty, ..
    }) = state.listing(node)?
    else {
        let nothing = || Failure::Nothing {
            node: node.name.clone(),
            left_out: None,
        };
        return Err(state.first_open(node).map_or_else(nothing, not_made));
    };
    let mut found = units.iter().zip(certainty);
    let no_partition = || Failure::NoPartition {
        unit: unit.clone(),
        known: units
            .iter()
            .map(|unit| unit.partition.to_string())
            .collect(),
    };
    let (listed, certainty) = found
        .find(|(listed, _)| listed.partition == unit.partition)
        .ok_or_else(no_partition)?;
    // Inputs that are not made yet may change what the unit reads.
    if certainty != Certainty::Exact
        && let Some(open) = state.first_open(node)
    {
        return Err(not_made(open));
    }
    let made = RetryScheduler::new(store, 0, None, events).make(&state, node, &[listed], forced);
    let lost = || Failure::Lost { unit: unit.clone() };
    made.into_iter().next().ok_or_else(lost)?
}

/// Makes the units of work items, in threads that are started once.
pub struct WorkItemRunner<'a> {
    kinds: &'a [Kind],
    runner: UnitRunner<'a>,
}

impl<'a> WorkItemRunner<'a> {
    /// Makes units with these kinds of stages and up to `jobs` threads, or one per core if 0.
    pub fn new(kinds: &'a [Kind], store: &'a dyn Store, jobs: usize) -> Self {
        Self {
            kinds,
            runner: UnitRunner::new(store, jobs),
        }
    }

    /// Makes the unit of a work item; of the store it uses what the work item names alone.
    ///
    /// # Errors
    ///
    /// Fails if this program's code is not that of the work item, if a file outside the store is not, or if the
    /// stage fails.
    pub fn make(&self, item: &WorkItem, events: &Events) -> Result<UnitOutcome, Failure> {
        let (stage, output_idx) = stage_of(self.kinds, item)?;
        self.runner.check_files(item).map_err(|err| match err {
            Failure::ChangedMeanwhile { path, .. } => Failure::OtherFile {
                unit: item.unit.clone(),
                path,
            },
            err => err,
        })?;
        let made = self.runner.make(&stage, output_idx, item, events)?;
        Ok(made.into())
    }
}

/// Configures the stage of a work item, if this program has its code.
fn stage_of(kinds: &[Kind], item: &WorkItem) -> Result<(StageEntry, usize), Failure> {
    let refused = |parts: Vec<String>| Failure::OtherBuild {
        unit: item.unit.clone(),
        parts,
    };
    let known = |kind: &&Kind| kind.name == item.recipe.kind;
    let mut kind = kinds
        .iter()
        .find(known)
        .cloned()
        .ok_or_else(|| refused(vec![item.recipe.kind.clone()]))?;
    let unreadable = || refused(vec!["its options".to_owned()]);
    let text = format!("options = {}", item.options);
    let document = Document::parse(text).ok();
    let table = document
        .as_ref()
        .and_then(|document| document.get("options")?.as_value());
    let table = table.and_then(Value::as_inline_table).cloned();
    let table = table.ok_or_else(unreadable)?;
    let configured = kind.configure(table).ok().ok_or_else(unreadable)?;
    kind.outputs = configured.outputs();
    let stage = StageEntry {
        name: item.unit.node.stage.clone(),
        kind,
        inputs: item.wires.clone(),
        max_skipped_fraction: 0.0,
        resources: Resources::default(),
        text: item.options.clone(),
        configured,
        places: BTreeMap::new(),
    };
    let mut outputs = stage.kind.outputs.iter().enumerate();
    let (idx, output) = outputs
        .find(|(_, output)| item.unit.node.artifact == *output.artifact)
        .ok_or_else(|| refused(vec![item.recipe.kind.clone()]))?;
    if output.execution != Execution::Parallel {
        return Err(Failure::Physical {
            unit: item.unit.clone(),
        });
    }
    let recipe = OutputFingerprint {
        kind: stage.kind.name.to_owned(),
        output: item.unit.node.artifact.clone(),
        code: code_parts(output.code),
        config: stage.config_of(output.options),
        schema: output.schema.to_owned(),
    };
    if recipe != *item.recipe {
        let (here, there) = (&recipe.code, &item.recipe.code);
        let of_both = here.keys().chain(there.keys());
        let differing = of_both.filter(|part| here.get(*part) != there.get(*part));
        let mut differing: Vec<String> = differing.cloned().collect();
        differing.sort();
        differing.dedup();
        if differing.is_empty() {
            return Err(unreadable());
        }
        return Err(refused(differing));
    }
    if item.whole_fingerprint().digest() != item.fingerprint {
        return Err(unreadable());
    }
    Ok((stage, idx))
}
