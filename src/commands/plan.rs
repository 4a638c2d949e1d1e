//! `pipeline plan`

use std::collections::BTreeMap;

use dataflow::{Plan, PlannedUnit, UnitState};
use lake::Lake;

use crate::{
    arguments::{Format, PlanArgs},
    command_line::Program,
    commands::{
        pipeline_file,
        sweep::{self, Done},
    },
    outcome::{Outcome, Trouble},
    report,
};

/// Partitions named in one line of the text.
const NAMED: usize = 3;

/// Shows what `run` would do, and why, for every variant.
pub(crate) fn plan(program: &Program, args: &PlanArgs) -> Result<Outcome, Trouble> {
    sweep::each(program, &args.pipeline, |pipeline| {
        let args = PlanArgs {
            pipeline,
            ..args.clone()
        };
        plan_variant(program, &args)
    })
}

fn plan_variant(program: &Program, args: &PlanArgs) -> Result<Done, Trouble> {
    let pipeline = pipeline_file::read(program.kinds, &args.pipeline)?;
    let options = pipeline_file::options(&args.pipeline, None);
    let plan = dataflow::plan(&pipeline, &Lake::open(&program.lake), &options)?;
    match args.format {
        Format::Text => report::data(text(&plan).as_bytes()),
        Format::Json => report::json(&plan)?,
    }
    Ok(Done::without_words(Outcome::Done))
}

/// One line per output and cause.
pub(crate) fn text(plan: &Plan) -> String {
    if plan.is_up_to_date() {
        return "cached   everything; nothing to run\n".to_owned();
    }
    let mut rows: Vec<Vec<String>> = Vec::new();
    let mut row = |state: &str, node: String, what: String| {
        rows.push(vec![state.to_owned(), node, what]);
    };
    for node in &plan.nodes {
        let name = node.node.to_string();
        let Some(units) = &node.units else {
            row(
                "perhaps",
                name,
                "known when what it reads has been made".to_owned(),
            );
            continue;
        };
        let n_cached = units
            .iter()
            .filter(|unit| unit.state == UnitState::Cached)
            .count();
        if n_cached > 0 {
            row(
                "cached",
                name.clone(),
                format!("{n_cached} of {}", units.len()),
            );
        }
        if node.may_grow {
            row(
                "perhaps",
                name.clone(),
                "others, if labels of what it reads change".to_owned(),
            );
        }
        for (cause, partitions) in by_cause(units) {
            let (state, cause) = cause;
            row(
                state,
                name.clone(),
                format!("{}: {cause}", named(&partitions)),
            );
        }
    }
    report::columns(&rows, &[])
}

/// Groups the units that may run by everything that causes it.
fn by_cause(units: &[PlannedUnit]) -> BTreeMap<(&'static str, String), Vec<&str>> {
    let mut groups: BTreeMap<_, Vec<&str>> = BTreeMap::new();
    for unit in units {
        let key = match &unit.state {
            UnitState::Cached => continue,
            UnitState::Run { causes } => {
                let causes: Vec<String> = causes.iter().map(ToString::to_string).collect();
                ("run", causes.join("; "))
            }
            UnitState::Perhaps { upstream, causes } => {
                let upstream: Vec<String> = upstream.iter().map(ToString::to_string).collect();
                let mut reasons = vec![format!("needs the new {}", upstream.join(", "))];
                reasons.extend(causes.iter().map(ToString::to_string));
                ("perhaps", reasons.join("; "))
            }
        };
        groups.entry(key).or_default().push(&unit.partition);
    }
    groups
}

fn named(partitions: &[&str]) -> String {
    let mut text = partitions
        .iter()
        .take(NAMED)
        .map(|partition| format!("`{partition}`"))
        .collect::<Vec<_>>()
        .join(", ");
    if partitions.len() > NAMED {
        text.push_str(&format!(" and {} more", partitions.len() - NAMED));
    }
    text
}
