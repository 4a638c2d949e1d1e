//! A lake: its folder, and the components that manage it.

use std::{
    fs,
    path::{Path, PathBuf},
    sync::{Arc, OnceLock},
    time::Duration,
};

use dataflow::{ArtifactName, Digest, FileRef, Record, RunStatus, Turn};
use depot::Depot;

use crate::{
    LakeError,
    atomic::io_error,
    blobs::Blobs,
    cache::Cache,
    changing::ChangingMarks,
    clock,
    folder::{Folder, HISTORY, REPORTS, files_below},
    in_flight::InFlight,
    lock::Locks,
    mount,
    records::{Provenance, Records},
    register::{Register, Run},
    shared::{Shared, Sharing, SharingReport},
    sources::Sources,
};

/// Time for which the end of a run waits for a depot that does not answer.
const DOWN: Duration = Duration::from_secs(2);

/// A folder of artifacts.
pub struct Lake {
    pub(crate) folder: Folder,
    pub(crate) locks: Locks,
    pub(crate) blobs: Blobs,
    pub(crate) records: Records,
    pub(crate) register: Register,
    pub(crate) cache: Cache,
    pub(crate) changing: ChangingMarks,
    pub(crate) sources: Sources,
    pub(crate) in_flight: InFlight,
    /// Depot in which results are shared with other machines, if they are.
    pub(crate) shared: Option<Shared>,
    /// The type of its file system, if that has no locks between machines.
    unlocked: OnceLock<Option<String>>,
}

impl Lake {
    /// Opens a lake; the folder is created at the first write.
    pub fn open(root: &Path) -> Self {
        let folder = Folder::new(root);
        Self {
            locks: Locks::new(folder.locks()),
            blobs: Blobs::new(folder.clone()),
            records: Records::new(folder.clone()),
            register: Register::new(folder.clone()),
            cache: Cache::new(folder.clone()),
            changing: ChangingMarks::new(folder.clone()),
            sources: Sources::new(folder.clone()),
            in_flight: InFlight::default(),
            shared: None,
            unlocked: OnceLock::new(),
            folder,
        }
    }

    /// Shares results with other machines in a depot; nothing is asked of it yet.
    #[must_use]
    pub fn with_depot(mut self, depot: &Arc<dyn Depot>, sharing: &Sharing) -> Self {
        self.shared = Some(Shared::new(depot, &self.folder, sharing));
        self
    }

    /// Sends the results made so far to the depot, for at most `patience`, or seconds where it is down; the rest is
    /// sent later.
    ///
    /// # Errors
    ///
    /// Fails if the lake cannot be read.
    pub fn finish_sending(&self, patience: Duration) -> Result<(), LakeError> {
        let shared = self.shared.as_ref();
        shared.map_or(Ok(()), |shared| shared.finish(patience, DOWN))
    }

    /// Sends the results made so far to the depot, for at most `patience`, whether it is down or not.
    ///
    /// # Errors
    ///
    /// Fails if the lake cannot be read.
    pub fn send_all(&self, patience: Duration) -> Result<(), LakeError> {
        let shared = self.shared.as_ref();
        shared.map_or(Ok(()), |shared| shared.finish(patience, patience))
    }

    /// Returns a report of the results that this process shared with its depot, if it has one.
    ///
    /// # Errors
    ///
    /// Fails if the lake cannot be read.
    pub fn sharing(&self) -> Result<Option<SharingReport>, LakeError> {
        self.shared.as_ref().map(Shared::report).transpose()
    }

    /// The folder.
    pub fn root(&self) -> &Path {
        self.folder.root()
    }

    /// Prepares for writing.
    pub(crate) fn prepare(&self) -> Result<(), LakeError> {
        let staging = self.folder.staging();
        fs::create_dir_all(&staging).map_err(io_error("create", &staging))?;
        self.check_machine()?;
        self.locks.enter()
    }

    /// Returns the type of the file system under the lake, if its locks do not exclude processes on
    /// other machines.
    pub fn file_system_without_locks(&self) -> Option<&str> {
        let found = self
            .unlocked
            .get_or_init(|| mount::without_shared_locks(self.root()));
        found.as_deref()
    }

    /// Waits for garbage collection to end, and blocks it as long as the returned lock is kept: what a
    /// reader has found stays until it is read. A lake that cannot be written is not collected either.
    pub fn block_collection(&self) -> Option<fs::File> {
        self.locks.block_collection().ok()
    }

    /// Checks that no other machine writes to a lake whose locks hold on one machine only.
    fn check_machine(&self) -> Result<(), LakeError> {
        let Some(file_system) = self.file_system_without_locks() else {
            return Ok(());
        };
        let host = self.locks.reserve()?;
        if host == clock::host() {
            return Ok(());
        }
        Err(LakeError::OtherMachine {
            path: self.root().to_owned(),
            host,
            file_system: file_system.to_owned(),
        })
    }

    /// Notes in the depot that a unit is made here, whoever else makes it; returns whether its result has come.
    pub fn announce(&self, fingerprint: &Digest) -> bool {
        let shared = self.shared.as_ref();
        shared.is_some_and(|shared| shared.turn(fingerprint, true) == Turn::Made)
            && self.is_complete(fingerprint)
    }

    /// Ends this process's writing to the lake.
    pub fn leave(&self) {
        if let Some(shared) = &self.shared {
            shared.end_turns();
        }
        self.locks.leave();
    }

    /// Checks that there is a lake: a folder with something in it that a lake has.
    ///
    /// # Errors
    ///
    /// Fails with [`LakeError::NoLake`] if there is none.
    pub fn check_exists(&self) -> Result<(), LakeError> {
        let folder = &self.folder;
        let folders = [
            folder.blobs(),
            folder.units(),
            folder.runs(),
            folder.staging(),
        ];
        if folders.iter().any(|folder| folder.is_dir()) {
            return Ok(());
        }
        Err(LakeError::NoLake {
            path: self.root().to_owned(),
        })
    }

    /// Lists the tables of artifacts by name.
    ///
    /// # Errors
    ///
    /// Fails if the folder cannot be read.
    pub fn tables(&self) -> Result<Vec<ArtifactName>, LakeError> {
        self.folder.artifact_tables()
    }

    /// Names of the tables of runs, units, artifacts and metrics.
    pub fn history_tables() -> [&'static str; 5] {
        HISTORY
    }

    /// Returns the folder of a pipeline's charts, if it has any.
    pub fn report_folder(&self, pipeline: &str) -> Option<PathBuf> {
        let folder = self.folder.join(REPORTS).join(pipeline);
        let is_empty = files_below(&folder).is_ok_and(|files| files.is_empty());
        (!is_empty).then_some(folder)
    }

    /// Lists the numbers of all runs in order.
    ///
    /// # Errors
    ///
    /// Fails if the folder cannot be read.
    pub fn runs(&self) -> Result<Vec<u64>, LakeError> {
        self.register.numbers()
    }

    /// Reads a run with its units. A run whose process died is marked as interrupted.
    ///
    /// # Errors
    ///
    /// Fails if there is no such run or its record is damaged.
    pub fn run(&self, number: u64) -> Result<Run, LakeError> {
        let mut run = self.run_without_units(number)?;
        run.record.units = self.register.units(&run)?;
        Ok(run)
    }

    /// Reads a run without its units. A run whose process died is marked as interrupted.
    ///
    /// # Errors
    ///
    /// Fails if there is no such run or its record is damaged.
    pub fn run_without_units(&self, number: u64) -> Result<Run, LakeError> {
        self.register.read_with_end(number, &self.locks)
    }

    /// Returns the newest finished run of any pipeline, or else the newest of all. A repeated run
    /// counts as newer than those before the repetition.
    ///
    /// # Errors
    ///
    /// Fails if its record cannot be read.
    pub fn newest_run(&self) -> Result<Option<Run>, LakeError> {
        let numbers = self.register.ordered()?;
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

    /// Returns the record kept under a fingerprint's digest, and the provenance of its unit.
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

    /// Returns the path of the log of the unit of this fingerprint, if one was kept.
    pub fn log(&self, fingerprint: &Digest) -> Option<PathBuf> {
        Some(self.folder.log(fingerprint)).filter(|path| path.is_file())
    }

    /// Returns the folder of every table ever made of an artifact, by partition and unit.
    pub fn versions(&self, artifact: &str) -> PathBuf {
        self.folder.versions().join(artifact)
    }

    /// Returns the path of an artifact's file.
    pub fn file(&self, file: &FileRef) -> PathBuf {
        self.blobs.path(&file.digest)
    }

    /// Whether the lake has a depot, and it is not asked any more.
    pub fn is_depot_offline(&self) -> bool {
        let shared = self.shared.as_ref();
        shared.is_some_and(Shared::is_offline)
    }

    /// Whether the lake has a depot, and it is not asked any more or does not take results now.
    pub fn is_depot_down(&self) -> bool {
        let shared = self.shared.as_ref();
        shared.is_some_and(Shared::is_down)
    }

    /// Whether a blob was left in the depot.
    pub(crate) fn is_only_in_depot(&self, blob: &Digest) -> bool {
        let shared = self.shared.as_ref();
        shared.is_some_and(|shared| shared.has(blob)) && !self.blobs.path(blob).exists()
    }

    /// Fetches blobs that were left in the depot, as far as it has them.
    pub(crate) fn fetch_all<'f>(
        &self,
        files: impl IntoIterator<Item = &'f FileRef>,
    ) -> Result<(), LakeError> {
        match &self.shared {
            Some(shared) => {
                self.prepare()?;
                shared.fetch_all(&self.blobs, files)
            }
            None => Ok(()),
        }
    }

    /// Returns the path of an artifact's file; it is fetched if it was left in the depot.
    ///
    /// # Errors
    ///
    /// Fails if it can neither be found nor fetched.
    pub fn fetched(&self, file: &FileRef) -> Result<PathBuf, LakeError> {
        let path = self.file(file);
        let is_here = path.exists()
            || match &self.shared {
                Some(shared) => {
                    self.prepare()?;
                    shared.fetch(&self.blobs, file)?
                }
                None => false,
            };
        if is_here {
            Ok(path)
        } else {
            Err(LakeError::Lost { path })
        }
    }
}
