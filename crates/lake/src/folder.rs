//! The lake's folder, and the store that a run needs.

use std::{
    collections::BTreeMap,
    fs, io,
    path::{Path, PathBuf},
    time::{Duration, SystemTime, UNIX_EPOCH},
};

use dataflow::{
    Advised, Digest, FileRef, Making, Node, NodeName, Record, RecordOutcome, RunRecord, Store,
    UnitRef,
};
use serde::{Serialize, de::DeserializeOwned};

use crate::{
    LakeError,
    atomic::{self, io_error},
    blobs::Blobs,
    clock::now,
    making::UnitInTheMaking,
    published,
    sources::Sources,
};

/// A folder of artifacts.
pub struct Lake {
    root: PathBuf,
    blobs: Blobs,
    sources: Sources,
}

impl Lake {
    /// Opens a lake; the folder is made when something is first written to it.
    pub fn open(root: &Path) -> Self {
        Self {
            root: root.to_owned(),
            blobs: Blobs::new(root.join("blobs")),
            sources: Sources::open(root.join("sources.json")),
        }
    }

    /// The folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    pub(crate) fn blobs(&self) -> &Blobs {
        &self.blobs
    }

    pub(crate) fn staging(&self) -> PathBuf {
        self.root.join("staging")
    }

    /// Lists the tables by name.
    ///
    /// # Errors
    ///
    /// Fails if the folder cannot be read.
    pub fn tables(&self) -> Result<Vec<String>, LakeError> {
        names_in(&self.root.join(published::TABLES))
    }

    /// Returns the folder of a table's newest partitions in a pipeline.
    pub fn table_folder(&self, table: &str, pipeline: &str) -> PathBuf {
        let tables = self.root.join(published::TABLES);
        tables.join(table).join(format!("pipeline={pipeline}"))
    }

    /// Returns the newest run of any pipeline, and its name.
    ///
    /// # Errors
    ///
    /// Fails if its record cannot be read.
    pub fn newest_run(&self) -> Result<Option<(String, RunRecord)>, LakeError> {
        let folder = self.root.join("runs");
        let Some(name) = names_in(&folder)?.pop() else {
            return Ok(None);
        };
        let run = read_json(&folder.join(&name))?;
        Ok(run.map(|run| (name.trim_end_matches(".json").to_owned(), run)))
    }

    /// Returns the record kept under a fingerprint's digest.
    ///
    /// # Errors
    ///
    /// Fails if the record cannot be read.
    pub fn record(&self, fingerprint: &Digest) -> Result<Option<Record>, LakeError> {
        match read_json(&self.record_path(fingerprint)) {
            // A damaged record is as good as none: the unit is made again.
            Err(LakeError::Json { .. }) => Ok(None),
            record => record,
        }
    }

    /// Returns where the bytes of a file of an artifact lie.
    pub fn file(&self, file: &FileRef) -> PathBuf {
        self.blobs.path(&file.digest)
    }

    /// Returns when, where and by what a unit was made, one JSON object per making.
    ///
    /// # Errors
    ///
    /// Fails if the record cannot be read.
    pub fn provenance(&self, fingerprint: &Digest) -> Result<Option<String>, LakeError> {
        let bytes = atomic::read_if_there(&self.provenance_path(fingerprint))?;
        Ok(bytes.map(|bytes| String::from_utf8_lossy(&bytes).into_owned()))
    }

    pub(crate) fn keep_record(&self, record: &Record) -> Result<(), LakeError> {
        let path = self.record_path(&record.fingerprint.digest());
        atomic::write(&self.staging(), &path, &to_json(&path, record)?)
    }

    pub(crate) fn keep_provenance(
        &self,
        record: &Record,
        started: SystemTime,
        took: Duration,
    ) -> Result<(), LakeError> {
        let path = self.provenance_path(&record.fingerprint.digest());
        let provenance = serde_json::json!({
            "started_ns": nanoseconds(started),
            "took_s": took.as_secs_f64(),
            "program": concat!("pipeline ", env!("CARGO_PKG_VERSION")),
            "host": fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default().trim(),
            "threads": std::thread::available_parallelism().map_or(0, usize::from),
        });
        atomic::write(&self.staging(), &path, format!("{provenance}\n").as_bytes())
    }

    fn record_path(&self, fingerprint: &Digest) -> PathBuf {
        let name = fingerprint.as_str();
        let folder = self
            .root
            .join("units")
            .join(name.get(..2).unwrap_or_default());
        folder.join(format!("{name}.json"))
    }

    fn newest_path(&self, pipeline: &str) -> PathBuf {
        self.root.join("newest").join(format!("{pipeline}.json"))
    }

    fn provenance_path(&self, fingerprint: &Digest) -> PathBuf {
        let folder = self.root.join("provenance");
        folder.join(format!("{fingerprint}.json"))
    }

    fn prepare(&self) -> Result<(), LakeError> {
        let staging = self.staging();
        fs::create_dir_all(&staging).map_err(io_error("create", &staging))
    }
}

impl Store for Lake {
    fn lookup(&self, fingerprint: &Digest) -> Result<Option<Record>, Advised> {
        let record = self.record(fingerprint)?;
        Ok(record.filter(|record| match &record.outcome {
            RecordOutcome::Made { files, .. } => files.values().all(|file| self.blobs.has(file)),
            RecordOutcome::Skipped { .. } | RecordOutcome::Filtered { .. } => true,
        }))
    }

    fn remembered(&self, fingerprint: &Digest) -> Result<Option<Record>, Advised> {
        Ok(self.record(fingerprint)?)
    }

    fn newest_units(&self, pipeline: &str) -> Result<Vec<UnitRef>, Advised> {
        // A damaged list only means that causes are not named.
        let newest = read_json(&self.newest_path(pipeline)).unwrap_or_default();
        Ok(newest.unwrap_or_default())
    }

    fn source_digest(&self, path: &Path) -> Result<Digest, io::Error> {
        self.sources.digest(path)
    }

    fn begin(&self, fingerprint: &Digest) -> Result<Box<dyn Making + '_>, Advised> {
        self.prepare()?;
        Ok(Box::new(UnitInTheMaking::begin(self, fingerprint)?))
    }

    fn open(
        &self,
        files: &BTreeMap<String, FileRef>,
    ) -> Result<Option<BTreeMap<String, PathBuf>>, Advised> {
        let mut paths = BTreeMap::new();
        let mut is_whole = true;
        for (name, file) in files {
            if self.blobs.is_whole(file)? {
                paths.insert(name.clone(), self.blobs.path(&file.digest));
            } else {
                self.blobs.drop(file)?;
                is_whole = false;
            }
        }
        Ok(is_whole.then_some(paths))
    }

    fn publish(
        &self,
        pipeline: &str,
        node: &Node,
        made: &[(String, RecordOutcome)],
    ) -> Result<(), Advised> {
        self.prepare()?;
        Ok(published::publish(self, pipeline, node, made)?)
    }

    fn retire(&self, pipeline: &str, kept: &[Node]) -> Result<(), Advised> {
        Ok(published::retire(self, pipeline, kept)?)
    }

    fn record_run(&self, run: &RunRecord) -> Result<String, Advised> {
        self.prepare()?;
        self.sources.save(&self.staging())?;
        let name = format!("{:019}-{}", nanoseconds(now()), std::process::id());
        let path = self.root.join("runs").join(format!("{name}.json"));
        atomic::write(&self.staging(), &path, &to_json(&path, run)?)?;
        let mut newest: BTreeMap<(NodeName, String), UnitRef> = BTreeMap::new();
        for unit in self.newest_units(&run.pipeline)?.iter().chain(&run.units) {
            newest.insert((unit.node.clone(), unit.partition.clone()), unit.clone());
        }
        let newest: Vec<UnitRef> = newest.into_values().collect();
        let path = self.newest_path(&run.pipeline);
        atomic::write(&self.staging(), &path, &to_json(&path, &newest)?)?;
        Ok(name)
    }
}

fn nanoseconds(time: SystemTime) -> u128 {
    time.duration_since(UNIX_EPOCH)
        .unwrap_or(Duration::ZERO)
        .as_nanos()
}

fn to_json<T: Serialize>(path: &Path, value: &T) -> Result<Vec<u8>, LakeError> {
    serde_json::to_vec_pretty(value).map_err(|source| LakeError::Json {
        path: path.to_owned(),
        source,
    })
}

fn read_json<T: DeserializeOwned>(path: &Path) -> Result<Option<T>, LakeError> {
    let Some(bytes) = atomic::read_if_there(path)? else {
        return Ok(None);
    };
    serde_json::from_slice(&bytes)
        .map(Some)
        .map_err(|source| LakeError::Json {
            path: path.to_owned(),
            source,
        })
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
