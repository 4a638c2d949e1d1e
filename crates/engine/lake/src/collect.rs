//! Garbage collection of unreferenced artifacts.
//!
//! Kept are the units of tagged runs, of the newest runs of every pipeline and of its newest state,
//! those named by the caller, those still to be sent to the depot, and all made or used since the oldest living process
//! began. Records of runs and their tables always stay. So does the resume state of interrupted units, until it
//! expires.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    os::unix::fs::MetadataExt,
    path::Path,
    time::{Duration, SystemTime, UNIX_EPOCH},
};

use dataflow::{ArtifactName, Digest, RunStatus};
use serde::Serialize;

use crate::{
    LakeError, atomic,
    clock::now,
    folder::{digest_named, files_below, names_in, unit_of},
    lake::Lake,
    records::Stored,
    replicas, sealed,
};

/// Expiry of the resume state of an interrupted unit.
const RESUMED_WITHIN: Duration = Duration::from_hours(7 * 24);

/// Whether garbage is removed or only counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GcMode {
    /// It is removed.
    Remove,
    /// It is only counted.
    Count,
}

/// The garbage that was removed, or would be.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct GcReport {
    /// Units by `stage.artifact`, with the bytes that only they refer to.
    pub units: BTreeMap<String, GcUnits>,
    /// Number of unreferenced blobs.
    pub n_blobs: usize,
    /// Their bytes.
    pub n_bytes: u64,
    /// Stale folders and files of dead processes.
    pub n_leftovers: usize,
    /// Number of kept units.
    pub n_kept: usize,
}

/// Units of one output that were removed, or would be.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct GcUnits {
    /// Number of units.
    pub n_units: usize,
    /// Bytes of their files, some of which other units may share.
    pub n_bytes: u64,
}

impl Lake {
    /// Removes or counts unreferenced artifacts. `reached` are fingerprints to keep beside those
    /// that the lake refers to; of each pipeline, the newest `n_runs` finished runs are kept.
    ///
    /// # Errors
    ///
    /// Fails if there is no lake, if a record or list of kept units is damaged, or if a file cannot
    /// be removed.
    pub fn collect(
        &self,
        reached: &[Digest],
        n_runs: usize,
        collecting: GcMode,
    ) -> Result<GcReport, LakeError> {
        self.check_exists()?;
        self.prepare()?;
        // Holding the lock, so that no process restores the removed files as lost.
        let _turn = self.locks.lock_repair()?;
        // No process stores a unit or takes an old one into use meanwhile.
        let _alone = self.locks.lock_collection()?;
        let since = self.oldest_process()?;
        let mut kept: BTreeSet<Digest> = reached.iter().copied().collect();
        self.keep_of_runs(n_runs, since, &mut kept)?;
        kept.extend(self.cache.all_current()?);
        kept.extend(self.newest_published_units()?);
        kept.extend(self.waiting_units()?);
        let mut collected = GcReport::default();
        let mut blobs = BTreeSet::new();
        let mut recipes = BTreeSet::new();
        let (mut gone, mut records) = (BTreeSet::new(), Vec::new());
        for path in files_below(&self.folder.units())? {
            let stored = sealed::read_if_whole::<Stored>(&path)?;
            let is_kept = stored
                .as_ref()
                .is_some_and(|stored| kept.contains(&stored.fingerprint))
                || is_newer(&path, since);
            let files = stored.as_ref().and_then(|stored| stored.outcome.files());
            let files = files.into_iter().flat_map(BTreeMap::values);
            if is_kept {
                collected.n_kept += 1;
                blobs.extend(files.map(|file| file.digest));
                recipes.extend(stored.as_ref().map(|stored| stored.recipe));
                continue;
            }
            if let Some(stored) = &stored {
                let of_output = collected.units.entry(self.name_of(stored)?).or_default();
                of_output.n_units += 1;
                of_output.n_bytes += files.map(|file| file.size).sum::<u64>();
                gone.insert(stored.fingerprint);
            }
            records.push(path);
        }
        for number in self.register.numbers()? {
            if let Ok(run) = self.register.read(number) {
                blobs.extend(run.history.values().map(|file| file.digest));
            }
        }
        // A table without a record would look as if its record had been lost.
        self.collect_tables(&gone, collecting)?;
        for path in &records {
            remove(path, collecting)?;
        }
        self.collect_recipes(&recipes, since, collecting)?;
        self.collect_blobs(&blobs, since, collecting, &mut collected)?;
        self.collect_unfetched(&blobs, since, collecting)?;
        self.collect_resumable(collecting, &mut collected)?;
        self.collect_logs(collecting, &mut collected)?;
        self.collect_leftovers(collecting, &mut collected)?;
        if collecting == GcMode::Remove && !gone.is_empty() {
            self.cache.forget(&gone, &self.locks)?;
        }
        Ok(collected)
    }

    /// Whether a living process may have made a unit and not published its table yet. One that has ended has
    /// published it, unless it was killed.
    pub(crate) fn may_be_published(&self, unit: &Digest) -> Result<bool, LakeError> {
        Ok(is_newer(&self.records.path(unit), self.oldest_process()?))
    }

    /// When the oldest living process that writes to the lake began, or now.
    fn oldest_process(&self) -> Result<SystemTime, LakeError> {
        let others = self.locks.other_processes()?;
        let began = others.iter().filter_map(|process| atomic::started(process));
        Ok(began.fold(now(), SystemTime::min))
    }

    /// Keeps the units of tagged runs, of runs that ended since a time, and of the newest before it.
    fn keep_of_runs(
        &self,
        n_runs: usize,
        since: SystemTime,
        kept: &mut BTreeSet<Digest>,
    ) -> Result<(), LakeError> {
        let tagged: BTreeSet<u64> = self.tags()?.into_values().collect();
        let mut n_left: BTreeMap<String, usize> = BTreeMap::new();
        for number in self.register.numbers()?.into_iter().rev() {
            let is_tagged = tagged.contains(&number);
            let run = match self.register.read(number) {
                Ok(run) => run,
                // A damaged record cannot say what to keep; it is an error only if the run is
                // tagged.
                Err(err) if is_tagged => return Err(err),
                Err(_) => continue,
            };
            let is_recent = is_newer(&self.register.path(number), since);
            let left = n_left.entry(run.record.pipeline.clone()).or_insert(n_runs);
            let counts = *left > 0 && run.record.status == RunStatus::Finished;
            if !(is_tagged || is_recent || counts) {
                continue;
            }
            if counts && !is_recent {
                *left -= 1;
            }
            let units = self.register.units(&run)?;
            kept.extend(units.into_iter().map(|unit| unit.fingerprint));
        }
        Ok(())
    }

    /// `stage.artifact` of a record.
    fn name_of(&self, stored: &Stored) -> Result<String, LakeError> {
        let output = self.records.output(stored)?;
        let output = output.as_ref().map_or("", ArtifactName::as_str);
        Ok(format!("{}.{output}", stored.stage))
    }

    /// Removes the tables of removed units.
    fn collect_tables(&self, gone: &BTreeSet<Digest>, collecting: GcMode) -> Result<(), LakeError> {
        for path in files_below(&self.folder.versions())? {
            if unit_of(&path).is_some_and(|(_, unit)| gone.contains(&unit)) {
                remove(&path, collecting)?;
            }
        }
        Ok(())
    }

    fn collect_recipes(
        &self,
        kept: &BTreeSet<Digest>,
        since: SystemTime,
        collecting: GcMode,
    ) -> Result<(), LakeError> {
        let folder = self.folder.recipes();
        for name in replicas::names(&self.folder, &folder)? {
            let path = folder.join(name);
            let is_kept = digest_named(&path).is_some_and(|digest| kept.contains(&digest));
            if !is_kept && !is_newer(&path, since) {
                remove(&path, collecting)?;
                remove(&self.folder.copy_of(&path), collecting)?;
            }
        }
        Ok(())
    }

    fn collect_blobs(
        &self,
        kept: &BTreeSet<Digest>,
        since: SystemTime,
        collecting: GcMode,
        collected: &mut GcReport,
    ) -> Result<(), LakeError> {
        for path in files_below(&self.folder.blobs())? {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let is_kept = name.parse().is_ok_and(|digest| kept.contains(&digest));
            if is_kept || is_newer(&path, since) {
                continue;
            }
            collected.n_blobs += 1;
            collected.n_bytes += fs::metadata(&path).map_or(0, |metadata| metadata.size());
            remove(&path, collecting)?;
        }
        Ok(())
    }

    /// Removes the marks of blobs that no unit has any more.
    fn collect_unfetched(
        &self,
        kept: &BTreeSet<Digest>,
        since: SystemTime,
        collecting: GcMode,
    ) -> Result<(), LakeError> {
        for name in names_in(&self.folder.unfetched())? {
            let path = self.folder.unfetched().join(&name);
            let is_kept = name.parse().is_ok_and(|blob| kept.contains(&blob));
            // A mark is there before the record of its unit.
            if !is_kept && !is_newer(&path, since) {
                remove(&path, collecting)?;
            }
        }
        Ok(())
    }

    /// Units that are still to be sent to the depot.
    fn waiting_units(&self) -> Result<Vec<Digest>, LakeError> {
        let names = names_in(&self.folder.outbox())?;
        Ok(names.iter().filter_map(|name| name.parse().ok()).collect())
    }

    /// Removes stale staging folders and locks of dead processes.
    fn collect_leftovers(
        &self,
        collecting: GcMode,
        collected: &mut GcReport,
    ) -> Result<(), LakeError> {
        collected.n_leftovers += self.collect_staging(collecting)?;
        for name in self.locks.stale_locks()? {
            collected.n_leftovers += 1;
            if collecting == GcMode::Remove {
                // Releasing a lock removes it.
                drop(self.locks.try_take(&name, "nothing")?);
            }
        }
        Ok(())
    }

    /// Removes stale staging folders of dead processes; returns how many.
    pub(crate) fn collect_staging(&self, collecting: GcMode) -> Result<usize, LakeError> {
        let mut n_leftovers = 0;
        let staging = self.folder.staging();
        for name in names_in(&staging)? {
            let path = staging.join(&name);
            let process = atomic::process_of(&name);
            if self.locks.is_held(&name) || self.locks.is_alive(process) {
                continue;
            }
            if collecting == GcMode::Remove {
                // No other process removes it meanwhile.
                let Some(_lock) = self.locks.try_take(&name, "nothing")? else {
                    continue;
                };
                if path.is_dir() && !path.is_symlink() {
                    atomic::remove_folder_if_there(&path)?;
                } else {
                    atomic::remove_if_there(&path)?;
                }
            }
            n_leftovers += 1;
        }
        Ok(n_leftovers)
    }

    /// Removes the logs of units without a record that nobody has tried to make lately.
    fn collect_logs(&self, collecting: GcMode, collected: &mut GcReport) -> Result<(), LakeError> {
        let long_ago = now().checked_sub(RESUMED_WITHIN).unwrap_or(UNIX_EPOCH);
        for path in files_below(&self.folder.logs())? {
            let record = digest_named(&path).map(|unit| self.records.path(&unit));
            let is_kept = record.is_some_and(|record| record.exists());
            if is_kept || is_newer(&path, long_ago) {
                continue;
            }
            collected.n_leftovers += 1;
            remove(&path, collecting)?;
        }
        Ok(())
    }

    /// Removes the resume state of units that are stored by now, and expired resume state.
    fn collect_resumable(
        &self,
        collecting: GcMode,
        collected: &mut GcReport,
    ) -> Result<(), LakeError> {
        let long_ago = now().checked_sub(RESUMED_WITHIN).unwrap_or(UNIX_EPOCH);
        for name in names_in(&self.folder.resume())? {
            let folder = self.folder.resume().join(&name);
            let record = name.parse().map(|unit| self.records.path(&unit));
            let is_kept = record.is_ok_and(|record| record.exists());
            let mut files = files_below(&folder)?;
            files.push(folder.clone());
            let is_recent = files.iter().any(|path| is_newer(path, long_ago));
            if self.locks.is_held(&name) || (is_recent && !is_kept) {
                continue;
            }
            if collecting == GcMode::Remove {
                // No process starts to make the unit meanwhile.
                let Some(_lock) = self.locks.try_take(&name, "nothing")? else {
                    continue;
                };
                atomic::remove_folder_if_there(&folder)?;
            }
            collected.n_leftovers += 1;
        }
        Ok(())
    }
}

/// Whether a file was written or taken into use since a time.
fn is_newer(path: &Path, since: SystemTime) -> bool {
    let modified = fs::metadata(path).and_then(|metadata| metadata.modified());
    modified.is_ok_and(|modified| modified >= since)
}

/// Removes a file, and the folders above it that are left empty.
fn remove(path: &Path, collecting: GcMode) -> Result<(), LakeError> {
    const FOLDERS: usize = 2;
    if collecting == GcMode::Count {
        return Ok(());
    }
    atomic::remove_if_there(path)?;
    for folder in path.ancestors().skip(1).take(FOLDERS) {
        if fs::remove_dir(folder).is_err() {
            break;
        }
    }
    Ok(())
}
