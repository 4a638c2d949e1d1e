//! Why a hand could not be loaded from its files.

use std::{io, path::PathBuf};

use dataflow::{Diagnostic, missing};
use posture::PostureError;
use robot_meshes::LoadError;

/// Why a hand could not be loaded from its files.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HandFileError {
    /// The robot cannot be loaded.
    #[error(transparent)]
    LoadRobot(#[from] LoadError),
    /// The hand's file cannot be read.
    #[error("cannot read the hand's file `{}`", path.display())]
    ReadHandTable {
        /// The file.
        path: PathBuf,
        /// Why it failed.
        source: io::Error,
    },
    /// The hand's URDF cannot be used, or lacks a link that its file names.
    #[error("cannot use the hand's URDF `{}`", path.display())]
    Hand {
        /// The file.
        path: PathBuf,
        /// The problem with it.
        source: PostureError,
    },
    /// The hand's file cannot be used.
    #[error("cannot use the hand's file `{}`", path.display())]
    HandTable {
        /// The file.
        path: PathBuf,
        /// The problem with it.
        source: PostureError,
    },
    /// The hand's file names no URDF.
    #[error("the hand's file `{}` names no URDF", path.display())]
    NoUrdf {
        /// The file.
        path: PathBuf,
    },
}

impl Diagnostic for HandFileError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::LoadRobot(err) => err.hint(),
            Self::ReadHandTable { path, .. } => Some(format!(
                "set `hand` to the file of a robot hand; {}",
                missing(path)
            )),
            Self::Hand { source, .. } | Self::HandTable { source, .. } => source.hint(),
            Self::NoUrdf { .. } => {
                Some("write `urdf = \"hand.urdf\"` in it: a path from the file's folder".to_owned())
            }
        }
    }
}
