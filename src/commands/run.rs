//! `pipeline run`

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use dataflow::{Event, Executor, NodeReport, Pipeline, RunReport};
use lake::Lake;

use crate::{
    arguments::{Format, RunArgs},
    command_line::Program,
    commands::{
        detach, physics, pipeline_file, plan,
        query::page::Page,
        sweep::{self, VariantResult},
    },
    executors::{self, RemoteExecutor},
    interrupt,
    label::Label,
    outages,
    outcome::{CommandError, CommandOutcome},
    processes::Processes,
    progress::{Quiet, Screen},
    report::{self, Line},
    sharing,
};

/// The artifact that is a page of a run.
const PAGE: &str = "page";

/// Runs a pipeline, or every variant of it, reusing every result that is still valid.
pub(crate) fn run(program: &Program, args: &RunArgs) -> Result<CommandOutcome, CommandError> {
    if args.detach {
        return detach::detach(program);
    }
    let lake = Arc::new(if args.dry_run {
        program.open_lake()?
    } else {
        let of_executor = args.on.as_deref().map(executors::depot_patience_min);
        let of_executor = of_executor.transpose()?.flatten();
        let patience_min = args.depot_patience_min.or(of_executor);
        let patience_min = patience_min.unwrap_or(outages::PATIENCE_MIN);
        program.open_lake_with(&outages::run_sharing(
            args.depot_down,
            patience_min,
            program.quiet,
        ))?
    });
    if !args.dry_run {
        interrupt::drop_on_signal(&lake)?;
        sharing::say_unlocked(&lake);
    }
    let outcome = sweep::each(program, &args.pipeline, |_, pipeline| {
        let args = RunArgs {
            pipeline,
            ..args.clone()
        };
        run_variant(program, &lake, &args)
    });
    let shared = if args.dry_run {
        program.say_shared(&lake)
    } else {
        program.end_sharing(&lake)
    };
    lake.leave();
    outcome.and_then(|outcome| shared.map(|()| outcome))
}

fn run_variant(
    program: &Program,
    store: &Lake,
    args: &RunArgs,
) -> Result<VariantResult, CommandError> {
    let pipeline = if args.execute {
        pipeline_file::read_to_execute(program.kinds, &args.pipeline)?
    } else {
        pipeline_file::read(program.kinds, &args.pipeline)?
    };
    let options = pipeline_file::options(&args.pipeline, args.jobs);
    if args.dry_run {
        let plan = dataflow::plan(&pipeline, store, &options)?;
        match args.format {
            Format::Text => report::lines(&plan::lines(&plan, Page::of_stdout().width))?,
            Format::Json => report::json(&plan)?,
        }
        return Ok(VariantResult::without_summary(CommandOutcome::Done));
    }
    let foreign = physics::foreign_drives(&pipeline);
    for difference in physics::differences(&pipeline).iter().chain(&foreign) {
        program.say(Label::Warn, &difference.text);
        program.say(Label::Hint, &difference.hint);
    }
    let screen = Screen::new(program.quiet);
    let processes = args
        .processes
        .then(|| Processes::local(store, args.jobs))
        .transpose()?;
    let on = args.on.as_deref();
    let remote = on
        .map(|name| RemoteExecutor::named(name, store))
        .transpose()?;
    let executor = match (&processes, &remote) {
        (Some(processes), _) => Some(processes as &dyn Executor),
        (None, remote) => remote.as_ref().map(|it| it as &dyn Executor),
    };
    let events = |event: &Event| tell(&screen, args.format, event);
    let ran = dataflow::run(&pipeline, store, &options, executor, &events)?;
    if let Some(remote) = &remote {
        remote.tidy(&pipeline.name)?;
    }
    // A page shows what the other outputs say.
    let is_page = |node: &&NodeReport| node.record.node.artifact == *PAGE;
    let last = ran.nodes.iter().rev().find(|node| !is_page(node));
    let summary = last.map_or_else(String::new, |node| node.record.description.clone());
    if program.quiet == Quiet::No {
        say_done(&pipeline, &ran, &summary);
    }
    let outcome = if ran.skipped_count() > 0 {
        report_skipped(store, &ran);
        CommandOutcome::SkippedItems
    } else {
        if let Some(last) = last.filter(|_| ran.made_now_count() > 0) {
            program.say(
                Label::Next,
                format!(
                    "`pipeline inspect {}`, or edit `{}` and run",
                    last.record.node,
                    args.pipeline.file.display()
                ),
            );
        }
        CommandOutcome::Done
    };
    if program.quiet == Quiet::No
        && let Some(folder) = store.report_folder(&pipeline.name)
    {
        let page = ran.nodes.iter().rev().find(is_page);
        let page = page
            .and_then(|page| page_of(&folder, page))
            .unwrap_or(folder);
        report::line(Label::Report, format!("`{}`", page.display()));
    }
    Ok(VariantResult { outcome, summary })
}

/// Tells people of an event, and programs that ask for all of them.
fn tell(screen: &Screen, format: Format, event: &Event) {
    screen.show(event);
    if format == Format::Json {
        // A reader that left misses the rest: the run goes on.
        let _nobody_reads = report::json_line(event);
    }
}

/// Reports the end of a run, and what its last output is in words, in lines that are short enough.
fn say_done(pipeline: &Pipeline, ran: &RunReport, summary: &str) {
    let line = if ran.made_now_count() == 0 {
        let stages = pipeline.stages.iter();
        let ran_stages = stages.filter(|stage| {
            let mut nodes = ran.nodes.iter();
            nodes.any(|node| node.record.node.stage == stage.name)
        });
        let n_stages = ran_stages.count();
        report::short_line(
            Label::Done,
            format!("{n_stages} stages cached, nothing to run"),
        );
        Line::plain(format!("       {summary}"))
    } else {
        let took = format!("in {}", report::duration(ran.seconds));
        let line = Line::labeled(Label::Done, format_args!("{summary} {took}"));
        if line.len() <= report::LINE_WIDTH {
            line
        } else {
            report::short_line(Label::Done, took);
            Line::plain(format!("       {summary}"))
        }
    };
    report::short(line);
}

/// Reports that items were skipped, and how to see the reasons.
fn report_skipped(store: &Lake, ran: &RunReport) {
    report::line(
        Label::Note,
        format!("{} items were skipped", ran.skipped_count()),
    );
    let skipping = ran.nodes.iter().filter(|node| node.record.n_skipped > 0);
    for node in skipping {
        if let Some(run) = left_by(store, ran, node) {
            let node = &node.record.node;
            report::line(
                Label::Hint,
                format!("see each reason with `pipeline inspect {node} --skipped --run {run}`"),
            );
        }
    }
}

/// Returns where the page of a report is published, if it is.
fn page_of(folder: &Path, page: &NodeReport) -> Option<PathBuf> {
    let node = &page.record.node;
    let unit = page.units.first()?;
    let below = folder
        .join(node.stage.as_str())
        .join(node.artifact.as_str());
    let path = below.join(unit.partition.as_str()).join("index.html");
    path.is_file().then_some(path)
}

/// Returns the run to inspect for an output: this one, or, if it recorded nothing, the newest with
/// exactly these units; `None` if that was collected.
fn left_by(lake: &Lake, ran: &RunReport, node: &NodeReport) -> Option<u64> {
    let left_alike = |number: &u64| {
        // A damaged record of one run does not hide others.
        lake.run(*number).is_ok_and(|run| {
            let left = run
                .record
                .units
                .iter()
                .filter(|unit| unit.node == node.record.node);
            let found = node.units.iter().map(|unit| unit.fingerprint);
            left.map(|unit| unit.fingerprint).eq(found)
        })
    };
    let newest_first = || lake.runs().unwrap_or_default().into_iter().rev();
    ran.run.or_else(|| newest_first().find(left_alike))
}
