//! Why something in the lake could not be read or written.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use dataflow::{Diagnostic, InvalidName, NodeName, PartitionKey};
use depot::DepotError;
use parquet::errors::ParquetError;
use schemas::SchemaError;

/// Why something in the lake could not be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LakeError {
    /// A file or folder could not be read or written.
    #[error("cannot {action} `{}`", path.display())]
    Io {
        /// Operation that failed, e.g. `read`.
        action: &'static str,
        /// Where.
        path: PathBuf,
        /// Why it failed.
        source: io::Error,
    },
    /// A table is not valid Parquet.
    #[error("cannot {action} the table `{}`", path.display())]
    Parquet {
        /// Operation that failed, e.g. `read`.
        action: &'static str,
        /// Where.
        path: PathBuf,
        /// Why it failed.
        source: ParquetError,
    },
    /// A table is compressed in a way that is not read here.
    #[error("`{}` is compressed with {codec}, which is not read", path.display())]
    Compression {
        /// Where.
        path: PathBuf,
        /// The compression, as libraries that write Parquet call it.
        codec: &'static str,
    },
    /// A recording is not valid MCAP.
    #[error("cannot {action} the recording `{}`", path.display())]
    Mcap {
        /// Operation that failed, e.g. `read`.
        action: &'static str,
        /// Where.
        path: PathBuf,
        /// Why it failed.
        source: mcap::McapError,
    },
    /// A record of the lake is damaged.
    #[error("`{}` is damaged: its bytes are not the ones that were written", path.display())]
    Damaged {
        /// Where.
        path: PathBuf,
    },
    /// A file of the lake is gone.
    #[error("`{}` is missing", path.display())]
    Lost {
        /// Its path.
        path: PathBuf,
    },
    /// Another machine writes to the lake, and neither sees the locks of the other.
    #[error(
        "the lake `{}` is that of the machine `{host}`: locks on `{file_system}` hold on one machine only",
        path.display()
    )]
    OtherMachine {
        /// The lake.
        path: PathBuf,
        /// The machine that writes to it.
        host: String,
        /// The type of its file system.
        file_system: String,
    },
    /// A unit made a file that cannot be stored under its name.
    #[error(transparent)]
    Name(#[from] InvalidName),
    /// The lake shares results with no other machine.
    #[error("the lake has no depot")]
    NoDepot,
    /// No run made an output.
    #[error("no run has made `{output}`")]
    NeverMade {
        /// The output.
        output: NodeName,
        /// Those that the newest runs made.
        made: Vec<String>,
    },
    /// Another machine makes this unit, or has made it, and it must not be made twice.
    #[error("{unit} moves a robot, and a lake on `{host}` has claimed it")]
    Claimed {
        /// The unit.
        unit: String,
        /// The other machine.
        host: String,
        /// The key of its claim in the depot.
        key: String,
    },
    /// It cannot be known whether another machine makes this unit.
    #[error("{unit} moves a robot, and whether another machine does so cannot be known")]
    Unclaimed {
        /// The unit.
        unit: String,
        /// Why not.
        source: Box<DepotError>,
    },
    /// A request to the depot failed.
    #[error(transparent)]
    Depot(#[from] DepotError),
    /// The depot lacks a file of a result, or has it damaged.
    #[error("`{key}` of the depot is missing or damaged")]
    LostInDepot {
        /// Its key.
        key: String,
    },
    /// There is no lake.
    #[error("no lake in `{}`", path.display())]
    NoLake {
        /// The path searched.
        path: PathBuf,
    },
    /// No run of this name is in the lake.
    #[error("no run `{name}` in the lake")]
    NoRun {
        /// The name given.
        name: String,
    },
    /// No run has this tag.
    #[error("no run is tagged `{name}`")]
    NoTag {
        /// The name given.
        name: String,
        /// The nearest tag.
        near: Option<String>,
    },
    /// A tag cannot be set.
    #[error("`{name}` is not a name for a tag")]
    InvalidTag {
        /// The name given.
        name: String,
    },
    /// A record of the lake is not valid JSON of the expected form.
    #[error("cannot read the record `{}`", path.display())]
    Json {
        /// Where.
        path: PathBuf,
        /// Why it failed.
        source: serde_json::Error,
    },
    /// A table's columns or values violate its schema.
    #[error("the table of `{key}` does not follow the schema of `{table}`")]
    Schema {
        /// The artifact that it should be.
        table: &'static str,
        /// The partition's key.
        key: PartitionKey,
        /// The difference from the schema.
        source: SchemaError,
    },
    /// A stage's result cannot be written as a table.
    #[error("cannot make the table `{table}`")]
    Rows {
        /// The artifact.
        table: &'static str,
        /// Why not.
        source: SchemaError,
    },
    /// A unit was given more than it reads: the plan is not its stage's.
    #[error("the unit reads {found} partitions of {what}, expected one")]
    SeveralInputs {
        /// The input, e.g. `candidates`.
        what: &'static str,
        /// Partitions given.
        found: usize,
    },
    /// A unit lacks an input: the plan is not its stage's.
    #[error("the unit reads no {what}")]
    MissingInput {
        /// The missing input, e.g. `candidates`.
        what: &'static str,
    },
    /// A stage reported a metric that is NaN or infinite.
    #[error("the stage's metric `{metric}` is {value}, not a finite number")]
    Metric {
        /// The metric's name.
        metric: String,
        /// Its value.
        value: f64,
    },
    /// A file of an artifact is not of its format.
    #[error("artifact `{key}` is damaged: its file `{file}` is not of its format")]
    BadFile {
        /// The partition's key.
        key: PartitionKey,
        /// The file's name.
        file: String,
    },
    /// An artifact lacks a file that its kind requires.
    #[error("artifact `{key}` has no file `{file}`")]
    MissingFile {
        /// The partition's key.
        key: PartitionKey,
        /// The file's name.
        file: String,
    },
}

impl LakeError {
    /// Returns the error of a file whose bytes are not the ones that were written.
    pub(crate) fn damaged(path: &Path) -> Self {
        Self::Damaged {
            path: path.to_owned(),
        }
    }

    /// Returns a function that adds the path to an error of JSON.
    pub(crate) fn json(path: &Path) -> impl FnOnce(serde_json::Error) -> Self {
        move |source| Self::Json {
            path: path.to_owned(),
            source,
        }
    }

    /// Returns a function that adds the action and the path to an error of Parquet.
    pub(crate) fn parquet<E: Into<ParquetError>>(
        action: &'static str,
        path: &Path,
    ) -> impl Fn(E) -> Self {
        move |source| Self::Parquet {
            action,
            path: path.to_owned(),
            source: source.into(),
        }
    }
}

/// Names the command that moves away what is in the place of a folder, or of a file: out of the lake, in which
/// nothing else may lie.
fn move_away(path: &Path) -> String {
    let above = path.ancestors();
    let mut in_place = above.filter(|above| above.symlink_metadata().is_ok() && !above.is_dir());
    let place = in_place.next().unwrap_or(path);
    let aside = aside(place).unwrap_or_else(|| place.display().to_string());
    format!(
        "something else is in its place: `mv '{}' '{aside}.aside'`, then run the same command again; \
         what is missing is made again",
        place.display()
    )
}

/// Returns a name beside the lake for something in it.
fn aside(place: &Path) -> Option<String> {
    let lake = lake_around(place)?;
    let name = lake.file_name()?.to_string_lossy();
    let below = place.strip_prefix(lake).ok()?;
    let below = below.to_string_lossy().replace('/', ".");
    let aside = lake.with_file_name(format!("{name}.{below}"));
    Some(aside.display().to_string())
}

/// Returns the lake in which a path is, as its folders show.
fn lake_around(path: &Path) -> Option<&Path> {
    let is_lake = |above: &&Path| {
        let folders = ["blobs", "units", "runs", "recipes", "manifests", "copies"];
        let there = folders.map(|name| above.join(name).symlink_metadata().is_ok());
        there.into_iter().filter(|there| *there).count() > 2
    };
    path.ancestors().skip(1).find(is_lake)
}

/// Whether a link that leads nowhere, a pipe, a socket or a device is on the way to a file.
fn is_in_the_way(path: &Path) -> bool {
    path.ancestors().any(|above| {
        above.symlink_metadata().is_ok()
            && !fs::metadata(above).is_ok_and(|found| found.is_file() || found.is_dir())
    })
}

/// Returns what to do about an operating system's error of this kind at a path.
fn io_hint(kind: io::ErrorKind, path: &Path) -> Option<String> {
    let hint = match kind {
        io::ErrorKind::PermissionDenied if path.symlink_metadata().is_ok() => format!(
            "let yourself read and write it: `chmod u+rwX '{}'`, or choose another lake with `--lake DIR`",
            path.display()
        ),
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => {
            "choose a lake that can be written with `--lake DIR`".to_owned()
        }
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge => {
            "what is made so far is kept: free some space, for example with `pipeline gc`, \
             then run the same command again"
                .to_owned()
        }
        io::ErrorKind::NotADirectory
        | io::ErrorKind::IsADirectory
        | io::ErrorKind::DirectoryNotEmpty
        | io::ErrorKind::AlreadyExists => move_away(path),
        io::ErrorKind::Unsupported => {
            "the file system has no locks: put the lake on another with `--lake DIR`".to_owned()
        }
        _ if is_in_the_way(path) => move_away(path),
        io::ErrorKind::NotFound if lake_around(path).is_some() => {
            "a run that needs it makes it again; `pipeline verify` lists all that is missing"
                .to_owned()
        }
        _ => return None,
    };
    Some(hint)
}

/// Returns the newest runs of a lake, as text for people.
fn newest_runs(made: &[String]) -> String {
    if made.is_empty() {
        "no run is in this lake yet: `pipeline run FILE` finds what the depot has".to_owned()
    } else {
        format!("the newest runs made: {}", made.join(", "))
    }
}

impl Diagnostic for LakeError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::Io { source, path, .. } => io_hint(source.kind(), path),
            Self::Damaged { .. } => Some(
                "`pipeline verify` lists everything that is damaged; `pipeline verify --drop` drops \
                 it, and the next run makes it again"
                    .to_owned(),
            ),
            Self::Lost { .. } => Some(
                "run its pipeline again: what is missing is put back or made again; \
                 `pipeline verify` lists everything that is missing"
                    .to_owned(),
            ),
            Self::OtherMachine { path, host, .. } => Some(format!(
                "put the lake on a disk of this machine with `--lake DIR`, and share results by \
                 `PIPELINE_DEPOT=DIR` on both; if `{host}` does not use it any more, remove `{}`",
                path.join("locks/machine").display()
            )),
            Self::NeverMade { made, .. } => Some(newest_runs(made)),
            Self::Claimed { host, key, .. } => Some(format!(
                "run it on `{host}`, whose result comes here through the depot; if that machine is gone, \
                 look at the robot, then remove `{key}` from the depot"
            )),
            Self::Unclaimed { .. } => Some(
                "mount the depot, or run without it where no other machine moves this robot".to_owned(),
            ),
            Self::NoDepot => Some("name one, e.g. `export PIPELINE_DEPOT=/mnt/lab/depot`".to_owned()),
            Self::Depot(err) => Some(err.hint().unwrap_or_else(|| {
                "check that it can be reached and written by you; results stay in the lake until then"
                    .to_owned()
            })),
            Self::LostInDepot { .. } => Some(
                "`pipeline verify --depot` lists what is damaged in it; a run of its pipeline makes it again"
                    .to_owned(),
            ),
            Self::NoLake { .. } => Some(
                "name the folder of one with `--lake DIR`, or make one with \
                 `pipeline run pipelines/cgf.toml`"
                    .to_owned(),
            ),
            Self::NoRun { .. } => Some("`pipeline runs` lists them".to_owned()),
            Self::NoTag { near, .. } => Some(near.as_ref().map_or_else(
                || "`pipeline runs` lists the runs with their tags".to_owned(),
                |near| format!("did you mean `{near}`?"),
            )),
            Self::InvalidTag { .. } => Some(
                "use ASCII letters, digits, `_`, `-` and `.`, a letter or digit first, and neither \
                 only digits nor `newest`"
                    .to_owned(),
            ),
            Self::Schema { .. } | Self::BadFile { .. } | Self::MissingFile { .. } => {
                Some("make it again with `pipeline run FILE --fresh`".to_owned())
            }
            Self::Compression { .. } => {
                Some("write it with the compression `zstd` or `snappy`, or without one".to_owned())
            }
            Self::Json { .. } => Some(
                "another version of the program wrote the file: use that one, or see what `pipeline verify` says of it"
                    .to_owned(),
            ),
            Self::Parquet { action: "read", .. } | Self::Mcap { action: "read", .. } => Some(
                "`pipeline verify` says whether the file is damaged: then `pipeline verify --drop` deletes it and the \
                 next run makes it again, otherwise `pipeline run FILE --fresh` does"
                    .to_owned(),
            ),
            Self::SeveralInputs { .. } | Self::MissingInput { .. } | Self::Metric { .. } => Some(
                "this is a fault of the stage: please report it with the command and the file"
                    .to_owned(),
            ),
            Self::Parquet { .. } | Self::Mcap { .. } | Self::Rows { .. } | Self::Name(_) => None,
        }
    }
}
