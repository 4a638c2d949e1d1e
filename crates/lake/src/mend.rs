//! Repair of published and irreplaceable files: records of runs and their tables, every table that
//! runs refer to, and the views.
//!
//! A finishing run checks only sizes, times and inodes. Records, and new or changed files, are read
//! only if a file was added, removed or changed since the last full check.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

use dataflow::{Digest, FileRef, RunStatus};

use crate::{
    LakeError, again, atomic,
    digests::digest_file,
    folder::{files_below, run_of, unit_of},
    history,
    lake::Lake,
    published, records, register,
    seen::{Seen, Watched},
    table, tags, twice, views,
};

/// Restores lost, damaged or exchanged files, and removes foreign ones.
pub(crate) fn mend(lake: &Lake) -> Result<(), LakeError> {
    let folder = &lake.folder;
    let seen = Seen::read(folder)?;
    if seen.is_unchanged(folder) {
        return Ok(());
    }
    let watched = Watched::list(folder)?;
    if seen.is_all_there_is(folder, &watched) {
        if let Some(seen) = seen.in_folders_of(watched)
            && lake.prepare().is_ok()
        {
            // If this fails, as in a read-only lake, they are listed each time.
            let _kept = seen.write(folder);
        }
        return Ok(());
    }
    lake.prepare()?;
    let _turn = lake.locks.lock_repair()?;
    // Files about to be published are not collected meanwhile.
    let _shared = lake.locks.block_collection()?;
    let mut mender = Mender {
        lake,
        seen,
        wrong: BTreeSet::new(),
        watched: BTreeSet::new(),
    };
    mender.twice()?;
    mender.history()?;
    mender.every()?;
    views::write(lake)?;
    mender.look_again()
}

struct Mender<'a> {
    lake: &'a Lake,
    seen: Seen,
    /// Wrong files that cannot be restored.
    wrong: BTreeSet<PathBuf>,
    /// Blobs whose stamps are recorded.
    watched: BTreeSet<PathBuf>,
}

impl Mender<'_> {
    /// Whether a file's stamp is unchanged since its bytes were last verified.
    fn is_known(&self, path: &Path) -> bool {
        self.seen.is_right(&self.lake.folder, path)
    }

    /// Whether a file holds these bytes; it is read only if its stamp has changed.
    fn holds(&self, path: &Path, digest: &Digest) -> bool {
        self.is_known(path) || digest_file(path).is_ok_and(|there| there == *digest)
    }

    /// Files with backup copies.
    fn twice(&mut self) -> Result<(), LakeError> {
        let lake = self.lake;
        let folder = &lake.folder;
        let again = folder.again();
        if (again.exists() || folder.copy_of(&again).exists())
            && !twice::mend(folder, &again, |path, bytes| {
                again::parse(path, bytes).is_ok()
            })?
        {
            self.wrong.insert(again);
        }
        self.twice_in(&folder.runs(), |path, bytes| {
            lake.register.parse(path, bytes).is_ok()
        })?;
        self.twice_in(&folder.manifests(), |path, bytes| {
            register::check_manifest(path, bytes).is_ok()
        })?;
        self.twice_in(&folder.recipes(), |path, bytes| {
            records::parse_recipe(path, bytes).is_ok()
        })?;
        self.twice_in(&folder.tags(), |path, bytes| {
            tags::parse(path, bytes).is_ok()
        })
    }

    fn twice_in(
        &mut self,
        folder: &Path,
        is_right: impl Fn(&Path, &[u8]) -> bool,
    ) -> Result<(), LakeError> {
        let lake = &self.lake.folder;
        for name in twice::names(lake, folder)? {
            let path = folder.join(name);
            let copy = lake.copy_of(&path);
            if self.is_known(&path) && self.is_known(&copy) {
                continue;
            }
            if !twice::mend(lake, &path, &is_right)? {
                self.wrong.extend([path, copy]);
            }
        }
        Ok(())
    }

    /// Tables of runs: stored as a blob and as a copy, and rebuilt if both are lost.
    fn history(&mut self) -> Result<(), LakeError> {
        let folder = &self.lake.folder;
        let there = folder.run_tables()?;
        let mut shown = BTreeSet::new();
        let mut running = BTreeSet::new();
        for number in self.lake.register.numbers()? {
            // A damaged record of one run does not hide the tables of others.
            let Ok(run) = self.lake.run_without_units(number) else {
                running.insert(number);
                continue;
            };
            if run.record.status == RunStatus::Running {
                running.insert(number);
            }
            let mut is_lost = false;
            for (name, file) in &run.history {
                let path = folder.run_table(name, number);
                is_lost |= !self.of_run(&path, file)?;
                self.watched.insert(self.lake.file(file));
                shown.insert(path);
            }
            if is_lost {
                let run = history::make_again(self.lake, run)?;
                let blobs = run.history.values().map(|file| self.lake.file(file));
                self.watched.extend(blobs);
            }
        }
        for path in there {
            if !shown.contains(&path) && !run_of(&path).is_some_and(|run| running.contains(&run)) {
                self.remove(&path)?;
            }
        }
        Ok(())
    }

    /// Restores the table of a run from its blob, or the blob from the table. Returns whether one
    /// of them was intact.
    fn of_run(&mut self, path: &Path, file: &FileRef) -> Result<bool, LakeError> {
        let blob = self.lake.file(file);
        match (
            self.holds(path, &file.digest),
            self.holds(&blob, &file.digest),
        ) {
            (true, true) => {}
            (true, false) => published::show_copy(self.lake, path, &blob)?,
            (false, true) => published::show_copy(self.lake, &blob, path)?,
            (false, false) => return Ok(false),
        }
        Ok(true)
    }

    /// Tables of all units that runs refer to.
    fn every(&mut self) -> Result<(), LakeError> {
        let there = files_below(&self.lake.folder.every())?;
        let promised = self.lake.every_promised()?;
        for (path, unit) in &promised {
            if !self.is_known(path) {
                self.of_unit(path, unit)?;
            }
        }
        for path in there {
            if !promised.contains_key(&path) && !self.may_be_shown(&path)? {
                self.remove(&path)?;
            }
        }
        Ok(())
    }

    /// Publishes the table of a unit at its path, if the unit was not collected.
    fn of_unit(&mut self, path: &Path, unit: &Digest) -> Result<(), LakeError> {
        let Some(stored) = self.lake.records.read(unit)? else {
            return Ok(());
        };
        let made = stored.outcome.files();
        let Some(file) = made.and_then(|files| files.get(table::FILE)) else {
            return Ok(());
        };
        if self.lake.blobs.is_unchanged(file)? {
            return published::show(self.lake, &file.digest, path);
        }
        if digest_file(path).is_ok_and(|there| there == file.digest) {
            return self.lake.blobs.put_back(path, file);
        }
        self.wrong.insert(path.to_owned());
        Ok(())
    }

    /// Whether a table below `every/` belongs to a unit, though no finished run refers to it.
    fn may_be_shown(&self, path: &Path) -> Result<bool, LakeError> {
        let Some((partition, fingerprint)) = unit_of(path) else {
            return Ok(false);
        };
        let stored = self.lake.records.read(&fingerprint)?;
        Ok(stored.is_some_and(|stored| stored.partition == partition))
    }

    fn remove(&self, path: &Path) -> Result<(), LakeError> {
        atomic::remove_if_there(path)?;
        let tables = [self.lake.folder.tables(), self.lake.folder.every()];
        let folders = path.ancestors().skip(1);
        for folder in folders.take_while(|folder| !tables.iter().any(|table| table == folder)) {
            // Fails, as intended, if the folder is not empty.
            if fs::remove_dir(folder).is_err() {
                break;
            }
        }
        Ok(())
    }

    /// Records the current stamps of all files.
    fn look_again(self) -> Result<(), LakeError> {
        let folder = &self.lake.folder;
        let seen = Seen::look(folder, &self.watched, &self.wrong)?;
        if seen == self.seen {
            return Ok(());
        }
        seen.write(folder)
    }
}
