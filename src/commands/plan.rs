//! `pipeline plan`

use std::{cell::RefCell, collections::BTreeMap};

use dataflow::{Cause, NodeName, Plan, PlannedUnit, UnitState};
use serde::Serialize;

use crate::{
    arguments::{Format, PlanArgs},
    command_line::Program,
    commands::{
        pipeline_file,
        query::page::Page,
        sweep::{self, VariantResult},
    },
    label::Label,
    outcome::{CommandError, CommandOutcome},
    report::{self, LabeledRow, Line},
};

/// Partitions, and files among the causes, named in one line of the text.
const NAMED: usize = 3;

/// The plan of one of several variants.
#[derive(Serialize)]
struct Variant {
    variant: String,
    plan: Plan,
}

/// Shows what `run` would do, and why, for every variant.
pub(crate) fn plan(program: &Program, args: &PlanArgs) -> Result<CommandOutcome, CommandError> {
    let several = RefCell::new(Vec::new());
    let outcome = sweep::each(program, &args.pipeline, |label, pipeline| {
        let args = PlanArgs {
            pipeline,
            ..args.clone()
        };
        plan_variant(program, &args, label, &several)
    });
    let several = several.into_inner();
    if !several.is_empty() {
        // One document, whatever the number of variants.
        report::json(&several)?;
    }
    outcome
}

fn plan_variant(
    program: &Program,
    args: &PlanArgs,
    label: Option<&str>,
    several: &RefCell<Vec<Variant>>,
) -> Result<VariantResult, CommandError> {
    let pipeline = pipeline_file::read(program.kinds, &args.pipeline)?;
    let options = pipeline_file::options(&args.pipeline, None);
    let lake = program.open_lake()?;
    let plan = dataflow::plan(&pipeline, &lake, &options)?;
    program.say_shared(&lake)?;
    match (args.format, label) {
        (Format::Text, _) => report::lines(&lines(&plan, Page::of_stdout().width))?,
        (Format::Json, None) => report::json(&plan)?,
        (Format::Json, Some(label)) => several.borrow_mut().push(Variant {
            variant: label.to_owned(),
            plan,
        }),
    }
    Ok(VariantResult::without_summary(CommandOutcome::Done))
}

/// One line per output and cause, cut to a width if there is one.
pub(crate) fn lines(plan: &Plan, width: Option<usize>) -> Vec<Line> {
    if plan.is_up_to_date() {
        return vec![Line::labeled(Label::Cached, "  everything; nothing to run")];
    }
    let outputs = plan.nodes.iter().map(|node| node.node.to_string().len());
    // The preceding columns have the width of their widest words.
    let room =
        width.map(|width| width.saturating_sub("pending".len() + outputs.max().unwrap_or(0) + 4));
    let mut rows: Vec<LabeledRow> = Vec::new();
    let mut row = |state: Label, node: String, what: String| {
        rows.push((state, vec![node, what]));
    };
    for node in &plan.nodes {
        let name = node.node.to_string();
        let Some(units) = &node.units else {
            row(
                Label::Pending,
                name,
                "known once its inputs exist".to_owned(),
            );
            continue;
        };
        let n_cached = units
            .iter()
            .filter(|unit| unit.state == UnitState::Cached)
            .count();
        let in_depot = units.iter().filter_map(|unit| match unit.state {
            UnitState::Depot { bytes } => Some(bytes),
            _ => None,
        });
        let in_depot: Vec<u64> = in_depot.collect();
        if n_cached > 0 {
            row(
                Label::Cached,
                name.clone(),
                format!("{n_cached} of {}", units.len()),
            );
        }
        if !in_depot.is_empty() {
            let (n, bytes) = (in_depot.len(), report::bytes(in_depot.iter().sum()));
            let what = format!("{n} of {}, up to {bytes} to fetch", units.len());
            row(Label::Depot, name.clone(), what);
        }
        if node.may_grow {
            row(
                Label::Pending,
                name.clone(),
                "more partitions if upstream labels change".to_owned(),
            );
        }
        for (cause, partitions) in by_cause(units) {
            let (state, cause) = cause;
            row(state, name.clone(), named(&partitions, &cause, room));
        }
    }
    let lines = report::labeled_rows(&rows, 0).into_iter();
    match width {
        Some(width) => lines.map(|line| line.cut(width)).collect(),
        None => lines.collect(),
    }
}

/// Groups the units that may run by their causes.
fn by_cause(units: &[PlannedUnit]) -> BTreeMap<(Label, String), Vec<&str>> {
    let mut groups: BTreeMap<_, Vec<&str>> = BTreeMap::new();
    for unit in units {
        let key = match &unit.state {
            UnitState::Cached | UnitState::Depot { .. } => continue,
            UnitState::Run { causes, upstream } => {
                let mut reasons = describe_causes(causes);
                if !upstream.is_empty() {
                    reasons.push(needs(upstream));
                }
                (Label::Run, reasons.join("; "))
            }
            UnitState::Pending { upstream, causes } => {
                let mut reasons = vec![needs(upstream)];
                reasons.extend(describe_causes(causes));
                (Label::Pending, reasons.join("; "))
            }
        };
        groups.entry(key).or_default().push(unit.partition.as_str());
    }
    groups
}

/// Describes the awaited outputs.
fn needs(upstream: &[NodeName]) -> String {
    let upstream: Vec<String> = upstream.iter().map(ToString::to_string).collect();
    format!("needs the new {}", upstream.join(", "))
}

/// Describes the causes. Of many files, names the first ones and counts the rest, or only mentions
/// them if a fact gives the reason: then units with the same cause share a line.
fn describe_causes(causes: &[Cause]) -> Vec<String> {
    let is_file = |cause: &&Cause| matches!(cause, Cause::File { .. });
    let (files, others): (Vec<&Cause>, Vec<&Cause>) = causes.iter().partition(is_file);
    let mut texts: Vec<String> = others.iter().map(ToString::to_string).collect();
    let is_fact = |cause: &&Cause| matches!(cause, Cause::Fact { .. });
    if files.len() > NAMED && others.iter().any(is_fact) {
        texts.push("other files".to_owned());
        return texts;
    }
    texts.extend(files.iter().take(NAMED).map(ToString::to_string));
    if files.len() > NAMED {
        texts.push(format!("{} more files", files.len() - NAMED));
    }
    texts
}

/// Names the first partitions before their cause, as many as fit.
fn named(partitions: &[&str], cause: &str, room: Option<usize>) -> String {
    let with = |n: usize| {
        let names = partitions.iter().take(n);
        let names: Vec<String> = names.map(|name| format!("`{name}`")).collect();
        let text = match partitions.len().saturating_sub(n) {
            0 => names.join(", "),
            1 if n == 0 => "1 unit".to_owned(),
            all if n == 0 => format!("{all} units"),
            more => format!("{} and {more} more", names.join(", ")),
        };
        format!("{text}: {cause}")
    };
    let fits = |text: &String| room.is_none_or(|room| text.chars().count() <= room);
    let mut fewer = (0..=NAMED).rev().map(with);
    fewer.find(fits).unwrap_or_else(|| with(0))
}

#[cfg(test)]
mod tests {
    use dataflow::{Change, Digest};

    use super::*;

    fn file(number: usize) -> Cause {
        Cause::File {
            file: format!("f{number}"),
            change: Change::Added,
            old: None,
            new: Some(Digest::of_bytes(b"f")),
        }
    }

    #[test]
    fn as_many_partitions_are_named_as_there_is_room_for() {
        let partitions = ["025_mug", "024_bowl", "011_banana", "006_bottle"];
        let cause = "never made";
        let all = named(&partitions, cause, None);
        assert_eq!(
            all,
            "`025_mug`, `024_bowl`, `011_banana` and 1 more: never made"
        );
        for room in 0..80 {
            let text = named(&partitions, cause, Some(room));
            assert!(text.ends_with(": never made"), "{text}");
            assert!(text.chars().count() <= room.max(24), "{room}: {text}");
        }
        assert_eq!(named(&partitions, cause, Some(10)), "4 units: never made");
        assert_eq!(
            named(&partitions[..1], cause, Some(30)),
            "`025_mug`: never made"
        );
    }

    #[test]
    fn many_files_are_counted_after_the_facts_of_the_listing() {
        let files: Vec<Cause> = (0..50).map(file).collect();
        assert_eq!(describe_causes(&files[..3]).len(), 3);
        let many = describe_causes(&files);
        assert_eq!(many.len(), 4);
        assert!(many[0].starts_with("file `f0` added"), "{many:?}");
        assert_eq!(many[3], "47 more files");
        let fact = Cause::Fact {
            fact: "left out".to_owned(),
            old: Some("left hand".to_owned()),
            new: None,
        };
        let all: Vec<Cause> = files.into_iter().chain([fact]).collect();
        assert_eq!(describe_causes(&all), ["no longer left out", "other files"]);
    }
}
