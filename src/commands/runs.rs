//! `pipeline runs`

use std::collections::BTreeMap;

use dataflow::{NodeRecord, RunStatus};
use lake::{Lake, LakeError, Run};
use serde::Serialize;

use crate::{
    arguments::RunsArgs,
    command_line::Program,
    commands::{lookup, query::page::Page},
    outcome::{CommandError, CommandOutcome},
    report::{self, cut},
    timestamps,
};

/// Placeholder of an unknown value.
const UNKNOWN: &str = "-";

/// Maximum characters shown of an error message.
const MESSAGE: usize = 60;

/// A row of the list of runs.
#[derive(Serialize)]
struct Row {
    run: u64,
    tags: Vec<String>,
    pipeline: String,
    file: String,
    profile: Option<String>,
    overrides: Vec<String>,
    seed: u64,
    /// When it began (UTC).
    started: String,
    #[serde(skip)]
    minute: String,
    host: String,
    program: String,
    #[serde(flatten)]
    status: RunStatus,
    /// Seconds it took; `null` if it did not finish.
    seconds: Option<f64>,
    /// Units that it made.
    n_made_now: usize,
    /// Units that were in the lake already.
    n_cached: usize,
    /// Items that could not be used.
    n_skipped: usize,
    outputs: Vec<NodeCounts>,
}

/// The outcome of an output, as counts of units.
#[derive(Serialize)]
struct NodeCounts {
    output: String,
    n_made_now: usize,
    n_made: usize,
    n_skipped: usize,
    n_filtered: usize,
    description: String,
}

/// Lists runs, the newest last.
pub(crate) fn runs(program: &Program, args: &RunsArgs) -> Result<CommandOutcome, CommandError> {
    let lake = Lake::open(&program.lake);
    let tags = lake.tags()?;
    let mut rows = Vec::new();
    let mut damaged = Vec::new();
    let mut pipelines: Vec<String> = Vec::new();
    for number in lake.runs()?.into_iter().rev() {
        if args.last.is_some_and(|last| rows.len() >= last) {
            break;
        }
        match lake.run_without_units(number) {
            Ok(run) => {
                let name = &run.record.pipeline;
                if args.pipeline.as_ref().is_none_or(|asked| asked == name) {
                    rows.push(Row::new(run, &tags));
                } else if !pipelines.contains(name) {
                    pipelines.push(name.clone());
                }
            }
            // A damaged record of one run does not hide others.
            Err(err @ (LakeError::Damaged { .. } | LakeError::Json { .. })) => damaged.push(err),
            // It was collected a moment ago.
            Err(LakeError::NoRun { .. }) => {}
            Err(err) => return Err(err.into()),
        }
    }
    rows.reverse();
    if rows.is_empty() && damaged.is_empty() && args.last != Some(0) {
        return Err(nothing(&lake, args, &pipelines));
    }
    report::answer(args.format, &rows, |rows| match rows.as_slice() {
        [] => String::new(),
        rows => text(rows, Page::of_stdout().width),
    })?;
    match damaged.into_iter().next() {
        Some(err) => Err(err.into()),
        None => Ok(CommandOutcome::Done),
    }
}

fn nothing(lake: &Lake, args: &RunsArgs, pipelines: &[String]) -> CommandError {
    match &args.pipeline {
        Some(name) if !pipelines.is_empty() => CommandError::usage(
            format!("no run of a pipeline `{name}`"),
            format!("there are runs of: {}", pipelines.join(", ")),
        ),
        _ => lookup::no_runs(lake),
    }
}

impl Row {
    fn new(run: Run, tags: &BTreeMap<String, u64>) -> Self {
        let own = tags.iter().filter(|(_, number)| **number == run.number);
        let record = run.record;
        let sum = |of: fn(&NodeRecord) -> usize| record.nodes.iter().map(of).sum::<usize>();
        let n_made_now = sum(|node| node.n_made_now);
        let n_units = sum(|node| node.n_made + node.n_skipped + node.n_filtered);
        let n_skipped = sum(|node| node.n_skipped);
        let has_ended = !matches!(record.status, RunStatus::Running | RunStatus::Interrupted);
        Self {
            run: run.number,
            tags: own.map(|(name, _)| name.clone()).collect(),
            pipeline: record.pipeline,
            file: record.origin.file.to_string_lossy().into_owned(),
            profile: record.origin.profile,
            overrides: record.origin.overrides,
            seed: record.seed,
            started: timestamps::second(run.started_ns),
            minute: timestamps::minute(run.started_ns),
            host: run.host,
            program: run.program,
            seconds: has_ended.then_some(record.seconds),
            status: record.status,
            n_made_now,
            n_cached: n_units.saturating_sub(n_made_now),
            n_skipped,
            outputs: record.nodes.into_iter().map(NodeCounts::new).collect(),
        }
    }

    fn cells(&self) -> Vec<String> {
        // An unfinished run has no counts.
        let count = |n: usize| match self.seconds {
            Some(_) => n.to_string(),
            None => UNKNOWN.to_owned(),
        };
        let status = match &self.status {
            RunStatus::Running => "running".to_owned(),
            RunStatus::Finished => "finished".to_owned(),
            RunStatus::Interrupted => "interrupted".to_owned(),
            RunStatus::Failed { message } => {
                let line = message.lines().next().unwrap_or_default();
                format!("failed: {}", cut(line, MESSAGE))
            }
        };
        let seconds = self.seconds.map(report::duration);
        let profile = self.profile.iter().map(|name| format!("--profile {name}"));
        let values: Vec<String> = profile.chain(self.overrides.iter().cloned()).collect();
        vec![
            self.run.to_string(),
            self.minute.clone(),
            self.pipeline.clone(),
            count(self.n_made_now),
            count(self.n_cached),
            count(self.n_skipped),
            seconds.unwrap_or_else(|| UNKNOWN.to_owned()),
            self.tags.join(", "),
            status,
            values.join(" "),
        ]
    }
}

impl NodeCounts {
    fn new(node: NodeRecord) -> Self {
        Self {
            output: node.node.to_string(),
            n_made_now: node.n_made_now,
            n_made: node.n_made,
            n_skipped: node.n_skipped,
            n_filtered: node.n_filtered,
            description: node.description,
        }
    }
}

/// One line per run, cut to a width if there is one.
fn text(rows: &[Row], width: Option<usize>) -> String {
    let header = report::header([
        "run",
        "started (UTC)",
        "pipeline",
        "made",
        "cached",
        "skipped",
        "time",
        "tags",
        "status",
        "values",
    ]);
    let mut lines = vec![header];
    lines.extend(rows.iter().map(Row::cells));
    report::cut_lines(report::columns(&lines, &[0, 3, 4, 5, 6]), width)
}
