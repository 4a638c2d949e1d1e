//! A unit in the making: its lock, its staging folder and its commit.

use std::{
    fs::{self, File},
    path::{Path, PathBuf},
    time::{Duration, SystemTime},
};

use dataflow::{Advised, Digest, Making, Outcome, Record, RecordOutcome, Unkept};

use crate::{LakeError, atomic::io_error, clock::now, folder::Lake, lock};

/// A unit that this process makes.
pub(crate) struct UnitInTheMaking<'a> {
    lake: &'a Lake,
    folder: PathBuf,
    started: SystemTime,
    /// Held until the unit is kept or given up; the system lets go of it when the process dies.
    _lock: File,
}

impl<'a> UnitInTheMaking<'a> {
    /// Waits for the unit's lock and clears what a dead owner left behind.
    pub(crate) fn begin(lake: &'a Lake, fingerprint: &Digest) -> Result<Self, LakeError> {
        let lock = lock::wait_for(lake, fingerprint.as_str())?;
        let folder = lake.staging().join(fingerprint.as_str());
        if folder.exists() {
            fs::remove_dir_all(&folder).map_err(io_error("remove", &folder))?;
        }
        fs::create_dir_all(&folder).map_err(io_error("create", &folder))?;
        Ok(Self {
            lake,
            folder,
            started: now(),
            _lock: lock,
        })
    }

    fn keep(&self, unkept: Unkept) -> Result<Record, LakeError> {
        let outcome = match unkept.outcome {
            Outcome::Made(made) => {
                let mut files = std::collections::BTreeMap::new();
                for path in files_of(&self.folder)? {
                    let name = path
                        .file_name()
                        .map_or_else(String::new, |name| name.to_string_lossy().into_owned());
                    files.insert(name, self.lake.blobs().take(&path)?);
                }
                if let Some((metric, value)) = made.metrics.iter().find(|(_, v)| !v.is_finite()) {
                    return Err(LakeError::Metric {
                        metric: metric.clone(),
                        value: *value,
                    });
                }
                RecordOutcome::Made {
                    files,
                    labels: made.labels,
                    metrics: made.metrics,
                }
            }
            Outcome::Skipped { reason } => RecordOutcome::Skipped { reason },
            Outcome::Filtered { reason } => RecordOutcome::Filtered { reason },
        };
        let record = Record {
            fingerprint: unkept.fingerprint,
            outcome,
        };
        self.lake.keep_record(&record)?;
        let took = self.started.elapsed().unwrap_or(Duration::ZERO);
        self.lake.keep_provenance(&record, self.started, took)?;
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

impl Making for UnitInTheMaking<'_> {
    fn folder(&self) -> &Path {
        &self.folder
    }

    fn commit(self: Box<Self>, result: Unkept) -> Result<Record, Advised> {
        Ok(self.keep(result)?)
    }
}

impl Drop for UnitInTheMaking<'_> {
    fn drop(&mut self) {
        // What cannot be removed now is removed by whoever makes the unit next.
        let _left = fs::remove_dir_all(&self.folder);
    }
}
