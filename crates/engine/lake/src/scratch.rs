//! Temporary folders.

use std::{
    fs,
    path::{Path, PathBuf},
};

use crate::{
    LakeError,
    atomic::{self, io_error},
    lake::Lake,
};

/// A temporary folder of this process in the lake, removed on drop.
pub(crate) struct Scratch(PathBuf);

impl Scratch {
    pub(crate) fn make(lake: &Lake) -> Result<Self, LakeError> {
        let folder = Self(atomic::unique_name(&lake.folder.staging(), "folder"));
        fs::create_dir_all(&folder.0).map_err(io_error("create", &folder.0))?;
        Ok(folder)
    }

    pub(crate) fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // Leftovers are removed by a later run.
        let _left = fs::remove_dir_all(&self.0);
    }
}
