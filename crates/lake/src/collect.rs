//! Collecting garbage: unreferenced artifacts, those of no run that counts.
//!
//! Kept are the units of tagged runs, of the newest runs of every pipeline, everything that a
//! pipeline's newest state shows, what the caller names, and everything that was made or taken into
//! use since the oldest living process began. Records of runs and their tables always stay. So does
//! what an interrupted unit goes on from, until nobody has come back to it for a while.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs, io,
    os::unix::fs::MetadataExt,
    path::Path,
    time::{Duration, SystemTime, UNIX_EPOCH},
};

use dataflow::{Digest, RecordOutcome, RunStatus};
use serde::Serialize;

use crate::{
    LakeError,
    atomic::{self, io_error},
    clock::now,
    folder::{Lake, names_in},
    lock, mend,
    newest::{self, Newest},
    published::EVERY,
    records::Stored,
    runs,
    store::COLLECTING,
    twice,
    verify::files_below,
};

/// How long what an interrupted unit goes on from waits for it.
const RESUMED_WITHIN: Duration = Duration::from_hours(7 * 24);

/// What is collected, and whether it is done or only said.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Collecting {
    /// It is removed.
    Remove,
    /// It is only counted.
    Count,
}

/// What went, or would go.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Collected {
    /// Units by `stage.artifact`, with the bytes that only they refer to.
    pub units: BTreeMap<String, CollectedUnits>,
    /// Blobs to which nothing refers.
    pub n_blobs: usize,
    /// Their bytes.
    pub n_bytes: u64,
    /// Folders and files that dead processes left behind.
    pub n_leftovers: usize,
    /// Units that stay.
    pub n_kept: usize,
}

/// Units of one output that went, or would go.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct CollectedUnits {
    /// How many.
    pub n_units: usize,
    /// Bytes of their files, some of which other units may share.
    pub n_bytes: u64,
}

impl Lake {
    /// Removes what nothing refers to, or counts it. `reached` are fingerprints that count beside
    /// what the lake itself knows; of each pipeline, the newest `n_runs` finished runs count.
    ///
    /// # Errors
    ///
    /// Fails if there is no lake, if a record or list of units that counts is damaged, or if something
    /// cannot be removed.
    pub fn collect(
        &self,
        reached: &[Digest],
        n_runs: usize,
        collecting: Collecting,
    ) -> Result<Collected, LakeError> {
        self.expect_there()?;
        self.prepare()?;
        // Nobody takes what goes for what was lost.
        let _turn = mend::turn(self)?;
        // Nobody keeps a unit or takes an old one into use while this goes on.
        let _alone = lock::exclude(&self.locks(), COLLECTING)?;
        let since = self.oldest_process()?;
        let mut kept: BTreeSet<Digest> = reached.iter().copied().collect();
        self.keep_of_runs(n_runs, since, &mut kept)?;
        self.keep_of_newest(&mut kept)?;
        kept.extend(self.newest_shown_units()?);
        let mut collected = Collected::default();
        let mut blobs = BTreeSet::new();
        let mut recipes = BTreeSet::new();
        let (mut gone, mut records) = (BTreeSet::new(), Vec::new());
        for path in files_below(&self.records().folder())? {
            let stored = crate::sealed::read_if_whole::<Stored>(&path)?;
            let is_kept = stored
                .as_ref()
                .is_some_and(|stored| kept.contains(&stored.fingerprint))
                || is_newer(&path, since);
            let files = stored.as_ref().map(|stored| files_of(&stored.outcome));
            let files = files.into_iter().flatten();
            if is_kept {
                collected.n_kept += 1;
                blobs.extend(files.map(|(digest, _)| digest));
                recipes.extend(stored.map(|stored| stored.recipe));
                continue;
            }
            if let Some(stored) = &stored {
                let of_output = collected.units.entry(self.name_of(stored)?).or_default();
                of_output.n_units += 1;
                of_output.n_bytes += files.map(|(_, size)| size).sum::<u64>();
                gone.insert(stored.fingerprint);
            }
            records.push(path);
        }
        for number in runs::numbers(self.root())? {
            if let Ok(run) = runs::read(self.root(), number) {
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
        self.collect_resumable(collecting, &mut collected)?;
        self.collect_leftovers(collecting, &mut collected)?;
        if collecting == Collecting::Remove && !gone.is_empty() {
            self.forget(&gone)?;
        }
        Ok(collected)
    }

    /// When the oldest living process that writes to the lake began, or now.
    fn oldest_process(&self) -> Result<SystemTime, LakeError> {
        let mut since = now();
        let mine = atomic::process_name();
        for name in names_in(&self.locks())? {
            let Some(process) = name.strip_prefix(&Self::alive_name("")) else {
                continue;
            };
            let began = process.split_once('-').and_then(|(_, ns)| ns.parse().ok());
            if let Some(began) = began
                && process != mine
                && lock::is_held(&self.locks(), &name)
            {
                since = since.min(UNIX_EPOCH + Duration::from_nanos(began));
            }
        }
        Ok(since)
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
        for number in runs::numbers(self.root())?.into_iter().rev() {
            let is_tagged = tagged.contains(&number);
            let run = match runs::read(self.root(), number) {
                Ok(run) => run,
                // A damaged record says nothing about what to keep, unless somebody asked for it.
                Err(err) if is_tagged => return Err(err),
                Err(_) => continue,
            };
            let is_recent = is_newer(&runs::path(self.root(), number), since);
            let left = n_left.entry(run.record.pipeline.clone()).or_insert(n_runs);
            let counts = *left > 0 && run.record.status == RunStatus::Finished;
            if !(is_tagged || is_recent || counts) {
                continue;
            }
            if counts && !is_recent {
                *left -= 1;
            }
            let units = runs::units(self.root(), &run)?;
            kept.extend(units.into_iter().map(|unit| unit.fingerprint));
        }
        Ok(())
    }

    /// Keeps what the newest states of all pipelines show.
    fn keep_of_newest(&self, kept: &mut BTreeSet<Digest>) -> Result<(), LakeError> {
        for name in names_in(&self.root().join(newest::FOLDER))? {
            let pipeline = newest::pipeline_of(&name);
            let newest = Newest::read(&newest::path(self.root(), pipeline))?;
            let units = newest.list().into_iter();
            kept.extend(
                units
                    .filter(|unit| unit.current)
                    .map(|unit| unit.fingerprint),
            );
        }
        Ok(())
    }

    /// `stage.artifact` of a record.
    fn name_of(&self, stored: &Stored) -> Result<String, LakeError> {
        let output = self.records().output(stored)?;
        Ok(format!("{}.{}", stored.stage, output.unwrap_or_default()))
    }

    /// Removes the tables of units that are gone.
    fn collect_tables(
        &self,
        gone: &BTreeSet<Digest>,
        collecting: Collecting,
    ) -> Result<(), LakeError> {
        for path in files_below(&self.root().join(EVERY))? {
            let folder = path.parent().and_then(Path::file_name).unwrap_or_default();
            let folder = folder.to_string_lossy();
            let digits = folder.strip_prefix("fingerprint=").unwrap_or_default();
            if digits.parse().is_ok_and(|unit| gone.contains(&unit)) {
                remove(&path, collecting)?;
            }
        }
        Ok(())
    }

    fn collect_recipes(
        &self,
        kept: &BTreeSet<Digest>,
        since: SystemTime,
        collecting: Collecting,
    ) -> Result<(), LakeError> {
        let folder = self.records().recipes();
        for name in twice::names(self.root(), &folder)? {
            let path = folder.join(name);
            let name = path.file_stem().unwrap_or_default().to_string_lossy();
            let is_kept = name.parse().is_ok_and(|digest| kept.contains(&digest));
            if !is_kept && !is_newer(&path, since) {
                remove(&path, collecting)?;
                remove(&twice::copy_of(self.root(), &path), collecting)?;
            }
        }
        Ok(())
    }

    fn collect_blobs(
        &self,
        kept: &BTreeSet<Digest>,
        since: SystemTime,
        collecting: Collecting,
        collected: &mut Collected,
    ) -> Result<(), LakeError> {
        for path in files_below(self.blobs().root())? {
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

    /// Removes what dead processes left in staging, and their locks.
    fn collect_leftovers(
        &self,
        collecting: Collecting,
        collected: &mut Collected,
    ) -> Result<(), LakeError> {
        let locks = self.locks();
        collected.n_leftovers += self.collect_staging(collecting)?;
        for name in names_in(&locks)? {
            if name == COLLECTING || lock::is_held(&locks, &name) {
                continue;
            }
            collected.n_leftovers += 1;
            if collecting == Collecting::Remove {
                // A lock is removed by letting go of it.
                drop(lock::try_take(&locks, &name, "nothing")?);
            }
        }
        Ok(())
    }

    /// Removes what dead processes left in staging; returns how much.
    pub(crate) fn collect_staging(&self, collecting: Collecting) -> Result<usize, LakeError> {
        let locks = self.locks();
        let mut n_leftovers = 0;
        for name in names_in(&self.staging())? {
            let path = self.staging().join(&name);
            let process = name.trim_start_matches("history-");
            let mut words = process.split('-');
            let process = [words.next(), words.next()].map(Option::unwrap_or_default);
            let process = Self::alive_name(process.join("-").trim_end_matches(".new"));
            if lock::is_held(&locks, &name) || lock::is_held(&locks, &process) {
                continue;
            }
            if collecting == Collecting::Remove {
                // Nobody begins to make the unit meanwhile.
                let Some(_lock) = lock::try_take(&locks, &name, "nothing")? else {
                    continue;
                };
                let removed = if path.is_dir() {
                    fs::remove_dir_all(&path)
                } else {
                    fs::remove_file(&path)
                };
                match removed {
                    Err(err) if err.kind() != io::ErrorKind::NotFound => {
                        return Err(io_error("remove", &path)(err));
                    }
                    _ => {}
                }
            }
            n_leftovers += 1;
        }
        Ok(n_leftovers)
    }

    /// Removes what interrupted units would go on from that are kept by now, or that nobody has come
    /// back to for long.
    fn collect_resumable(
        &self,
        collecting: Collecting,
        collected: &mut Collected,
    ) -> Result<(), LakeError> {
        let locks = self.locks();
        let long_ago = now().checked_sub(RESUMED_WITHIN).unwrap_or(UNIX_EPOCH);
        for name in names_in(&self.resume())? {
            let folder = self.resume().join(&name);
            let record = name.parse().map(|unit| self.records().path(&unit));
            let is_kept = record.is_ok_and(|record| record.exists());
            let mut files = files_below(&folder)?;
            files.push(folder.clone());
            let is_recent = files.iter().any(|path| is_newer(path, long_ago));
            if lock::is_held(&locks, &name) || (is_recent && !is_kept) {
                continue;
            }
            if collecting == Collecting::Remove {
                // Nobody begins to make the unit meanwhile.
                let Some(_lock) = lock::try_take(&locks, &name, "nothing")? else {
                    continue;
                };
                fs::remove_dir_all(&folder).map_err(io_error("remove", &folder))?;
            }
            collected.n_leftovers += 1;
        }
        Ok(())
    }

    /// Forgets collected units in the newest states of all pipelines.
    fn forget(&self, gone: &BTreeSet<Digest>) -> Result<(), LakeError> {
        for name in names_in(&self.root().join(newest::FOLDER))? {
            let pipeline = newest::pipeline_of(&name);
            let _turn = crate::published::wait_for_turn(self, pipeline)?;
            let path = newest::path(self.root(), pipeline);
            let mut newest = Newest::read(&path)?;
            let stamps: BTreeMap<_, _> = std::mem::take(&mut newest.stamps).into_iter().collect();
            let records: BTreeMap<_, _> = std::mem::take(&mut newest.records).into_iter().collect();
            newest.forget(|unit| gone.contains(unit));
            newest.write(
                &self.staging(),
                &path,
                |unit| records.get(unit).copied(),
                |blob| stamps.get(blob).copied(),
            )?;
        }
        Ok(())
    }
}

/// Whether a file was written or taken into use since a time.
fn is_newer(path: &Path, since: SystemTime) -> bool {
    let modified = fs::metadata(path).and_then(|metadata| metadata.modified());
    modified.is_ok_and(|modified| modified >= since)
}

/// The blobs of a result, with their sizes.
fn files_of(outcome: &RecordOutcome) -> Vec<(Digest, u64)> {
    match outcome {
        RecordOutcome::Made { files, .. } => files
            .values()
            .map(|file| (file.digest, file.size))
            .collect(),
        RecordOutcome::Skipped { .. } | RecordOutcome::Filtered { .. } => Vec::new(),
    }
}

/// Removes a file, and the folders above it that are left empty.
fn remove(path: &Path, collecting: Collecting) -> Result<(), LakeError> {
    const FOLDERS: usize = 2;
    if collecting == Collecting::Count {
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
