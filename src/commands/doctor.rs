//! `pipeline doctor`

mod checks;
mod lake_folder;
mod robot;

use dataflow::{Diagnostic, Pipeline, Resources};
use lake::{Lake, OutagePolicy, Sharing};

use crate::{
    arguments::DoctorArgs,
    command_line::Program,
    commands::{physics, pipeline_file},
    executors::RemoteExecutor,
    label::Label,
    outcome::{CommandError, CommandOutcome},
    report::{self, LabeledRow},
    sharing,
    system_errors::in_words,
};

/// One line of the report.
struct Check {
    state: State,
    subject: String,
    finding: String,
    /// Suggested fix.
    hint: Option<String>,
}

/// Least width of the column of labels, in characters.
const LABEL_WIDTH: usize = 7;

/// The status of a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// It can be used.
    Ok,
    /// It can be used and is probably not meant so.
    Doubtful,
    /// It is required and missing.
    Missing,
    /// It is optional and missing.
    Unset,
}

impl State {
    fn label(self) -> Label {
        match self {
            Self::Ok => Label::Ok,
            Self::Doubtful => Label::Doubtful,
            Self::Missing => Label::Missing,
            Self::Unset => Label::Unset,
        }
    }
}

impl Check {
    fn new(state: State, subject: impl Into<String>, finding: impl Into<String>) -> Self {
        Self {
            state,
            subject: subject.into(),
            finding: in_words(&finding.into()),
            hint: None,
        }
    }

    fn with_hint(mut self, hint: impl Into<Option<String>>) -> Self {
        self.hint = hint.into();
        self
    }
}

/// Checks that the lake, a pipeline file's inputs and the robot cell are ready; or only a robot.
pub(crate) fn doctor(program: &Program, args: &DoctorArgs) -> Result<CommandOutcome, CommandError> {
    if let Some(urdf) = &args.robot {
        return robot::check(urdf);
    }
    let pipeline = pipeline_file::read_with(program.kinds, &args.file, &args.values)?;
    let mut found = all(program, &pipeline)?;
    if let Some(name) = &args.on {
        found.extend(remote_executor(program, name, &pipeline)?);
    }
    let rows: Vec<LabeledRow> = found
        .iter()
        .map(|check| {
            let cells = vec![check.subject.clone(), check.finding.clone()];
            (check.state.label(), cells)
        })
        .collect();
    report::lines(&report::labeled_rows(&rows, LABEL_WIDTH))?;
    let mut hints: Vec<&String> = found
        .iter()
        .filter_map(|check| check.hint.as_ref())
        .collect();
    hints.dedup();
    for hint in hints {
        report::line(Label::Hint, hint);
    }
    let is_missing = |check: &&Check| check.state == State::Missing;
    match found.iter().filter(is_missing).count() {
        0 => Ok(CommandOutcome::Done),
        n => Err(CommandError::failed(
            anyhow::anyhow!("`{}` cannot run: {n} missing", args.file.display()),
            None,
        )),
    }
}

fn all(program: &Program, pipeline: &Pipeline) -> Result<Vec<Check>, CommandError> {
    let mut found = lake_folder::check(&program.lake);
    found.extend(depot(program)?);
    found.push(checks::compute());
    found.extend(checks::stages(pipeline));
    found.extend(checks::robot_cells(pipeline));
    found.extend(
        physics::differences(pipeline)
            .into_iter()
            .chain(physics::foreign_drives(pipeline))
            .map(|it| Check::new(State::Doubtful, it.stage, it.text).with_hint(it.hint)),
    );
    Ok(found)
}

/// Checks that a worker of an executor starts and answers, and that each stage's resources can be had there.
fn remote_executor(
    program: &Program,
    name: &str,
    pipeline: &Pipeline,
) -> Result<Vec<Check>, CommandError> {
    let lake = program.open_shared_lake()?;
    let executor = RemoteExecutor::named(name, &lake)?;
    let missing = |subject: &str, err: dataflow::Failure| {
        let hint = err.hint();
        Check::new(State::Missing, subject, report::chain(&err.into())).with_hint(hint)
    };
    let mut found = vec![match executor.try_out() {
        Ok(host) => Check::new(State::Ok, name, format!("a worker on `{host}` answers")),
        Err(err) => missing(name, err),
    }];
    for stage in &pipeline.stages {
        if stage.resources == Resources::default() {
            continue;
        }
        let subject = format!("{name}, {}", stage.name);
        found.push(match executor.test(&stage.resources) {
            Ok(()) => Check::new(State::Ok, subject, "takes jobs with its resources"),
            Err(err) => missing(&subject, err),
        });
    }
    Ok(found)
}

/// Stores a file in the depot, reads and removes it, if the environment names a depot.
fn depot(program: &Program) -> Result<Option<Check>, CommandError> {
    let Some(depot) = sharing::depot()? else {
        return Ok(None);
    };
    let missing = |why: String, hint: Option<String>| {
        let hint = hint.unwrap_or_else(|| "check that it can be reached and written".to_owned());
        Check::new(State::Missing, "depot", why).with_hint(hint)
    };
    let lake = Lake::open(&program.lake).with_depot(
        &depot,
        &Sharing {
            outage_policy: OutagePolicy::Fail,
            ..Sharing::default()
        },
    );
    Ok(Some(match lake.try_depot() {
        Ok(true) => Check::new(State::Ok, "depot", "results can be shared"),
        Ok(false) => missing("a file is not read as it was stored".to_owned(), None),
        Err(err) => {
            let hint = err.hint();
            missing(report::chain(&err.into()), hint)
        }
    }))
}
