//! Why a dataset, or one recording of it, could not be used.

use std::{
    cmp::Reverse,
    collections::BTreeMap,
    io,
    path::{Path, PathBuf},
};

use dataflow::Diagnostic;

use crate::{npz::NpzError, yaml::YamlError};

/// Maximum number of reasons that a message lists.
const NAMED: usize = 3;

/// Why a dataset could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum IngestError {
    /// The directory does not have the dataset's layout.
    #[error("no DexYCB sequences under `{}`", root.display())]
    NoSequences {
        /// The directory searched.
        root: PathBuf,
        /// A directory above or below that has it.
        near: Option<PathBuf>,
    },
    /// The directory holds no tracks.
    #[error("no `SUBJECT/SEQUENCE/track.yml` under `{}`", root.display())]
    NoTracks {
        /// The directory searched.
        root: PathBuf,
        /// A directory above or below that holds some.
        near: Option<PathBuf>,
    },
    /// The directory does not have `HO-Cap`'s layout.
    #[error("no HO-Cap sequences under `{}`", root.display())]
    NoHoCap {
        /// The directory searched.
        root: PathBuf,
        /// A directory above or below that has it.
        near: Option<PathBuf>,
    },
    /// An option names a subject or an object that no recording has.
    #[error("no recording has the name `{name}` of `{key}`")]
    UnknownName {
        /// The option.
        key: &'static str,
        /// The name.
        name: String,
        /// The nearest name that there is.
        near: Option<String>,
        /// All names that there are.
        known: Vec<String>,
    },
    /// A split goes by the trial's number, which a part of the dataset does not tell.
    #[error(
        "`split` s0 needs all five recordings of each subject with each object, but there are \
         {found} of `{subject}` with `{object}`"
    )]
    Trials {
        /// The subject's folder.
        subject: String,
        /// The object's name.
        object: String,
        /// Recordings that there are.
        found: usize,
    },
    /// The options leave out every recording.
    #[error("the options leave out all {found} recordings: {}", counted(reasons))]
    NoneChosen {
        /// Recordings that there are.
        found: usize,
        /// Number of those left out for each reason.
        reasons: BTreeMap<String, usize>,
    },
    /// Of no recording it can be told what it is about.
    #[error("none of the {found} selected recordings has readable metadata")]
    NoneTold {
        /// Recordings that there are.
        found: usize,
        /// The fault of the first one.
        source: RecordingError,
    },
    /// An option names what no recording has, but one cannot be told what it is about.
    #[error("{problem}, and one recording has unreadable metadata")]
    Untold {
        /// What the option names.
        problem: String,
        /// The fault of the first such recording.
        source: Box<RecordingError>,
    },
    /// Landmarks are asked of hand models, but no folder of them is named.
    #[error("`landmarks` asks for hand models, but `mano_models` names no folder of them")]
    NoHandModels,
    /// Landmarks are asked of hand models, but only DexYCB has poses of them.
    #[error("`landmarks` asks for hand models, but only recordings of DexYCB have their poses")]
    NoHandPoses,
    /// The folder of hand models lacks one, or there is no such folder.
    #[error("no hand model at `{}`", path.display())]
    NoHandModel {
        /// The expected path.
        path: PathBuf,
    },
    /// A hand model cannot be read.
    #[error("the hand model cannot be used")]
    HandModel(#[source] RecordingError),
    /// The dataset's terms of use cannot be read.
    #[error("the dataset's terms of use cannot be read")]
    Terms(#[source] RecordingError),
    /// An object of the pipeline file has a name that no partition can have.
    #[error(
        "`{name}` below `meshes` is not a name for an object: letters, digits, `_` and `-` only"
    )]
    MeshName {
        /// The name.
        name: String,
    },
    /// A mesh of the pipeline file is not there.
    #[error("no mesh of `{object}` at `{}`", path.display())]
    NoMesh {
        /// The object's name.
        object: String,
        /// The file named.
        path: PathBuf,
    },
    /// A mesh of the pipeline file cannot be read.
    #[error("the mesh of `{object}` cannot be used")]
    Mesh {
        /// The object's name.
        object: String,
        /// The fault of the file named.
        source: RecordingError,
    },
    /// A directory of the dataset could not be listed.
    #[error("cannot list the folder `{}`", path.display())]
    List {
        /// Where.
        path: PathBuf,
        /// Why it failed.
        source: io::Error,
    },
    /// Nobody knows how heavy an object is.
    #[error("the mass of `{object}` is not known")]
    UnknownMass {
        /// The object's name.
        object: String,
    },
}

impl Diagnostic for IngestError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::NoSequences {
                near: Some(near), ..
            }
            | Self::NoTracks {
                near: Some(near), ..
            }
            | Self::NoHoCap {
                near: Some(near), ..
            } => Some(format!(
                "the dataset's root seems to be `{}`: set `root` to that",
                near.display()
            )),
            Self::NoSequences { root, near: None } => Some(format!(
                "unpack the dataset so that `{}` exists, or try the bundled sample: `pipeline run \
                 pipelines/cgf.toml`{}",
                root.join("20200709-subject-01").display(),
                elsewhere(root)
            )),
            Self::UnknownMass { object } => Some(format!(
                "add its mass in kilograms to the pipeline file, e.g. `{object} = 0.35` below \
                 `[stages.ingest.masses_kg]`"
            )),
            Self::NoTracks { root, near: None } => Some(format!(
                "every recording has a folder with `track.yml` and `track.npz`; a dataset in \
                 DexYCB's layout has `format = \"dexycb\"`{}",
                elsewhere(root)
            )),
            Self::NoHoCap { root, near: None } => Some(format!(
                "unpack the dataset so that `{}` exists{}",
                root.join("subject_1").display(),
                elsewhere(root)
            )),
            Self::UnknownName { near, known, .. } => Some(match near {
                Some(near) => format!("did you mean `{near}`?"),
                None => format!("there are: {}", known.join(", ")),
            }),
            Self::Trials { .. } => Some(
                "take `split = \"all\"`, or one of s1, s2 and s3, which go by subject, camera and \
                 object"
                    .to_owned(),
            ),
            Self::NoHandPoses => Some("take `landmarks = \"labels\"`".to_owned()),
            Self::NoHandModels | Self::NoHandModel { .. } | Self::HandModel(_) => Some(
                "get MANO's own files from https://mano.is.tue.mpg.de and set `mano_models` to the \
                 folder that holds `MANO_RIGHT.pkl` and `MANO_LEFT.pkl`, or take \
                 `landmarks = \"labels\"`"
                    .to_owned(),
            ),
            Self::NoMesh { object, .. } | Self::Mesh { object, .. } => Some(format!(
                "correct `file` below `[stages.ingest.meshes.{object}]`"
            )),
            Self::NoneChosen { .. } => Some(
                "change `hand`, `subjects`, `objects` or `split`, or take both hands with \
                 `mirror = true`"
                    .to_owned(),
            ),
            Self::List { path, source } => unlisted(path, source.kind()),
            Self::NoneTold { .. }
            | Self::Untold { .. }
            | Self::MeshName { .. }
            | Self::Terms(_) => None,
        }
    }
}

/// Returns what helps where a folder of a dataset cannot be listed.
fn unlisted(path: &Path, kind: io::ErrorKind) -> Option<String> {
    match kind {
        io::ErrorKind::PermissionDenied => Some(format!(
            "give yourself the right to, e.g. with `chmod u+rx {}`, or move it out of the dataset",
            path.display()
        )),
        io::ErrorKind::NotADirectory => {
            Some("set `root` to the folder that holds the subjects' folders".to_owned())
        }
        _ => None,
    }
}

/// Suggested root of a dataset, if the given one does not exist.
fn elsewhere(root: &Path) -> String {
    if root.is_dir() {
        return String::new();
    }
    format!("; {}", dataflow::missing(root))
}

/// Lists the number of each, the most frequent ones first, and says if there are others.
fn counted(reasons: &BTreeMap<String, usize>) -> String {
    let mut reasons: Vec<_> = reasons.iter().collect();
    reasons.sort_by_key(|&(_, &n)| Reverse(n));
    let named = reasons.iter().take(NAMED);
    let mut said: Vec<String> = named.map(|(reason, n)| format!("{reason} ({n})")).collect();
    if reasons.len() > NAMED {
        said.push("and other reasons".to_owned());
    }
    said.join(", ")
}

/// Says what to do about a file or a folder that cannot be read.
fn remedy(source: &io::Error) -> &'static str {
    if source.kind() == io::ErrorKind::PermissionDenied {
        ": give yourself the right to, e.g. with `chmod -R u+rX` on the dataset"
    } else {
        ""
    }
}

/// Why one recording or one object could not be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// A file is not there.
    #[error("no `{file}`")]
    Missing {
        /// Its name in the dataset.
        file: String,
    },
    /// A file could not be read from disk.
    #[error("cannot read `{file}`: {source}{}", remedy(source))]
    Unreadable {
        /// Its name in the dataset.
        file: String,
        /// Why it failed.
        source: io::Error,
    },
    /// Something else lies in a file's place.
    #[error("`{file}` is {found}: put the file there, or remove it")]
    NotAFile {
        /// The file's name in the dataset.
        file: String,
        /// Kind of the item found instead.
        found: &'static str,
    },
    /// A name cannot be written.
    #[error("the name of `{name}` is not UTF-8: rename it")]
    NotUtf8 {
        /// The name, as much of it as is text.
        name: String,
    },
    /// A file is larger than any of its kind.
    #[error(
        "`{file}` has {found} bytes, more than the {limit} that such a file can have: put the right \
         one there"
    )]
    TooLarge {
        /// Its name in the dataset.
        file: String,
        /// Its size in bytes.
        found: u64,
        /// The largest accepted size in bytes.
        limit: u64,
    },
    /// An array file is damaged or holds something else.
    #[error("{source} in `{file}`")]
    Npz {
        /// Its name in the dataset.
        file: String,
        /// The fault.
        source: NpzError,
    },
    /// A YAML file is damaged or lacks a key.
    #[error("`{file}`: {source}")]
    Yaml {
        /// Its name in the dataset.
        file: String,
        /// The fault.
        source: YamlError,
    },
    /// A number is outside of what the format allows.
    #[error("{what} in `{file}`")]
    Value {
        /// The fault.
        what: String,
        /// Its name in the dataset.
        file: String,
    },
    /// No camera has annotations.
    #[error("no camera has label files, and there is no hand model (`mano_models`) in their place")]
    NoLabels,
    /// The hand is never seen.
    #[error("no image shows a hand")]
    NoHand,
    /// The object is never seen.
    #[error("no image shows the grasped object")]
    NoObject,
    /// The object stays where it is.
    #[error("the object never moves")]
    NeverMoves,
    /// The hand appears too late, or the object moves too early.
    #[error("the reach has {found} steps, fewer than {min}")]
    TooShort {
        /// Steps found.
        found: usize,
        /// Fewest accepted.
        min: usize,
    },
    /// The hand is out of sight for too long.
    #[error(
        "no hand in {found} images from image {image} on, more than the {max} that are bridged"
    )]
    Gap {
        /// First image without a hand.
        image: usize,
        /// Images without a hand.
        found: usize,
        /// Most that are bridged.
        max: usize,
    },
    /// The hand model cannot be used.
    #[error("`{file}`: {reason}")]
    HandModel {
        /// Its name in the dataset.
        file: String,
        /// The fault.
        reason: String,
    },
    /// The first line of the dataset's terms says nothing, or is no line.
    #[error(
        "the first line of `{file}` is empty or has more than 200 characters: say there what the \
         dataset is and its terms of use, e.g. `DexYCB, CC BY-NC 4.0`"
    )]
    TermsLine {
        /// Its name in the dataset.
        file: String,
    },
    /// Landmarks are asked of a hand model, but there is none.
    #[error("no hand model poses this hand, but `landmarks` asks for one")]
    NoHandModel,
    /// Nothing says where the table is.
    #[error("nothing says where the table is: no tag, and no still object whose shape is known")]
    NoTable,
    /// Too few objects stand on the table that they would share.
    #[error(
        "only {found} of the still objects can stand on one table, fewer than `min_table_objects_n` \
         = {min}"
    )]
    FewOnTable {
        /// Objects that agree.
        found: usize,
        /// Fewest accepted.
        min: usize,
    },
    /// The object does not lie on the table.
    #[error(
        "the lowest point of the resting object is {:.0} mm from the table, more than \
         `max_table_error_m`: are quaternions x, y, z, w?",
        1000.0 * found_m
    )]
    OffTable {
        /// Height above the table, in meters.
        found_m: f64,
    },
    /// A recording of the other hand cannot be mirrored.
    #[error("{reason}: the {hand} hand cannot be mirrored")]
    NotMirrored {
        /// The recorded hand.
        hand: &'static str,
        /// The obstacle.
        reason: String,
    },
    /// The object's mesh cannot be used.
    #[error("`{file}`: {reason}")]
    Mesh {
        /// Its name in the dataset.
        file: String,
        /// The fault.
        reason: String,
    },
}
