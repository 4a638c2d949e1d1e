//! `pipeline verify`

use std::sync::Mutex;

use indicatif::{ProgressBar, ProgressStyle};
use lake::{Fault, Lake};

use crate::{
    arguments::VerifyArgs,
    command_line::Program,
    label::Label,
    outcome::{CommandError, CommandOutcome},
    progress::Quiet,
    report,
};

/// Checks every byte of the lake, or of the files outside that it has read.
pub(crate) fn verify(program: &Program, args: &VerifyArgs) -> Result<CommandOutcome, CommandError> {
    let lake = if args.depot {
        program.open_shared_lake()?
    } else {
        Lake::open(&program.lake)
    };
    let bar = Mutex::new(None);
    let on_bytes = |done: u64, total: u64| {
        if program.quiet == Quiet::Yes {
            return;
        }
        if let Ok(mut bar) = bar.lock() {
            let bar = bar.get_or_insert_with(|| new_bar(total));
            bar.set_position(done);
        }
    };
    let mut verified = if args.depot {
        lake.verify_depot(&on_bytes)?
    } else {
        lake.verify(&on_bytes)?
    };
    if args.inputs {
        let inputs = lake.verify_inputs(&on_bytes)?;
        verified.n_files += inputs.n_files;
        verified.n_bytes += inputs.n_bytes;
        verified.faults.extend(inputs.faults);
    }
    if let Ok(mut bar) = bar.lock()
        && let Some(bar) = bar.take()
    {
        bar.finish_and_clear();
    }
    report::answer(args.format, &verified, |verified| listed(&verified.faults))?;
    if verified.faults.is_empty() {
        program.say(
            Label::Done,
            format!(
                "{} files with {} read, nothing is damaged or missing",
                verified.n_files,
                report::bytes(verified.n_bytes)
            ),
        );
        return Ok(CommandOutcome::Done);
    }
    let n_faults = verified.faults.len();
    if args.drop {
        let n_dropped = if args.depot {
            lake.drop_damaged_in_depot(&verified.faults)?
        } else {
            lake.drop_damaged(&|_, _| {})?
        };
        program.say(Label::Drop, format!("{n_dropped} damaged files"));
    }
    Err(CommandError::failed(
        anyhow::anyhow!(
            "{n_faults} faults among {} files: they are not as they were stored",
            verified.n_files
        ),
        Some(if args.drop {
            "the next run makes again what it needs".to_owned()
        } else if args.depot {
            "`pipeline verify --depot --drop` drops what is damaged; then `pipeline push` on the machines that made it \
             sends it again, or a run that needs it makes it"
                .to_owned()
        } else {
            "a run that needs one makes it again; `pipeline verify --drop` drops what is damaged"
                .to_owned()
        }),
    ))
}

fn new_bar(total: u64) -> ProgressBar {
    let bar = ProgressBar::new(total);
    let style = ProgressStyle::with_template(
        "       verify     [{bar:30}] {percent:>3} %  {bytes} of {total_bytes}  {elapsed}",
    );
    if let Ok(style) = style {
        bar.set_style(style.progress_chars("=> "));
    }
    bar
}

fn listed(faults: &[Fault]) -> String {
    let rows: Vec<Vec<String>> = faults
        .iter()
        .map(|fault| vec![fault.path.display().to_string(), fault.what.clone()])
        .collect();
    report::columns(&rows, &[])
}
