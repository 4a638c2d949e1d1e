//! The stage: one run of the program for each unit.

use std::{
    collections::BTreeMap,
    collections::BTreeSet,
    marker::PhantomData,
    path::PathBuf,
    sync::{Arc, Mutex, PoisonError},
    time::{Duration, Instant},
};

use arrow_schema::Schema;
use dataflow::{
    BoxedDiagnostic, Context, FileFault, Inputs, Line, NodeName, OptionFault, OptionsUsed, Outcome,
    Output, OutputNames, Outputs, Scope, Stage, Sum, Unit, Wiring,
};

use crate::{
    artifacts::{Artifacts, KnownArtifact},
    code,
    config::ProgramConfig,
    error::ProgramError,
    folder::{self, FolderViolation, JobFolder},
    log::Log,
    own_table, process,
    result::{accepted_n, checked},
    script::FirstLine,
    units::{FAN_OUT, LACKS, units},
};

/// Exit code of a program for an item that cannot be used: it is skipped, and the last line printed is the
/// reason.
const SKIPPED: i32 = 3;
/// Exit codes of a shell and of `env` for a command that they cannot start.
const NOT_STARTED: std::ops::RangeInclusive<i32> = 126..=127;

/// Runs a program of the user's; its artifacts are those of `A`, and tables of its own.
pub struct Program<A>(PhantomData<A>);

dataflow::metrics! {
    /// Metrics of a partition that a program made.
    pub struct ProgramMetrics {
        /// Number of rows of its table.
        rows_n: Sum,
        /// Number of rollouts among them that succeed.
        accepted_n: Option<Sum>,
    }
}

impl<A: Artifacts> Program<A> {
    const OUTPUT: Self = Self(PhantomData);

    fn known(config: &ProgramConfig) -> Option<&'static KnownArtifact> {
        A::KNOWN.iter().find(|known| known.artifact == config.makes)
    }
}

impl<A: Artifacts> Stage for Program<A> {
    type Config = ProgramConfig;

    const KIND: &'static str = "program";
    const ABOUT: &'static str = "Runs a program of your own for each partition";
    const INPUTS: &'static [&'static str] = &[];
    const WIRING: Wiring = Wiring::Free;
    const EXAMPLE: Option<&'static str> = Some(include_str!("../page.md"));
    const FILES: &'static [&'static str] = &["code", "lock", "files"];
    const OUTPUTS: Outputs<Self> = &[&Self::OUTPUT];

    fn check(config: &ProgramConfig) -> Vec<OptionFault> {
        config.faults_for(A::KNOWN)
    }

    fn check_wired(
        config: &ProgramConfig,
        inputs: &BTreeMap<String, NodeName>,
    ) -> Vec<OptionFault> {
        config.wired_faults(inputs)
    }

    fn check_files(config: &ProgramConfig) -> Vec<FileFault> {
        code::file_faults(config)
    }
}

impl<A: Artifacts> Output for Program<A> {
    type Stage = Self;
    type Metrics = ProgramMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = "artifact";
    const SCHEMA: &'static str = "of `makes`";
    const PARTITION: &'static str = "partition";
    // Limits decide whether a program is killed, not what it makes.
    const OPTIONS: OptionsUsed = OptionsUsed::Except(&["timeout_s", "memory_mb", "fan_out"]);
    const LINE: Option<Line<ProgramMetrics>> = Some(|summary| {
        let (partitions, rows) = (summary.n_made, summary.metrics.rows_n);
        match summary.metrics.accepted_n {
            Some(accepted) => {
                format!("{rows} candidates → {accepted} accepted, by a program of your own")
            }
            None => format!("{partitions} made by a program of your own, {rows} rows"),
        }
    });

    fn names(config: &ProgramConfig) -> OutputNames {
        match Self::known(config) {
            Some(known) => OutputNames {
                artifact: known.artifact,
                schema: known.schema,
                partition: known.partition,
            },
            None => OutputNames {
                artifact: lasting(&config.makes),
                schema: lasting(&own_table::version(&config.makes)),
                partition: lasting(&config.partition),
            },
        }
    }

    fn units(config: &ProgramConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        units(config, scope)
    }

    fn make(
        config: &ProgramConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<ProgramMetrics>, BoxedDiagnostic> {
        if let Some(input) = inputs.fact(LACKS) {
            return Ok(Outcome::skipped(format!(
                "`{input}` has no partition for it: `read.{input}` says which it reads, e.g. \"all\""
            )));
        }
        let known = Self::known(config);
        let schema = match known {
            Some(known) => known.table.as_ref().map(|table| (table.schema)()),
            None => Some(own_table::schema(config)),
        };
        let run = ProgramRun {
            config,
            inputs,
            cx,
            known,
            schema,
        };
        run.make()
    }
}

/// One run of the program, for one unit.
struct ProgramRun<'a> {
    config: &'a ProgramConfig,
    inputs: &'a Inputs,
    cx: &'a Context<'a>,
    /// The artifact to make, if it is not a table of the program's own.
    known: Option<&'static KnownArtifact>,
    /// Columns of the table to make, if there is one.
    schema: Option<Schema>,
}

impl ProgramRun<'_> {
    /// Runs the program in a folder of its own, and keeps what it made.
    fn make(&self) -> Result<Outcome<ProgramMetrics>, BoxedDiagnostic> {
        let (config, cx) = (self.config, self.cx);
        let folder = JobFolder::new(
            config,
            self.known,
            self.schema.clone(),
            self.inputs,
            cx,
            self.inputs.fact(FAN_OUT),
        )?;
        let log = Arc::new(Log::begin(cx.log_file())?);
        let command = code::absolute(config)?;
        let until = Instant::now() + Duration::from_secs_f64(config.timeout_s);
        let ended = process::run(
            config,
            &command,
            folder.path(),
            until,
            &log,
            &|share, message| cx.progress(share, message),
        )?;
        match ended.status.code() {
            Some(0) => {}
            Some(SKIPPED) => {
                let reason = log
                    .last_line()
                    .unwrap_or_else(|| "the program gave no reason".to_owned());
                return Ok(Outcome::skipped(reason));
            }
            _ => return Err(failure(config, &command, &ended, &log).into()),
        }
        let made = self.made(&folder, until)?;
        let made = made.map_err(|violation| ProgramError::Folder {
            command: process::words(config),
            problem: violation.problem,
            last_lines: log.last_lines(),
            log: log.path().to_owned(),
            advice: violation.advice,
        })?;
        let metrics = self.keep(made)?;
        folder.remove()?;
        Ok(Outcome::Made(metrics))
    }

    /// Returns the files that the program made, or the rule of the folder that it broke.
    fn made(
        &self,
        folder: &JobFolder,
        until: Instant,
    ) -> Result<Result<Vec<(String, PathBuf)>, FolderViolation>, BoxedDiagnostic> {
        if let Some(violation) = folder.violation()? {
            return Ok(Err(violation));
        }
        let made = match folder.made()? {
            Ok(made) => made,
            Err(violation) => return Ok(Err(violation)),
        };
        if let Some(violation) = folder::unread(&made, self.config.timeout_s, until)? {
            return Ok(Err(violation));
        }
        let table = self.schema.iter().map(|_| lake::table::FILE);
        let known = self.known.into_iter();
        let mut asked = table.chain(known.flat_map(|known| known.files.iter().copied()));
        let missing = asked.find(|name| !made.iter().any(|(found, _)| found == name));
        Ok(match missing {
            None => Ok(made),
            Some(name) => Err(FolderViolation {
                problem: format!("ended well, but there is no `out/{name}`"),
                advice: "write it into the folder in which the program starts",
            }),
        })
    }

    /// Checks the table and takes it, and moves the other files into the unit's folder.
    fn keep(&self, made: Vec<(String, PathBuf)>) -> Result<ProgramMetrics, BoxedDiagnostic> {
        let cx = self.cx;
        let mut metrics = ProgramMetrics {
            rows_n: 0.0,
            accepted_n: None,
        };
        for (name, path) in made {
            match &self.schema {
                Some(schema) if name == lake::table::FILE => {
                    let batch = checked(
                        self.config,
                        self.known.and_then(|known| known.table.as_ref()),
                        schema,
                        self.inputs,
                        cx.partition(),
                        &path,
                    )?;
                    lake::table::write_batch(cx.folder(), &batch)?;
                    metrics.rows_n = batch.num_rows() as f64;
                    metrics.accepted_n =
                        accepted_n(cx.partition().as_str(), &batch).map(|accepted| accepted as f64);
                }
                _ => {
                    let to = cx.folder().join(&name);
                    folder::take(&path, &to).map_err(ProgramError::at(&path))?;
                }
            }
        }
        Ok(metrics)
    }
}

/// Returns the failure of a program that ended with this exit code or signal.
fn failure(
    config: &ProgramConfig,
    command: &[PathBuf],
    ended: &process::ProgramEnd,
    log: &Log,
) -> ProgramError {
    let code = ended.status.code();
    let unstarted = code.is_some_and(|code| NOT_STARTED.contains(&code));
    let script = unstarted.then(|| script(config, command)).flatten();
    ProgramError::Failed {
        command: process::words(config),
        ended: ended.words(),
        last_lines: log.last_lines(),
        log: log.path().to_owned(),
        missing: code::missing(config).into(),
        script: script.map(Box::new),
    }
}

/// Returns the first file of the command whose first line cannot be used, with its name.
fn script(config: &ProgramConfig, command: &[PathBuf]) -> Option<(String, FirstLine)> {
    let mut files = config.command.iter().zip(command);
    files.find_map(|(name, path)| match FirstLine::of(path)? {
        FirstLine::Missing => None,
        found => Some((name.clone(), found)),
    })
}

/// Returns the text for as long as this process lives: names of artifacts are those of kinds, which last as
/// long. A process reads few pipeline files, and each text is kept once.
fn lasting(text: &str) -> &'static str {
    static TEXTS: Mutex<BTreeSet<&'static str>> = Mutex::new(BTreeSet::new());
    // Whole even if a thread panicked: every change is one call.
    let mut texts = TEXTS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = texts.get(text) {
        return known;
    }
    let lasting: &'static str = Box::leak(text.to_owned().into_boxed_str());
    texts.insert(lasting);
    lasting
}
