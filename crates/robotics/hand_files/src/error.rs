//! Why a hand could not be loaded from its files.

use std::{io, path::PathBuf};

use dataflow::{Advise, missing};
use posture::PostureError;
use robot_meshes::LoadError;

/// Why a hand could not be loaded from its files.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HandFileError {
    /// The robot cannot be loaded.
    #[error(transparent)]
    LoadRobot(#[from] LoadError),
    /// The hand table cannot be read.
    #[error("cannot read the hand table `{}`", path.display())]
    ReadHandTable {
        /// The file.
        path: PathBuf,
        /// Why it failed.
        source: io::Error,
    },
    /// The hand's URDF cannot be used, or lacks a link that its table names.
    #[error("cannot use the hand's URDF `{}`", path.display())]
    Hand {
        /// The file.
        path: PathBuf,
        /// The problem with it.
        source: PostureError,
    },
    /// The hand table cannot be used.
    #[error("cannot use the hand table `{}`", path.display())]
    HandTable {
        /// The file.
        path: PathBuf,
        /// The problem with it.
        source: PostureError,
    },
}

impl Advise for HandFileError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::LoadRobot(err) => err.hint(),
            Self::ReadHandTable { path, .. } => Some(format!(
                "set `hand_table` to the table of a robot hand; {}",
                missing(path)
            )),
            Self::Hand { source, .. } | Self::HandTable { source, .. } => source.hint(),
        }
    }
}
