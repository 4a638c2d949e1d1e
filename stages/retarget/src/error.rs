//! Why demonstrations could not be retargeted.

use std::{io, path::PathBuf};

use dataflow::Advise;
use lake::LakeError;
use robot::RobotError;
use schemas::SchemaError;

/// Why demonstrations could not be retargeted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RetargetError {
    /// An option has a value that makes no sense.
    #[error("option `{key}` of retarget cannot be used: {problem}")]
    BadOption {
        /// The option's key.
        key: String,
        /// What is wrong.
        problem: String,
    },
    /// The hand's URDF cannot be read.
    #[error("cannot read the hand's URDF `{}`", path.display())]
    ReadHand {
        /// The file.
        path: PathBuf,
        /// Why it failed.
        source: io::Error,
    },
    /// An object's mesh cannot be read from the lake.
    #[error("cannot read the mesh of object `{object}`")]
    ReadMesh {
        /// The object's name.
        object: String,
        /// Why it failed.
        source: io::Error,
    },
    /// The hand's URDF cannot be used, or lacks a link that the configuration names.
    #[error("cannot use the hand's URDF `{}`: {source}", path.display())]
    Hand {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: RobotError,
    },
    /// There is no demonstration at all.
    #[error("there are no demonstrations to retarget")]
    NoDemonstrations,
    /// There is no object at all.
    #[error("there are no objects, so that no demonstration has one")]
    NoObjects,
    /// The unit was given no demonstration or no URDF: the plan is not this stage's.
    #[error("the unit `{partition}` reads no {what}")]
    MissingInput {
        /// The unit's partition.
        partition: String,
        /// What is missing.
        what: &'static str,
    },
    /// A table could not be read or written.
    #[error(transparent)]
    Lake(#[from] LakeError),
    /// A table does not follow its schema.
    #[error("the table of `{partition}` does not follow its schema")]
    Schema {
        /// The partition.
        partition: String,
        /// How it differs.
        source: SchemaError,
    },
}

impl Advise for RetargetError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::BadOption { .. } => {
                Some("`pipeline stages retarget` lists every option with its unit".to_owned())
            }
            Self::ReadHand { path, .. } => Some(format!(
                "set `hand` to the URDF of a robot hand; `{}` is read relative to the current \
                 directory",
                path.display()
            )),
            Self::Hand { source, .. } => source.hint().or_else(|| {
                Some("the Allegro hand's URDF is `data/robots/allegro_right.urdf`".to_owned())
            }),
            Self::NoDemonstrations | Self::NoObjects => Some(
                "see what ingest left out with `pipeline inspect ingest.demonstrations --skipped`"
                    .to_owned(),
            ),
            Self::Lake(err) => err.hint(),
            Self::ReadMesh { .. } | Self::MissingInput { .. } | Self::Schema { .. } => None,
        }
    }
}
