//! `pipeline router`

use cell::{Access, CellError, Router};
use signal_hook::{
    consts::{SIGINT, SIGTERM},
    iterator::Signals,
};

use crate::{
    arguments::RouterArgs,
    command_line::Program,
    label::Label,
    outcome::{CommandError, CommandOutcome},
    report,
};

/// Forwards between cells and dispatchers until it is interrupted.
pub(crate) fn router(program: &Program, args: &RouterArgs) -> Result<CommandOutcome, CommandError> {
    let failed = CommandError::with_hint(CellError::hint);
    // Before anything is served, so that an early signal is handled too.
    let mut signals =
        Signals::new([SIGINT, SIGTERM]).map_err(|err| CommandError::failed(err, None))?;
    let access = args.access.as_deref().map(Access::read);
    let access = access.transpose().map_err(&failed)?;
    let router = Router::start(&args.listen, access.as_ref()).map_err(failed)?;
    report::data(format!("{}\n", router.endpoint()).as_bytes())?;
    program.say(
        Label::Router,
        format!("at `{}`; Ctrl-C ends it", router.endpoint()),
    );
    if let Some(access) = &access {
        warn_of_stale(access);
    } else {
        program.say_plain(
            "without TLS there is no authentication: any program on this machine can drive the robots \
             whose cells connect to it",
        );
    }
    signals.forever().next();
    Ok(CommandOutcome::Done)
}

/// Warns of a certificate that every client refuses now.
pub(crate) fn warn_of_stale(access: &Access) {
    warn(access.stale_listener(), "whoever connects refuses it");
}

/// Warns of a certificate without a name.
pub(crate) fn warn_of_nameless(access: &Access) {
    warn(access.nameless_client(), "what it says may reach nobody");
}

fn warn(found: Option<CellError>, effect: &str) {
    if let Some(found) = found {
        report::line(Label::Warn, format!("{found}: {effect}"));
        if let Some(hint) = found.hint() {
            report::line(Label::Hint, hint);
        }
    }
}
