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
    LakeError, atomic,
    digests::digest_file,
    folder::{files_below, run_of, unit_of},
    history,
    lake::Lake,
    published, replicas, replicated_files,
    snapshot::Snapshot,
    table, views,
};

/// Restores lost, damaged or exchanged files, and removes foreign ones.
pub(crate) fn repair(lake: &Lake) -> Result<(), LakeError> {
    let folder = &lake.folder;
    let before = Snapshot::read(folder)?;
    if before.is_unchanged(folder) {
        return Ok(());
    }
    let now = before.retake(folder)?;
    if now.has_files_of(&before) {
        if now.is_settled() && lake.prepare().is_ok() {
            // If this fails, as in a read-only lake, they are listed each time.
            let _kept = now.write(folder);
        }
        return Ok(());
    }
    lake.prepare()?;
    let _turn = lake.locks.lock_repair()?;
    // Files about to be published are not collected meanwhile.
    let _shared = lake.locks.block_collection()?;
    let mut repair = Repair {
        lake,
        before,
        unrepaired: BTreeSet::new(),
        blobs: BTreeSet::new(),
    };
    repair.repair_replicated()?;
    repair.repair_run_tables()?;
    repair.repair_version_tables()?;
    views::write(lake)?;
    let now = Snapshot::take(folder, &repair.blobs, &repair.unrepaired)?;
    if now == repair.before {
        return Ok(());
    }
    now.write(folder)
}

struct Repair<'a> {
    lake: &'a Lake,
    /// The last full check.
    before: Snapshot,
    /// Damaged files that cannot be restored.
    unrepaired: BTreeSet<PathBuf>,
    /// The blobs of runs' tables.
    blobs: BTreeSet<PathBuf>,
}

impl Repair<'_> {
    /// Whether a file's stamp is unchanged since its bytes were last verified.
    fn is_known(&self, path: &Path) -> bool {
        self.before.is_verified(&self.lake.folder, path)
    }

    /// Whether a file holds these bytes; it is read only if its stamp has changed.
    fn holds(&self, path: &Path, digest: &Digest) -> bool {
        self.is_known(path) || digest_file(path).is_ok_and(|there| there == *digest)
    }

    /// Repairs the files with replicas.
    fn repair_replicated(&mut self) -> Result<(), LakeError> {
        let lake = self.lake;
        for (path, check) in replicated_files::all(lake)? {
            let copy = lake.folder.copy_of(&path);
            if self.is_known(&path) && self.is_known(&copy) {
                continue;
            }
            let is_intact = |path: &Path, bytes: &[u8]| check(lake, path, bytes).is_ok();
            if !replicas::repair(&lake.folder, &path, is_intact)? {
                self.unrepaired.extend([path, copy]);
            }
        }
        Ok(())
    }

    /// Repairs the tables of runs: stored as a blob and as a copy, and rebuilt if both are lost.
    fn repair_run_tables(&mut self) -> Result<(), LakeError> {
        let folder = &self.lake.folder;
        let there = folder.run_tables()?;
        let mut published = BTreeSet::new();
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
                is_lost |= !self.restore_run_table(&path, file)?;
                self.blobs.insert(self.lake.file(file));
                published.insert(path);
            }
            if is_lost {
                let run = history::rebuild(self.lake, run)?;
                let blobs = run.history.values().map(|file| self.lake.file(file));
                self.blobs.extend(blobs);
            }
        }
        for path in there {
            if !published.contains(&path)
                && !run_of(&path).is_some_and(|run| running.contains(&run))
            {
                self.remove(&path)?;
            }
        }
        Ok(())
    }

    /// Restores the table of a run from its blob, or the blob from the table. Returns whether one
    /// of them was intact.
    fn restore_run_table(&mut self, path: &Path, file: &FileRef) -> Result<bool, LakeError> {
        let blob = self.lake.file(file);
        match (
            self.holds(path, &file.digest),
            self.holds(&blob, &file.digest),
        ) {
            (true, true) => {}
            (true, false) => published::copy_file(self.lake, path, &blob)?,
            (false, true) => published::copy_file(self.lake, &blob, path)?,
            (false, false) => return Ok(false),
        }
        Ok(true)
    }

    /// Repairs the tables of all units that runs refer to.
    fn repair_version_tables(&mut self) -> Result<(), LakeError> {
        let there = files_below(&self.lake.folder.versions())?;
        let expected = self.lake.promised_versions()?;
        for (path, unit) in &expected {
            if !self.is_known(path) {
                self.restore_unit_table(path, unit)?;
            }
        }
        for path in there {
            if !expected.contains_key(&path) && !self.may_be_published(&path)? {
                self.remove(&path)?;
            }
        }
        Ok(())
    }

    /// Publishes the table of a unit at its path, if the unit was not collected.
    fn restore_unit_table(&mut self, path: &Path, unit: &Digest) -> Result<(), LakeError> {
        let Some(stored) = self.lake.records.read(unit)? else {
            return Ok(());
        };
        let Some(file) = stored.outcome.file(table::FILE) else {
            return Ok(());
        };
        if self.lake.blobs.is_unchanged(file)? {
            return published::link_file(self.lake, &file.digest, path);
        }
        if digest_file(path).is_ok_and(|there| there == file.digest) {
            return self.lake.blobs.put_back(path, file);
        }
        self.unrepaired.insert(path.to_owned());
        Ok(())
    }

    /// Whether a table below `every/` belongs to a unit, though no finished run refers to it.
    fn may_be_published(&self, path: &Path) -> Result<bool, LakeError> {
        let Some((partition, fingerprint)) = unit_of(path) else {
            return Ok(false);
        };
        let stored = self.lake.records.read(&fingerprint)?;
        Ok(stored.is_some_and(|stored| stored.partition == partition))
    }

    fn remove(&self, path: &Path) -> Result<(), LakeError> {
        atomic::remove_if_there(path)?;
        let tables = [self.lake.folder.tables(), self.lake.folder.versions()];
        let folders = path.ancestors().skip(1);
        for folder in folders.take_while(|folder| !tables.iter().any(|table| table == folder)) {
            // Fails, as intended, if the folder is not empty.
            if fs::remove_dir(folder).is_err() {
                break;
            }
        }
        Ok(())
    }
}
