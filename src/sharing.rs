//! The depot in which this machine shares results with others, as the environment names it.

use std::{
    env, fmt,
    path::{Path, PathBuf},
    sync::Arc,
    time::Duration,
};

use dataflow::{Failure, UnitOutcome, WorkItem};
use depot::{Depot, FolderDepot};
use lake::{Lake, Sharing};
use object_depot::ObjectDepot;

use crate::{command_line::Program, label::Label, outages, outcome::CommandError, report};

/// Variable with the depot's URL or folder.
pub(crate) const VARIABLE: &str = "PIPELINE_DEPOT";

/// Time that the end of a run waits for results that are still being sent.
const SEND_TIMEOUT: Duration = Duration::from_secs(10);

/// Units of one kind that are named in a line.
const NAMED: usize = 3;

impl Program<'_> {
    /// Opens the lake with the depot that the environment names, if it names one: it is done without where that is
    /// down.
    pub(crate) fn open_lake(&self) -> Result<Lake, CommandError> {
        self.open_lake_with(&Sharing::default())
    }

    /// Opens the lake with the depot that the environment names, if it names one, used in this way.
    pub(crate) fn open_lake_with(&self, sharing: &Sharing) -> Result<Lake, CommandError> {
        let lake = Lake::open(&self.lake);
        Ok(match depot()? {
            Some(depot) => lake.with_depot(&depot, sharing),
            None => lake,
        })
    }

    /// Opens the lake with its depot, for a command that makes no sense without one.
    pub(crate) fn open_shared_lake(&self) -> Result<Lake, CommandError> {
        let depot = depot()?.ok_or_else(|| {
            CommandError::usage(
                "no depot to share results in",
                format!("name one, e.g. `export {VARIABLE}=/mnt/lab/depot`"),
            )
        })?;
        Ok(Lake::open(&self.lake).with_depot(&depot, &outages::required_sharing(self.quiet)))
    }

    /// Sends the remaining results, for a while, and reports the shared ones.
    pub(crate) fn end_sharing(&self, lake: &Lake) -> Result<(), CommandError> {
        lake.finish_sending(SEND_TIMEOUT)?;
        self.say_shared(lake)
    }

    /// Reports the shared results, and faults of the depot.
    pub(crate) fn say_shared(&self, lake: &Lake) -> Result<(), CommandError> {
        let Some(shared) = lake.sharing()? else {
            return Ok(());
        };
        let traffic = shared.traffic;
        if traffic.n_requests > 0 {
            self.say(
                Label::Depot,
                format!(
                    "{} units found, {} files fetched ({}), {} units sent ({}), {} requests",
                    shared.n_units_found,
                    shared.n_files_fetched,
                    report::bytes(traffic.bytes_got),
                    shared.n_units_sent,
                    report::bytes(traffic.bytes_put),
                    traffic.n_requests,
                ),
            );
        }
        if let Some(why) = &shared.offline {
            report::line_with_hint(
                Label::Warn,
                format!("the depot is not used: {why}"),
                Some("what is made here is kept, and sent by a later run or `pipeline push`"),
            );
        } else if shared.n_units_waiting > 0 {
            let waiting = format!(
                "{} units are not in the depot yet; a later run or `pipeline push` sends them",
                shared.n_units_waiting
            );
            match &shared.unsent {
                Some(why) => report::line_with_hint(Label::Warn, why, Some(&waiting)),
                None => self.say(Label::Note, waiting),
            }
        }
        if shared.n_damaged > 0 {
            report::line_with_hint(
                Label::Warn,
                format!(
                    "{} files came damaged from the depot and are not used",
                    shared.n_damaged
                ),
                Some("`pipeline verify --depot` lists what is damaged in it"),
            );
        }
        for (unit, host) in shared.differing.iter().take(NAMED) {
            report::line(
                Label::Note,
                format!("{unit} came out differently on `{host}`, whose result the depot keeps"),
            );
        }
        Ok(())
    }
}

/// Says, where a run makes the lake, that no other machine may write to it.
pub(crate) fn say_unlocked(lake: &Lake) {
    if lake.check_exists().is_err()
        && let Some(kind) = lake.file_system_without_locks()
    {
        report::line_with_hint(
            Label::Note,
            format!(
                "the lake is on `{kind}`, whose locks hold on this machine only: no other may write to it"
            ),
            Some(&local_lake_advice()),
        );
    }
}

/// Returns the alternative to a lake on a folder that machines share.
pub(crate) fn local_lake_advice() -> String {
    format!(
        "keep the lake on a disk of this machine with `--lake DIR`, and share results in a folder by \
         `export {VARIABLE}=DIR`"
    )
}

/// Uploads the inputs of a work item to the depot; returns the item's outcome if that fails.
pub(crate) fn upload_inputs(lake: &Lake, item: &WorkItem) -> Option<UnitOutcome> {
    let mut missing = Vec::new();
    for (unit, file) in item.reads() {
        match lake.offer(file) {
            Ok(true) => {}
            Ok(false) => missing.push(unit),
            Err(err) => return Some(UnitOutcome::Failed(Failure::Store(err.into()))),
        }
    }
    (!missing.is_empty()).then(|| UnitOutcome::missing_artifacts(missing))
}

/// A depot, as it is named.
pub(crate) enum DepotName {
    /// A folder that machines mount.
    Folder(PathBuf),
    /// The URL of an object store.
    Store(String),
}

impl fmt::Display for DepotName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Folder(folder) => folder.display().fmt(f),
            Self::Store(url) => url.fmt(f),
        }
    }
}

/// Returns the depot that the environment names.
pub(crate) fn depot() -> Result<Option<Arc<dyn Depot>>, CommandError> {
    Ok(match depot_name()? {
        None => None,
        Some(DepotName::Folder(folder)) => Some(Arc::new(FolderDepot::new(&folder))),
        Some(DepotName::Store(url)) => {
            let store = ObjectDepot::from_url(&url).map_err(|err| {
                let hint = "write `s3://BUCKET/PREFIX`, with credentials, `AWS_REGION` and, for a store that is not \
                            Amazon's, `AWS_ENDPOINT_URL` in the environment";
                CommandError::failed(err, Some(hint.to_owned()))
            })?;
            Some(Arc::new(store))
        }
    })
}

/// Returns the name of the depot that the environment names.
pub(crate) fn depot_name() -> Result<Option<DepotName>, CommandError> {
    let Some(named) = env::var_os(VARIABLE).filter(|named| !named.is_empty()) else {
        return Ok(None);
    };
    let url = named.to_string_lossy();
    let path = match url.split_once("://") {
        None => Path::new(&named),
        Some(("file", path)) => Path::new(path),
        Some(("s3", _)) => return Ok(Some(DepotName::Store(url.into_owned()))),
        Some((scheme, _)) => {
            return Err(CommandError::usage(
                format!("`{VARIABLE}` names a depot of the unknown kind `{scheme}`"),
                "use a folder, e.g. `/mnt/lab/depot`, or an object store, `s3://BUCKET/PREFIX`",
            ));
        }
    };
    if path.is_relative() {
        return Err(CommandError::usage(
            format!("`{VARIABLE}` is `{url}`, which is relative to the working directory"),
            "name the folder from the root, e.g. `/mnt/lab/depot`",
        ));
    }
    Ok(Some(DepotName::Folder(path.to_owned())))
}
