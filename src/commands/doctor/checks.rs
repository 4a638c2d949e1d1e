//! Checks of the compute threads, the stages and the robot cell.

use std::{
    net::{TcpListener, TcpStream, ToSocketAddrs},
    time::Duration,
};

use dataflow::{
    Diagnostic, Failure, Pipeline, Problem, Readiness, Source, StageEntry, StageName, outside,
};
use stage_dispatch::{Dispatch, DispatchConfig};

use super::{Check, State};
use crate::report;

/// Timeout of a connection to a robot cell.
const CONNECT: Duration = Duration::from_secs(3);

/// Starts the threads that a run would start.
pub(super) fn compute() -> Check {
    match rayon::ThreadPoolBuilder::new().build() {
        Ok(pool) => Check::new(
            State::Ok,
            "compute",
            format!(
                "CPU, {} threads; every stage computes there",
                pool.current_num_threads()
            ),
        ),
        Err(err) => Check::new(
            State::Missing,
            "compute",
            format!("cannot start the worker threads: {err}"),
        ),
    }
}

/// Checks the resources of every stage outside the lake.
pub(super) fn stages(pipeline: &Pipeline) -> Vec<Check> {
    let stages = pipeline
        .stages
        .iter()
        .flat_map(|stage| match outside(stage) {
            Ok(outside) => vec![Check::new(State::Ok, &stage.name, found(outside))],
            Err(Failure::Files(err)) => err
                .problems
                .into_iter()
                .map(|problem| file(&stage.name, problem))
                .collect(),
            Err(failure) => {
                let hint = failure.hint();
                vec![Check::new(State::Missing, &stage.name, cause(failure)).with_hint(hint)]
            }
        });
    stages.collect()
}

/// A file that a stage names and that cannot be used, with the line that names it.
fn file(stage: &StageName, problem: Problem) -> Check {
    let repeated = format!("stage `{stage}`: ");
    let message = problem.message.trim_start_matches(&repeated);
    let line = match problem.location.map(|location| location.source) {
        Some(Source::File { path, line }) => format!(", {}:{line}", path.display()),
        Some(Source::Argument) | None => String::new(),
    };
    Check::new(State::Missing, stage, format!("{message}{line}")).with_hint(problem.hint)
}

fn found(outside: Readiness) -> String {
    let Some((n_units, per)) = outside.units else {
        return "options and external files are usable".to_owned();
    };
    format!(
        "{n_units} partitions to make, one per {per}, from {} files",
        outside.n_files
    )
}

/// Why a stage cannot begin, without repeating its name.
fn cause(failure: Failure) -> String {
    match failure {
        Failure::Stage { source, .. } => report::chain(&anyhow::Error::from(source)),
        failure => report::chain(&anyhow::Error::from(failure)),
    }
}

/// Checks the robot cell of every `dispatch`.
pub(super) fn robot_cells(pipeline: &Pipeline) -> Vec<Check> {
    pipeline
        .stages
        .iter()
        .filter_map(|stage| Some(robot_cell(stage, stage.options::<Dispatch>()?)))
        .collect()
}

fn robot_cell(stage: &StageEntry, options: &DispatchConfig) -> Check {
    let (cell, name) = (options.cell.as_str(), options.cell_name.as_str());
    let address = ["tcp/", "tls/"]
        .iter()
        .find_map(|way| cell.strip_prefix(way));
    let check = |state, finding: String| Check::new(state, "robot cell", finding);
    let Some(address) = address else {
        let local = "on the loopback interface";
        return match TcpListener::bind(("127.0.0.1", 0)) {
            Ok(_) => {
                let finding = format!("simulated, in the run's own process, {local}");
                check(State::Ok, finding)
            }
            Err(err) => {
                let finding = format!("simulated, but nothing can listen {local}: {err}");
                check(State::Missing, finding)
            }
        };
    };
    let stage = &stage.name;
    let connects = format!("`{name}` takes connections at `{cell}`");
    match connect(address) {
        Err(reason) => {
            let finding =
                format!("nothing answers at `{cell}`, where `{name}` should be: {reason}");
            check(State::Missing, finding).with_hint(format!(
                "start the cell, or try the simulated one with `--set {stage}.cell=simulated`"
            ))
        }
        Ok(()) if options.execute => check(State::Ok, format!("{connects}, and may be moved")),
        Ok(()) => check(
            State::Unset,
            format!(
                "{connects}; without `--execute`, `{stage}` sends nothing unless the cell is simulated"
            ),
        ),
    }
}

/// Opens a connection and closes it again; nothing is sent.
fn connect(address: &str) -> Result<(), String> {
    let mut addresses = address.to_socket_addrs().map_err(|err| err.to_string())?;
    let first = addresses.next().ok_or("no such address")?;
    TcpStream::connect_timeout(&first, CONNECT)
        .map(drop)
        .map_err(|err| err.to_string())
}
