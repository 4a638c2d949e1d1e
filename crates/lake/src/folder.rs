//! The lake's folder: what lies where, and who looks after it.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs, io,
    path::{Path, PathBuf},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use dataflow::{Artifact, Digest, FileRef, Record, RecordOutcome, RunStatus, UnitRef};

use crate::{
    LakeError, again,
    atomic::{self, io_error},
    blobs::Blobs,
    changing::Changing,
    flight::Flight,
    history,
    lock::{self, Lock},
    newest::{self, Newest},
    published,
    records::{Provenance, Records},
    runs::{self, Run},
    sources::Sources,
    stamp::Stamp,
    table, verify, views,
};

/// A folder of artifacts.
pub struct Lake {
    root: PathBuf,
    blobs: Blobs,
    records: Records,
    sources: Sources,
    flight: Flight,
    changing: Changing,
    /// The newest state of the pipelines that were asked about.
    newest: Mutex<BTreeMap<String, Newest>>,
    /// The run that this process makes things for.
    run: Mutex<Option<Run>>,
    /// Held as long as this process writes to the lake, so that others know that it lives.
    alive: Mutex<Option<Lock>>,
}

/// A table that people see, and the pipeline whose run is the newest of those that show it; `None` for
/// one that no run has made.
pub(crate) struct NewestTable {
    pub(crate) table: String,
    pub(crate) pipeline: Option<String>,
}

impl Lake {
    /// Opens a lake; the folder is made when something is first written to it.
    pub fn open(root: &Path) -> Self {
        Self {
            root: root.to_owned(),
            blobs: Blobs::new(root.join("blobs")),
            records: Records::new(root),
            sources: Sources::new(root.join("sources.json")),
            flight: Flight::default(),
            changing: Changing::default(),
            newest: Mutex::default(),
            run: Mutex::default(),
            alive: Mutex::default(),
        }
    }

    /// The folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    pub(crate) fn blobs(&self) -> &Blobs {
        &self.blobs
    }

    pub(crate) fn records(&self) -> &Records {
        &self.records
    }

    pub(crate) fn sources(&self) -> &Sources {
        &self.sources
    }

    pub(crate) fn flight(&self) -> &Flight {
        &self.flight
    }

    pub(crate) fn changing(&self) -> &Changing {
        &self.changing
    }

    pub(crate) fn newest(&self) -> MutexGuard<'_, BTreeMap<String, Newest>> {
        self.newest.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn current_run(&self) -> MutexGuard<'_, Option<Run>> {
        self.run.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn staging(&self) -> PathBuf {
        self.root.join("staging")
    }

    /// Where units leave what they go on from when they are interrupted, by fingerprint.
    pub(crate) fn resume(&self) -> PathBuf {
        self.root.join("resume")
    }

    pub(crate) fn locks(&self) -> PathBuf {
        self.root.join("locks")
    }

    /// The name of the lock that a living process holds.
    pub(crate) fn alive_name(process: &str) -> String {
        format!("process-{process}")
    }

    /// Makes ready to write.
    pub(crate) fn prepare(&self) -> Result<(), LakeError> {
        let mut alive = self.alive.lock().unwrap_or_else(PoisonError::into_inner);
        if alive.is_none() {
            let staging = self.staging();
            fs::create_dir_all(&staging).map_err(io_error("create", &staging))?;
            let name = Self::alive_name(&atomic::process_name());
            *alive = lock::try_take(&self.locks(), &name, "artifacts")?;
        }
        Ok(())
    }

    /// Says that this process writes no more to the lake.
    pub fn leave(&self) {
        let mut alive = self.alive.lock().unwrap_or_else(PoisonError::into_inner);
        alive.take();
    }

    /// Makes sure that there is a lake: a folder with something in it that a lake has.
    ///
    /// # Errors
    ///
    /// Fails with [`LakeError::NoLake`] if there is none.
    pub fn expect_there(&self) -> Result<(), LakeError> {
        let has = |name: &&str| self.root.join(name).is_dir();
        if ["blobs", "units", "runs", "staging"].iter().any(has) {
            return Ok(());
        }
        Err(LakeError::NoLake {
            path: self.root.clone(),
        })
    }

    /// Lists the tables of artifacts by name.
    ///
    /// # Errors
    ///
    /// Fails if the folder cannot be read.
    pub fn tables(&self) -> Result<Vec<String>, LakeError> {
        let mut names = names_in(&self.root.join(published::TABLES))?;
        names.retain(|name| !history::TABLES.contains(&name.as_str()));
        Ok(names)
    }

    /// Names of the tables of runs, units, artifacts and metrics.
    pub fn history_tables() -> [&'static str; 5] {
        history::TABLES
    }

    /// Returns the folder of every partition of a table that any unit ever made.
    pub(crate) fn every_folder(&self, table: &str) -> PathBuf {
        self.root.join(published::EVERY).join(table)
    }

    /// Returns the folder of a table's newest partitions in a pipeline.
    pub(crate) fn table_folder(&self, table: &str, pipeline: &str) -> PathBuf {
        let tables = self.root.join(published::TABLES);
        tables.join(table).join(format!("pipeline={pipeline}"))
    }

    /// Returns the folder of a pipeline's charts, if it shows any.
    pub fn report_folder(&self, pipeline: &str) -> Option<PathBuf> {
        let folder = self.root.join(published::REPORTS).join(pipeline);
        let is_empty = verify::files_below(&folder).is_ok_and(|files| files.is_empty());
        (!is_empty).then_some(folder)
    }

    /// Lists the tables with the pipeline of the newest run that shows them.
    ///
    /// # Errors
    ///
    /// Fails if the lake cannot be read.
    pub(crate) fn newest_tables(&self) -> Result<Vec<NewestTable>, LakeError> {
        let mut shown: Vec<(String, Vec<String>)> = Vec::new();
        for table in self.tables()? {
            let folders = names_in(&self.root.join(published::TABLES).join(&table))?;
            let pipelines = folders
                .iter()
                .filter_map(|name| name.strip_prefix("pipeline=").map(str::to_owned));
            shown.push((table, pipelines.collect()));
        }
        let newest = self.newest_first(shown.iter().flat_map(|(_, pipelines)| pipelines))?;
        let mut found = Vec::new();
        for (table, pipelines) in shown {
            let is_shown = |pipeline: &&String| pipelines.contains(pipeline);
            let pipeline = newest.iter().find(is_shown).cloned();
            found.push(NewestTable { table, pipeline });
        }
        Ok(found)
    }

    /// Returns the newest partitions of a table by key, each with the table's file alone.
    ///
    /// # Errors
    ///
    /// Fails if a record or a file of it is lost or damaged.
    pub fn newest_partitions(&self, name: &str) -> Result<BTreeMap<String, Artifact>, LakeError> {
        let mut found = BTreeMap::new();
        for stage in self.newest_table(name)?.stages {
            for (key, file) in stage.files {
                let artifact = Artifact {
                    key: key.clone(),
                    labels: BTreeMap::new(),
                    files: BTreeMap::from([(table::FILE.to_owned(), file)]),
                };
                found.insert(key, artifact);
            }
        }
        Ok(found)
    }

    /// Orders pipelines by their newest runs, the newest first; ones without a run are left out. Reads
    /// no more records of runs than it needs to.
    fn newest_first<'p>(
        &self,
        pipelines: impl Iterator<Item = &'p String>,
    ) -> Result<Vec<String>, LakeError> {
        let mut left: BTreeSet<&String> = pipelines.collect();
        let mut ordered = Vec::new();
        for number in again::ordered(&self.root)?.into_iter().rev() {
            if left.is_empty() {
                break;
            }
            // A damaged record of a run hides no table of another.
            if let Ok(run) = runs::read(&self.root, number)
                && left.remove(&run.record.pipeline)
            {
                ordered.push(run.record.pipeline);
            }
        }
        Ok(ordered)
    }

    /// Lists the numbers of all runs in order.
    ///
    /// # Errors
    ///
    /// Fails if the folder cannot be read.
    pub fn runs(&self) -> Result<Vec<u64>, LakeError> {
        runs::numbers(&self.root)
    }

    /// Reads a run with its units. A run whose process died is marked as interrupted.
    ///
    /// # Errors
    ///
    /// Fails if there is no such run or its record is damaged.
    pub fn run(&self, number: u64) -> Result<Run, LakeError> {
        let mut run = self.run_without_units(number)?;
        run.record.units = runs::units(&self.root, &run)?;
        Ok(run)
    }

    /// Reads a run without its units. A run whose process died is marked as interrupted.
    ///
    /// # Errors
    ///
    /// Fails if there is no such run or its record is damaged.
    pub fn run_without_units(&self, number: u64) -> Result<Run, LakeError> {
        let mut run = runs::read(&self.root, number)?;
        let alive = Self::alive_name(&run.process);
        if run.record.status == RunStatus::Running && !lock::is_held(&self.locks(), &alive) {
            run.record.status = RunStatus::Interrupted;
        }
        Ok(run)
    }

    /// Returns the newest run of any pipeline that came to its end, or else the newest of all. A run that
    /// was gone through again is newer than those before.
    ///
    /// # Errors
    ///
    /// Fails if its record cannot be read.
    pub fn newest_run(&self) -> Result<Option<Run>, LakeError> {
        let numbers = again::ordered(&self.root)?;
        for &number in numbers.iter().rev() {
            if self.run_without_units(number)?.record.status == RunStatus::Finished {
                return self.run(number).map(Some);
            }
        }
        numbers.last().map(|&number| self.run(number)).transpose()
    }

    /// Returns the record kept under a fingerprint's digest.
    ///
    /// # Errors
    ///
    /// Fails if the record cannot be read.
    pub fn record(&self, fingerprint: &Digest) -> Result<Option<Record>, LakeError> {
        let found = self.record_and_provenance(fingerprint)?;
        Ok(found.map(|(record, _)| record))
    }

    /// Returns the record kept under a fingerprint's digest, and when, where and by what its unit was
    /// made.
    ///
    /// # Errors
    ///
    /// Fails if the record cannot be read.
    pub fn record_and_provenance(
        &self,
        fingerprint: &Digest,
    ) -> Result<Option<(Record, Provenance)>, LakeError> {
        let Some(stored) = self.records.read(fingerprint)? else {
            return Ok(None);
        };
        let provenance = stored.provenance.clone();
        let record = self.records.whole(stored)?;
        Ok(record.map(|record| (record, provenance)))
    }

    /// Returns where the bytes of a file of an artifact lie.
    pub fn file(&self, file: &FileRef) -> PathBuf {
        self.blobs.path(&file.digest)
    }

    /// Drops what this process is making, and notes that its run was interrupted; nothing is kept
    /// after that. Returns the number of units dropped, and the guard that keeps it so.
    pub fn abandon(&self) -> (impl Sized + '_, usize) {
        let (guard, n_dropped) = self.flight.drop_all();
        let mine = atomic::process_name();
        for name in names_in(&self.staging()).unwrap_or_default() {
            if name.starts_with(&mine) {
                let _gone = fs::remove_file(self.staging().join(name));
            }
        }
        if let Some(run) = self.current_run().take() {
            // Where this fails, the run's process is gone in a moment, which says the same.
            let _noted = self.note_interrupted(run);
        }
        self.leave();
        (guard, n_dropped)
    }

    /// Keeps what an interrupted run has done.
    fn note_interrupted(&self, run: Run) -> Result<(), LakeError> {
        let mut record = run.record.clone();
        record.status = RunStatus::Interrupted;
        record.units = runs::units(&self.root, &run)?;
        let units = history::with_outcomes(self, record.units.clone())?;
        let history = history::keep(self, &run, &record, &units)?;
        runs::end(self, run, record, history)?;
        views::write(self)
    }

    /// Keeps the newest state of a pipeline, with what other processes have kept meanwhile.
    pub(crate) fn keep_newest(
        &self,
        pipeline: &str,
        units: Option<&[(UnitRef, Arc<RecordOutcome>)]>,
    ) -> Result<(), LakeError> {
        let touched = self.blobs.settle();
        let mut known = self.newest();
        let newest = known.entry(pipeline.to_owned()).or_default();
        let path = newest::path(&self.root, pipeline);
        self.prepare()?;
        let _turn = published::wait_for_turn(self, pipeline)?;
        let mut there = Newest::read(&path)?;
        let mut stamps = std::mem::take(&mut there.stamps);
        stamps.retain(|(digest, _)| self.blobs.stamp(digest).is_none());
        self.blobs.recall(stamps);
        let mut records = std::mem::take(&mut there.records);
        records.retain(|(unit, _)| self.records.stamp(unit).is_none());
        self.records.recall(records);
        there.take_over_shown(newest);
        *newest = there;
        if let Some(units) = units {
            newest.take_over(units);
        }
        for shown in newest.all_shown_mut().values_mut() {
            for (path, file) in shown.iter_mut() {
                if let Ok(stamp) = Stamp::read(&self.root.join(path))
                    && (self.blobs.stamp(&file.digest) == Some(stamp)
                        || touched.contains(&file.digest)
                            && stamp.differs_by_links_alone(file.stamp))
                {
                    file.stamp = stamp;
                }
            }
        }
        let record = |unit: &Digest| self.records.stamp(unit);
        newest.write(&self.staging(), &path, record, |blob| {
            self.blobs.stamp(blob)
        })
    }
}

/// Names in a folder, ordered; none if the folder is not there.
pub(crate) fn names_in(folder: &Path) -> Result<Vec<String>, LakeError> {
    let entries = match fs::read_dir(folder) {
        Err(err) if err.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.map_err(io_error("read", folder))?,
    };
    let mut names = entries
        .map(|entry| entry.map(|entry| entry.file_name().to_string_lossy().into_owned()))
        .collect::<Result<Vec<_>, _>>()
        .map_err(io_error("read", folder))?;
    names.sort();
    Ok(names)
}
