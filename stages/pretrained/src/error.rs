//! Why a function cannot be offered.

use std::{io, path::PathBuf};

use cgf::CgfError;
use dataflow::Diagnostic;

/// Why a function cannot be offered.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PretrainedError {
    /// One of the two files is not there.
    #[error("cannot read `{}` of the grasping function", path.display())]
    NoFile {
        /// Where it should be.
        path: PathBuf,
        /// Why it cannot be read.
        source: io::Error,
    },
    /// The files are damaged, of another version, or do not fit together.
    #[error(transparent)]
    Cgf(CgfError),
}

impl Diagnostic for PretrainedError {
    fn hint(&self) -> Option<String> {
        let hint = match self {
            Self::NoFile { .. } => {
                "set `checkpoint` to a folder with `last.safetensors` and `last.json`, as `train` makes them"
            }
            Self::Cgf(CgfError::Version { .. }) => {
                "train the function again with this program, or use the program of its time"
            }
            Self::Cgf(_) => "copy both files again from one checkpoint",
        };
        Some(hint.to_owned())
    }
}
