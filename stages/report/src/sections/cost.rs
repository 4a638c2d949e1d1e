//! Outputs, cost and duration of each stage.

use std::collections::BTreeMap;

use schemas::training::Split;

use crate::{
    PageData,
    numbers::{count, duration, signed},
    table::{Cell, DataTable, Section},
};

/// Kinds of stages in the order of the flow; others follow.
const FLOW: [&str; 17] = [
    "ingest",
    "retarget",
    "replay",
    "transfer",
    "train",
    "pretrained",
    "sample",
    "interpolate",
    "eigengrasp",
    "force_closure",
    "grasp_tta",
    "refine",
    "rrt",
    "cem_mpc",
    "screen",
    "dispatch",
    "report",
];

/// Returns the amount of work, by kind of stage.
fn work(gathered: &PageData) -> BTreeMap<&'static str, String> {
    let mut work: BTreeMap<&'static str, String> = BTreeMap::new();
    if let Some(n) = gathered.demonstrations_n {
        let left_out = gathered
            .facts
            .left_out
            .get("demonstrations")
            .into_iter()
            .flatten();
        let left_out_n: usize = left_out.map(|(_, n)| n).sum();
        work.insert(
            "ingest",
            format!("{} recordings", count(signed(n + left_out_n))),
        );
    }
    if let Some(n) = gathered.trajectories_n {
        work.insert("retarget", format!("{} trajectories", count(signed(n))));
    }
    let epochs = gathered
        .training
        .iter()
        .filter(|row| row.split == Split::Training);
    if let Some(n) = epochs.map(|row| row.epoch).max() {
        work.insert("train", format!("{} epochs", count(n)));
    }
    if let Some(draws) = &gathered.draws {
        let refused_n: i64 = draws.refused.values().sum();
        let drawn = format!("{} samples", count(draws.candidates_n + refused_n));
        work.insert("sample", drawn.clone());
        work.insert("refine", drawn);
    }
    let rollouts = || gathered.rollouts.values().flatten();
    if rollouts().next().is_some() {
        let steps_n: i64 = rollouts()
            .map(|one| i64::from(one.measures.control_steps_n))
            .sum();
        let skipped_n: i64 = rollouts()
            .filter_map(|one| one.measures.skipped_steps_n.map(i64::from))
            .sum();
        let mut text = format!(
            "{} control steps simulated, {} saved",
            count(steps_n),
            count(skipped_n)
        );
        if gathered.robustness_steps_n > 0 {
            let errors = count(gathered.robustness_steps_n);
            text.push_str(&format!("; {errors} under sampled errors"));
        }
        let pose_errors = gathered.pose_errors.values().flatten();
        let pose_errors_n: i64 = pose_errors.map(|trial| trial.control_steps_n).sum();
        if pose_errors_n > 0 {
            let off = count(pose_errors_n);
            text.push_str(&format!("; {off} with the object off its pose"));
        }
        work.insert("screen", text);
    }
    let executed_s: f64 = gathered
        .executions
        .values()
        .flatten()
        .map(|one| one.duration_s)
        .sum();
    if executed_s > 0.0 {
        work.insert(
            "dispatch",
            format!("{} of motion executed", duration(executed_s)),
        );
    }
    work
}

pub(crate) fn section(gathered: &PageData) -> Section {
    let mut section = Section::new("cost", "Cost by stage");
    let work = work(gathered);
    let facts = &gathered.facts.run;
    if facts.kinds.is_empty() {
        section.say("The stages of this run are not known here.");
        return section;
    }
    let has_times = !gathered.seconds.is_empty();
    if has_times {
        section.say("Times are those for which each result was made, in this run or an earlier one, summed over units that ran side by side.");
    } else {
        section.say("Measured times are left out, so that equal inputs give an equal page; `pipeline report` adds those of a run.");
    }
    let mut columns = vec![("stage", "Stage"), ("kind", "Kind"), ("work", "Work")];
    if has_times {
        columns.push(("seconds", "Time"));
    }
    let mut table = DataTable::new("cost", "Stages with their work", &columns);
    let mut stages: Vec<(&String, &String)> = facts.kinds.iter().collect();
    let place = |kind: &str| FLOW.iter().position(|known| *known == kind);
    stages.sort_by_key(|(name, kind)| (place(kind).unwrap_or(FLOW.len()), *name));
    for (stage, kind) in stages {
        let mut row = vec![
            Cell::text(stage),
            Cell::text(kind),
            Cell::text(work.get(kind.as_str()).cloned().unwrap_or_default()),
        ];
        if has_times {
            let of_stage = gathered.seconds.iter();
            let of_stage = of_stage
                .filter(|(node, _)| node.split_once('.').is_some_and(|(name, _)| name == stage));
            let seconds: f64 = of_stage.map(|(_, seconds)| seconds).sum();
            row.push(Cell::Number(seconds, duration(seconds)));
        }
        table.row(row);
    }
    section.tables.push(table);
    section
}
