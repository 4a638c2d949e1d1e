//! A unit in the making: its lock, its staging folder and its commit.

use std::{
    fs,
    path::{Path, PathBuf},
    time::{Duration, SystemTime},
};

use dataflow::{BoxedDiagnostic, Digest, Record, RecordOutcome, UnitName, UnitTransaction};

use crate::{
    LakeError,
    atomic::{self, io_error},
    clock::{host, nanoseconds, now, program},
    lake::Lake,
    lock::{Lock, Waiting},
    records::Provenance,
};

/// A unit that this process makes.
pub(crate) struct UnitInProgress<'a> {
    lake: &'a Lake,
    folder: PathBuf,
    resume_folder: PathBuf,
    effects_folder: PathBuf,
    log_file: PathBuf,
    started: SystemTime,
    /// Held until the unit is stored or abandoned.
    _lock: Lock,
}

impl<'a> UnitInProgress<'a> {
    /// Waits for the unit's lock.
    pub(crate) fn begin(
        lake: &'a Lake,
        fingerprint: &Digest,
        unit: &UnitName,
        waiting: &Waiting,
    ) -> Result<Self, LakeError> {
        let lock = lake.locks.unit(fingerprint, unit, waiting)?;
        let name = fingerprint.to_hex();
        let folder = atomic::unique_name(&lake.folder.staging(), "unit");
        let begun = lake.in_flight.begin(&folder);
        begun.map_err(io_error("create", &folder))?;
        Ok(Self {
            lake,
            folder,
            log_file: lake.folder.log(fingerprint),
            resume_folder: lake.folder.resume().join(name),
            effects_folder: lake.folder.effects(),
            started: now(),
            _lock: lock,
        })
    }

    fn keep(&self, mut record: Record) -> Result<Record, LakeError> {
        // Bytes that this unit is about to need are not collected meanwhile.
        let _shared = self.lake.locks.block_collection()?;
        // From here on the unit is stored even at an interrupt.
        let _permit = self.lake.in_flight.permit_commit();
        if let RecordOutcome::Made { files, metrics, .. } = &mut record.outcome {
            if let Some((metric, value)) = metrics.iter().find(|(_, v)| !v.is_finite()) {
                return Err(LakeError::Metric {
                    metric: metric.clone(),
                    value: *value,
                });
            }
            for path in files_of(&self.folder)? {
                let name = path
                    .file_name()
                    .map_or_else(String::new, |name| name.to_string_lossy().into_owned());
                files.insert(name.try_into()?, self.lake.blobs.take(&path)?);
            }
        }
        let provenance = Provenance {
            started_ns: nanoseconds(self.started),
            took_s: now()
                .duration_since(self.started)
                .unwrap_or(Duration::ZERO)
                .as_secs_f64(),
            program: program(),
            host: host(),
            threads: std::thread::available_parallelism().map_or(0, usize::from),
        };
        if let Some(shared) = &self.lake.shared
            && !record.outcome.is_provisional()
        {
            shared.send_unit(&record.fingerprint.digest())?;
        }
        self.lake.records.keep(&record, provenance)?;
        // Leftovers are removed by the next garbage collection.
        let _left = self.start_over();
        Ok(record)
    }
}

/// The files of a folder, ordered by name. Stages write no folders.
fn files_of(folder: &Path) -> Result<Vec<PathBuf>, LakeError> {
    let entries = fs::read_dir(folder).map_err(io_error("read", folder))?;
    let mut paths = entries
        .map(|entry| entry.map(|entry| entry.path()))
        .collect::<Result<Vec<_>, _>>()
        .map_err(io_error("read", folder))?;
    paths.retain(|path| path.is_file());
    paths.sort();
    Ok(paths)
}

impl UnitTransaction for UnitInProgress<'_> {
    fn folder(&self) -> &Path {
        &self.folder
    }

    fn resume_folder(&self) -> &Path {
        &self.resume_folder
    }

    fn effects_folder(&self) -> &Path {
        &self.effects_folder
    }

    fn log_file(&self) -> &Path {
        &self.log_file
    }

    fn start_over(&self) -> Result<(), BoxedDiagnostic> {
        Ok(atomic::remove_folder_if_there(&self.resume_folder)?)
    }

    fn commit(self: Box<Self>, result: Record) -> Result<Record, BoxedDiagnostic> {
        Ok(self.keep(result)?)
    }
}

impl Drop for UnitInProgress<'_> {
    fn drop(&mut self) {
        // Leftovers are removed by a later run.
        let _left = fs::remove_dir_all(&self.folder);
        self.lake.in_flight.end(&self.folder);
    }
}
