//! A folder that appears whole or not at all.

use std::{
    collections::BTreeMap,
    fs::{self, File},
    io,
    path::{Path, PathBuf},
};

use anyhow::{Context, Error};
use tempfile::TempDir;

use crate::outcome::CommandError;

/// A folder that is to be written.
pub(super) struct Folder {
    /// Its place, absolute.
    path: PathBuf,
    /// Temporary folder beside its place, in which it is made; removed unless it is finished.
    beside: TempDir,
}

impl Folder {
    /// Prepares a folder.
    ///
    /// # Errors
    ///
    /// Fails if there is something in its place, or nothing can be written beside it.
    pub(super) fn new(path: &Path) -> Result<Self, CommandError> {
        let failed = |err: io::Error| {
            let message = format!("cannot write `{}`", path.display());
            CommandError::failed(Error::from(err).context(message), None)
        };
        if path.symlink_metadata().is_ok() {
            return Err(CommandError::usage(
                format!("`{}` is there already", path.display()),
                "name another folder, or remove it first",
            ));
        }
        let path = std::path::absolute(path).map_err(failed)?;
        let parent = path.parent().unwrap_or(&path);
        fs::create_dir_all(parent).map_err(failed)?;
        let beside = tempfile::Builder::new()
            .prefix(".export-")
            .tempdir_in(parent);
        Ok(Self {
            beside: beside.map_err(failed)?,
            path,
        })
    }

    /// Returns its final path.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Writes the files, and puts the folder in its place.
    ///
    /// # Errors
    ///
    /// Fails if a file cannot be written, or something else has taken the place; then nothing is left.
    pub(super) fn write(self, files: &BTreeMap<String, Vec<u8>>) -> Result<(), CommandError> {
        // The folder for a program's own use has its permissions; this one gets those of any folder.
        let made = self.beside.path().join("export");
        for (name, bytes) in files {
            lake::write_atomic(&made.join(name), bytes)?;
        }
        let parent = self.path.parent().unwrap_or(&self.path);
        let moved = fs::rename(&made, &self.path).and_then(|()| File::open(parent)?.sync_all());
        moved
            .with_context(|| format!("cannot write `{}`", self.path.display()))
            .map_err(|err| CommandError::failed(err, None))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn files(names: &[&str]) -> BTreeMap<String, Vec<u8>> {
        names
            .iter()
            .map(|name| ((*name).to_owned(), b"bytes".to_vec()))
            .collect()
    }

    #[test]
    fn is_there_with_everything_and_leaves_nothing_beside() {
        let lab = tempfile::tempdir().unwrap();
        let path = lab.path().join("new/out");
        Folder::new(&path)
            .unwrap()
            .write(&files(&["meta/a", "b"]))
            .unwrap();
        assert_eq!(fs::read(path.join("meta/a")).unwrap(), b"bytes");
        assert_eq!(fs::read_dir(lab.path().join("new")).unwrap().count(), 1);
    }

    #[test]
    fn takes_no_ones_place_and_what_fails_leaves_nothing() {
        let lab = tempfile::tempdir().unwrap();
        let path = lab.path().join("out");
        let late = Folder::new(&path).unwrap();
        Folder::new(&path).unwrap().write(&files(&["a"])).unwrap();
        assert!(matches!(
            Folder::new(&path),
            Err(CommandError::Usage { .. })
        ));
        assert!(late.write(&files(&["b"])).is_err());
        let broken = Folder::new(&lab.path().join("other")).unwrap();
        assert!(broken.write(&files(&["a", "a/b"])).is_err());
        let left: Vec<_> = fs::read_dir(lab.path()).unwrap().collect();
        assert_eq!(left.len(), 1, "{left:?}");
        assert!(path.join("a").is_file() && !path.join("b").exists());
    }
}
