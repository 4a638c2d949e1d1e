//! `pipeline unit`

use std::{
    io::Read,
    sync::{Arc, Mutex, PoisonError},
    thread,
};

use dataflow::{Event, Events, Forced, NodeName, UnitName, did_you_mean, make_one};
use lake::Lake;

use crate::{
    arguments::{Format, UnitArgs},
    command_line::Program,
    commands::pipeline_file,
    interrupt,
    outcome::{CommandError, CommandOutcome},
    progress::Screen,
    report,
};

/// Makes one unit whose inputs are in the lake.
pub(crate) fn unit(program: &Program, args: &UnitArgs) -> Result<CommandOutcome, CommandError> {
    let pipeline = pipeline_file::read_with(program.kinds, &args.file, &args.values)?;
    let node = NodeName::parse(&args.artifact).ok_or_else(|| {
        let known: Vec<String> = pipeline
            .nodes
            .iter()
            .map(|node| node.name.to_string())
            .collect();
        let near = did_you_mean(&args.artifact, known.iter().map(String::as_str));
        CommandError::usage(
            format!("`{}` is not of the form `stage.artifact`", args.artifact),
            near.unwrap_or_else(|| format!("its outputs are: {}", known.join(", "))),
        )
    })?;
    let lake = Arc::new(program.open_lake()?);
    interrupt::drop_on_signal(&lake)?;
    if args.with_parent {
        stop_with_parent(&lake);
    }
    let forced = if args.fresh { Forced::Yes } else { Forced::No };
    let screen = Screen::new(program.quiet);
    let lines = Lines::default();
    let events: &Events = match args.format {
        Format::Text => &|event| screen.show(event),
        Format::Json => &|event| lines.write(event),
    };
    let unit = UnitName::new(&node, &args.partition);
    let made = make_one(&pipeline, lake.as_ref(), &unit, forced, events);
    let shared = if args.with_parent {
        Ok(())
    } else {
        program.end_sharing(&lake)
    };
    lake.leave();
    let outcome = match (made, args.format) {
        (Ok(made), Format::Text) => {
            let fingerprint = made.fingerprint.to_hex();
            report::data(format!("{fingerprint}\n").as_bytes())?;
            CommandOutcome::Done
        }
        (Ok(_), Format::Json) => CommandOutcome::Done,
        (Err(err), Format::Text) => return Err(err.into()),
        (Err(err), Format::Json) => {
            let (hint, left_out) = err.advice();
            let left_out = left_out.cloned();
            let message = match CommandError::from(err) {
                CommandError::Failed { error, .. } => report::chain(&error),
                CommandError::Usage { message, .. } => message,
                CommandError::File(err) => err.to_string(),
            };
            lines.write(&Event::UnitFailed {
                unit,
                message,
                hint,
                left_out,
            });
            CommandOutcome::Reported
        }
    };
    shared?;
    lines.finish().map(|()| outcome)
}

/// Ends this process when its stdin closes, since then its parent process has ended.
fn stop_with_parent(lake: &Arc<Lake>) {
    let lake = Arc::clone(lake);
    thread::spawn(move || {
        let mut nothing = Vec::new();
        let _closed = std::io::stdin().lock().read_to_end(&mut nothing);
        interrupt::stop(&lake);
    });
}

/// Events written to stdout as lines of JSON.
#[derive(Default)]
struct Lines {
    /// The first write error.
    failed: Mutex<Option<CommandError>>,
}

impl Lines {
    fn write(&self, event: &Event) {
        let json = serde_json::to_string(event).map_err(|err| CommandError::failed(err, None));
        let written = json.and_then(|json| report::data(format!("{json}\n").as_bytes()));
        if let Err(trouble) = written {
            let mut failed = self.failed.lock().unwrap_or_else(PoisonError::into_inner);
            failed.get_or_insert(trouble);
        }
    }

    fn finish(self) -> Result<(), CommandError> {
        let failed = self.failed.into_inner();
        match failed.unwrap_or_else(PoisonError::into_inner) {
            Some(trouble) => Err(trouble),
            None => Ok(()),
        }
    }
}
