//! `plan` predicts what `run` does, over random edits of everything that a result depends on.
//!
//! A model of a few lines computes what must be made and why; the plan, the run and the published
//! files are compared with it after every edit.

mod edits;
mod model;
mod world;

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
};

use dataflow::{
    Cause, Failure, Pipeline, Plan, PlannedNode, RunOptions, RunReport, StoreUse, UnitState, plan,
    run,
};
use lake::Lake;
use rand::Rng;
use serde_json::Value;

use self::{
    edits::Step,
    model::{Expected, Model, Unit},
    world::World,
};
use crate::engine::{
    own_stages,
    place::{Place, chances, number, read},
};

/// Edits to one lake before the next one starts empty.
const EDITS_PER_LAKE: usize = 60;

#[test]
fn a_plan_names_exactly_what_a_run_makes_and_why() {
    let mut rng = chances("plan equals run");
    let n_edits: usize = number("PIPELINE_EDITS", 300);
    for lake in 0..n_edits.div_ceil(EDITS_PER_LAKE) {
        let place = Place::new("");
        let mut world = World::new(&place);
        let mut model = Model::default();
        let mut history = vec!["nothing yet".to_owned()];
        let n_here = EDITS_PER_LAKE.min(n_edits - lake * EDITS_PER_LAKE);
        for _ in 0..=n_here {
            let step = Step::draw(&mut rng, &world);
            let faults = check(&place, &mut world, &mut model, &step);
            assert!(
                faults.is_empty(),
                "after {history:#?} with {step:?}:\n{}\n{}",
                faults.join("\n"),
                world.pipeline_file()
            );
            // Several edits at once now and then.
            let n_at_once = if rng.random_bool(0.2) { 3 } else { 1 };
            for _ in 0..n_at_once {
                history.push(edits::edit(&mut rng, &mut world));
            }
        }
    }
}

/// Plans and runs; returns everything in which plan, run and model disagree.
fn check(place: &Place, world: &mut World, model: &mut Model, step: &Step) -> Vec<String> {
    world.write(place);
    let kinds = own_stages::kinds_with(|kind| world.version(kind));
    let source = world.pipeline_file();
    let pipeline = Pipeline::parse(&place.pipeline(), &source, &kinds, None, &[]).unwrap();
    let options = RunOptions {
        until: step.until.clone(),
        only: step.only.clone(),
        fresh: step.fresh.clone(),
        fresh_all: if step.fresh_all {
            StoreUse::MakeAgain
        } else {
            StoreUse::UseStore
        },
        ..RunOptions::default()
    };
    let planned = plan(&pipeline, &Lake::open(&place.lake()), &options);
    let ran = run(
        &pipeline,
        &Lake::open(&place.lake()),
        &options,
        None,
        &|_| {},
    );
    let only = step.only.as_deref();
    if let Some(lacking) = only.and_then(|only| model.lacking(world, only)) {
        return compare_refused(&lacking, planned.err(), ran.err());
    }
    let (planned, ran) = (planned.unwrap(), ran.unwrap());
    let visited: BTreeSet<String> = ran
        .nodes
        .iter()
        .map(|node| node.record.node.stage.to_string())
        .collect();
    let expected = model.run(world, &visited, |stage| {
        step.fresh_all || step.fresh.iter().any(|fresh| fresh == stage)
    });

    let mut faults = Vec::new();
    if let Some(until) = &step.until {
        let needed = world.with_ancestors(until);
        if !needed.is_subset(&visited) {
            faults.push(format!("`--until {until}` came to {visited:?} alone"));
        }
    }
    compare_made(&expected, &ran, &mut faults);
    let planned = without_recalled(planned, only, &mut faults);
    compare_planned(world, &expected, &planned, &ran, &mut faults);
    compare_published(&place.lake(), &visited, &expected, &mut faults);
    let again = RunOptions {
        until: step.until.clone(),
        only: step.only.clone(),
        ..RunOptions::default()
    };
    let left = plan(&pipeline, &Lake::open(&place.lake()), &again).unwrap();
    if !left.is_up_to_date() {
        faults.push(format!("after the run there is still to do: {left:?}"));
    }
    faults
}

/// A single stage cannot run while one of its inputs was never made: plan and run fail with the
/// same error.
fn compare_refused(lacking: &Unit, planned: Option<Failure>, ran: Option<Failure>) -> Vec<String> {
    let mut faults = Vec::new();
    for (what, failure) in [("plan", planned), ("run", ran)] {
        if !matches!(failure, Some(Failure::NotMade { .. })) {
            faults.push(format!("{lacking} is not there; {what}: {failure:?}"));
        }
    }
    faults
}

/// The part of a plan about the selected stages; the others are only recalled.
fn without_recalled(mut planned: Plan, only: Option<&str>, faults: &mut Vec<String>) -> Plan {
    let Some(only) = only else {
        return planned;
    };
    let is_recalled = |node: &PlannedNode| node.node.stage != *only;
    for node in planned.nodes.iter().filter(|node| is_recalled(node)) {
        let mut units = node.units.iter().flatten();
        if node.units.is_none() || units.any(|unit| unit.state != UnitState::Cached) {
            faults.push(format!("only {only} is gone through, but {node:?}"));
        }
    }
    planned.nodes.retain(|node| !is_recalled(node));
    planned
}

/// The run makes what the model makes, no more and no less.
fn compare_made(expected: &BTreeMap<Unit, Expected>, ran: &RunReport, faults: &mut Vec<String>) {
    let units = ran.nodes.iter().flat_map(|node| {
        let units = node.units.iter();
        units.map(|unit| {
            (
                Unit::new(node.record.node.stage.as_str(), unit.partition.as_str()),
                unit.made_now,
            )
        })
    });
    let ran: BTreeMap<Unit, bool> = units.collect();
    let model: BTreeMap<Unit, bool> = expected
        .iter()
        .map(|(unit, expected)| (unit.clone(), expected.made))
        .collect();
    let all: BTreeSet<&Unit> = ran.keys().chain(model.keys()).collect();
    for unit in all {
        let (ran, model) = (ran.get(unit), model.get(unit));
        if ran != model {
            faults.push(format!("{unit}: run made {ran:?}, model {model:?}"));
        }
    }
}

/// Every unit made was announced, every unit announced for certain was made, for the causes that the
/// model knows, and only what waits for something is uncertain.
fn compare_planned(
    world: &World,
    expected: &BTreeMap<Unit, Expected>,
    planned: &Plan,
    ran: &RunReport,
    faults: &mut Vec<String>,
) {
    let nodes = |names: Vec<String>| names.join(", ");
    let of_plan = planned.nodes.iter().map(|node| node.node.to_string());
    let of_run = ran.nodes.iter().map(|node| node.record.node.to_string());
    if nodes(of_plan.clone().collect()) != nodes(of_run.clone().collect()) {
        faults.push(format!(
            "plan goes through {}; run through {}",
            nodes(of_plan.collect()),
            nodes(of_run.collect())
        ));
    }
    let unknown: BTreeSet<&str> = planned
        .nodes
        .iter()
        .filter(|node| node.units.is_none())
        .map(|node| node.node.stage.as_str())
        .collect();
    let growing: BTreeSet<&str> = planned
        .nodes
        .iter()
        .filter(|node| node.may_grow)
        .map(|node| node.node.stage.as_str())
        .collect();
    let mut states = BTreeMap::new();
    for node in &planned.nodes {
        for unit in node.units.iter().flatten() {
            let name = Unit::new(node.node.stage.as_str(), unit.partition.as_str());
            states.insert(name, unit.state.clone());
        }
    }
    for (unit, expected) in expected.iter().filter(|(_, expected)| expected.made) {
        let is_announced = match states.get(unit) {
            Some(UnitState::Run { .. } | UnitState::Pending { .. }) => true,
            Some(UnitState::Cached | UnitState::Depot { .. }) => false,
            None => growing.contains(unit.stage.as_str()),
        };
        if !is_announced {
            faults.push(format!(
                "{unit}: made for {:?}, but the plan says {:?}",
                expected.causes,
                states.get(unit)
            ));
        }
    }
    for (unit, state) in &states {
        match state {
            UnitState::Run { causes, upstream } => {
                let made = expected.get(unit).filter(|expected| expected.made);
                match made {
                    None => faults.push(format!("{unit}: certain by {causes:?}, but not made")),
                    Some(expected) if upstream.is_empty() => {
                        compare_causes(unit, expected, causes, faults);
                    }
                    // What is to be made may be a cause more.
                    Some(expected) => {
                        let named: BTreeSet<String> = causes.iter().map(named).collect();
                        let is_forced = expected.forced && named == ["forced".to_owned()].into();
                        if !is_forced && !named.is_subset(&expected.causes) {
                            let all = &expected.causes;
                            faults.push(format!(
                                "{unit}: the plan says {named:?}, the model {all:?}"
                            ));
                        }
                    }
                }
            }
            UnitState::Pending { .. } => {
                if !waits(world, expected, &states, &unknown, unit) {
                    faults.push(format!("{unit}: uncertain, but waits for nothing"));
                }
            }
            UnitState::Cached | UnitState::Depot { .. } => {}
        }
    }
}

/// Whether a unit's inputs are unknown until other units have run.
fn waits(
    world: &World,
    expected: &BTreeMap<Unit, Expected>,
    states: &BTreeMap<Unit, UnitState>,
    unknown: &BTreeSet<&str>,
    unit: &Unit,
) -> bool {
    let Some(upstream) = world.reads(&unit.stage) else {
        return false;
    };
    let reads_one = world.is_map(&unit.stage);
    let mut open = states
        .iter()
        .filter(|(read, state)| read.stage == upstream && **state != UnitState::Cached);
    unknown.contains(upstream)
        || open.any(|(read, _)| {
            // A partition that was there before changes nothing for those that read another one.
            let was_part = expected.get(read).is_some_and(|read| read.was_part);
            !reads_one || !was_part || read.partition == unit.partition
        })
}

fn compare_causes(unit: &Unit, expected: &Expected, causes: &[Cause], faults: &mut Vec<String>) {
    let mut named: BTreeSet<String> = causes.iter().map(named).collect();
    if expected.forced {
        // Whether more is said than that it was asked for is a matter of taste.
        if !named.remove("forced") {
            faults.push(format!("{unit}: forced, but the plan says {named:?}"));
        }
        if named.is_empty() {
            return;
        }
    }
    if named != expected.causes {
        faults.push(format!(
            "{unit}: the plan says {named:?}, the model {:?}",
            expected.causes
        ));
    }
}

/// A cause as the model writes it.
fn named(cause: &Cause) -> String {
    let cause = serde_json::to_value(cause).unwrap();
    let word = |key: &str| match &cause[key] {
        Value::String(text) => text.clone(),
        other => other.to_string(),
    };
    match word("cause").as_str() {
        "config" => format!("config {} {} {}", word("key"), cause["old"], cause["new"]),
        "code" => format!("code {}", word("part")),
        "file" => format!("file {} {}", word("file"), word("change")),
        "input" => format!(
            "input {} {} {}",
            word("input"),
            word("partition"),
            word("change")
        ),
        other => other.to_owned(),
    }
}

/// The published files of the visited stages equal the model's, byte for byte.
fn compare_published(
    lake: &Path,
    visited: &BTreeSet<String>,
    expected: &BTreeMap<Unit, Expected>,
    faults: &mut Vec<String>,
) {
    let mut shown = BTreeMap::new();
    for stage in visited {
        let parts = lake.join("files/own").join(stage).join("parts");
        for part in fs::read_dir(parts).into_iter().flatten() {
            let part = part.unwrap();
            let unit = Unit::new(stage, &part.file_name().to_string_lossy());
            shown.insert(unit, read(&part.path().join("data.bin")));
        }
    }
    let model: BTreeMap<Unit, Vec<u8>> = expected
        .iter()
        .filter_map(|(unit, expected)| Some((unit.clone(), expected.data.clone()?)))
        .collect();
    if shown != model {
        faults.push(format!("the lake shows {shown:?}, the model {model:?}"));
    }
}
