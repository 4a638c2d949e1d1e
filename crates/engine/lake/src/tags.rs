//! Names for runs: tags, which keep their run, and names that are relative to the newest run.

use std::{
    collections::BTreeMap,
    ffi::OsStr,
    path::{Path, PathBuf},
};

use dataflow::{RunStatus, nearest};
use serde::{Deserialize, Serialize};

use crate::{LakeError, lake::Lake, replicas, sealed};

/// The name of the newest finished run.
const NEWEST: &str = "newest";

/// Separates [`NEWEST`] from the number of runs to count back.
const BEFORE: char = '~';

/// A tag as stored in the lake.
#[derive(Serialize, Deserialize)]
struct Tag {
    name: String,
    run: u64,
}

/// Parses the run from a tag's file, if the tag matches the file's name.
pub(crate) fn parse(path: &Path, bytes: &[u8]) -> Result<u64, LakeError> {
    let tag: Tag = sealed::parse(path, bytes)?;
    if path.file_stem().and_then(OsStr::to_str) == Some(&tag.name) {
        Ok(tag.run)
    } else {
        Err(LakeError::damaged(path))
    }
}

/// Whether a tag may have this name: not a number, a path or an option.
fn is_name(name: &str) -> bool {
    let is_letter = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
    name != NEWEST
        && !name.is_empty()
        && name.len() <= 100
        && name.chars().all(is_letter)
        && !name.starts_with(['.', '-'])
        && !name.chars().all(|c| c.is_ascii_digit())
}

impl Lake {
    fn tag_path(&self, name: &str) -> PathBuf {
        self.folder.tags().join(format!("{name}.json"))
    }

    /// Lists the tags, each with the number of its run. A run that has one is kept.
    ///
    /// # Errors
    ///
    /// Fails if a tag cannot be read.
    pub fn tags(&self) -> Result<BTreeMap<String, u64>, LakeError> {
        let mut tags = BTreeMap::new();
        for file in replicas::names(&self.folder, &self.folder.tags())? {
            if let Some(name) = file.strip_suffix(".json")
                && let Some(run) = replicas::read(&self.folder, &self.tag_path(name), parse)?
            {
                tags.insert(name.to_owned(), run);
            }
        }
        Ok(tags)
    }

    /// Names a run. Returns the run that had this name before.
    ///
    /// # Errors
    ///
    /// Fails if no tag may have this name, there is no such run, or the lake cannot be written.
    pub fn tag(&self, name: &str, run: u64) -> Result<Option<u64>, LakeError> {
        if !is_name(name) {
            return Err(LakeError::InvalidTag {
                name: name.to_owned(),
            });
        }
        // Checked before anything is written: an unknown run creates no folder.
        self.run_without_units(run)?;
        self.prepare()?;
        let _shared = self.locks.block_collection()?;
        self.run_without_units(run)?;
        let path = self.tag_path(name);
        // A damaged tag can be overwritten.
        let before = replicas::read(&self.folder, &path, parse).ok().flatten();
        let tag = Tag {
            name: name.to_owned(),
            run,
        };
        replicas::write(&self.folder, &path, &sealed::seal(&path, &tag)?)?;
        Ok(before)
    }

    /// Removes a tag.
    ///
    /// # Errors
    ///
    /// Fails if there is no such tag, or the lake cannot be written.
    pub fn untag(&self, name: &str) -> Result<(), LakeError> {
        // A damaged tag can be removed too.
        let files = replicas::names(&self.folder, &self.folder.tags())?;
        let mut names = files.iter().filter_map(|file| file.strip_suffix(".json"));
        if !names.any(|there| there == name) {
            return Err(self.no_tag(name)?);
        }
        self.prepare()?;
        // Holding the lock, so that no process restores one file from the other.
        let _turn = self.locks.lock_repair()?;
        replicas::remove(&self.folder, &self.tag_path(name))
    }

    fn no_tag(&self, name: &str) -> Result<LakeError, LakeError> {
        let tags = self.tags()?;
        let near = nearest(name, tags.keys().map(String::as_str));
        Ok(LakeError::NoTag {
            name: name.to_owned(),
            near: near.map(str::to_owned),
        })
    }

    /// Resolves a number, a tag, `newest` or, e.g., `newest~2` (the second before the newest) to a
    /// run's number. Only finished runs are counted back.
    ///
    /// # Errors
    ///
    /// Fails if there is no such run, or a run's record cannot be read.
    pub fn find_run(&self, name: &str) -> Result<u64, LakeError> {
        let no_run = || LakeError::NoRun {
            name: name.to_owned(),
        };
        if let Ok(number) = name.parse() {
            let there = self.runs()?.contains(&number);
            return there.then_some(number).ok_or_else(no_run);
        }
        if let Some(back) = name.strip_prefix(NEWEST)
            && (back.is_empty() || back.starts_with(BEFORE))
        {
            let n_back = match back.strip_prefix(BEFORE) {
                None => 0,
                Some(digits) => digits.parse().ok().ok_or_else(no_run)?,
            };
            return self.finished(n_back)?.ok_or_else(no_run);
        }
        match self.tags()?.get(name) {
            Some(&number) => Ok(number),
            None => Err(self.no_tag(name)?),
        }
    }

    /// The number of the finished run this many before the newest.
    fn finished(&self, n_back: usize) -> Result<Option<u64>, LakeError> {
        let mut n_left = n_back;
        for number in self.register.ordered()?.into_iter().rev() {
            if self.run_without_units(number)?.record.status != RunStatus::Finished {
                continue;
            }
            if n_left == 0 {
                return Ok(Some(number));
            }
            n_left -= 1;
        }
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_paths_and_reserved_words_are_refused_as_tags() {
        for name in ["best", "v1.2", "2026-11-21", "a_b", "newest-good"] {
            assert!(is_name(name), "{name}");
        }
        for name in [
            "", "12", "newest", "newest~2", "a/b", "..", ".x", "-x", "ä", "a b",
        ] {
            assert!(!is_name(name), "{name}");
        }
        assert!(!is_name(&"x".repeat(101)));
    }

    #[test]
    fn a_lake_without_runs_has_no_newest_one_and_takes_no_tag() {
        let folder = tempfile::tempdir().unwrap();
        let lake = Lake::open(&folder.path().join("lake"));
        for name in ["1", "newest", "newest~1", "newest~x"] {
            let found = lake.find_run(name);
            assert!(matches!(found, Err(LakeError::NoRun { .. })), "{name}");
        }
        assert!(matches!(
            lake.find_run("best"),
            Err(LakeError::NoTag { .. })
        ));
        assert!(matches!(lake.tag("best", 1), Err(LakeError::NoRun { .. })));
        assert!(!lake.root().exists());
    }
}
