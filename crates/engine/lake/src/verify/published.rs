//! Checks of the published files against the records: all of them, and no others.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs::{self, Metadata},
    io,
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
    thread,
    time::Duration,
};

use dataflow::{Digest, RunStatus, Stamp};

use super::{Fault, NO_FILE, Verifier};
use crate::{
    LakeError, atomic,
    digests::digest_file,
    folder::{FILES, HISTORY, REPORTS, TABLES, digest_named, files_below, run_of, unit_of},
    table, views,
};

/// Tries to compare the published files with the records while runs end.
const TRIES: usize = 20;

/// Time between them: longer than a run takes to record what it has shown.
const PAUSE: Duration = Duration::from_millis(20);

impl Verifier<'_> {
    /// Checks the published files against the records.
    pub(super) fn check_published(&mut self) -> Result<(), LakeError> {
        // Runs may end meanwhile: then the records read are incomplete.
        let n_faults = self.verified.faults.len();
        let n_files = self.verified.n_files;
        let mut found: Option<BTreeSet<Fault>> = None;
        for _ in 0..TRIES {
            let before = self.state_of_runs()?;
            self.verified.n_files = n_files;
            self.check_published_once()?;
            // What is damaged is so at every try; what a run was about to change is not.
            let now: BTreeSet<Fault> = self.verified.faults.drain(n_faults..).collect();
            let left = match &found {
                None => now,
                Some(before) => before & &now,
            };
            let is_decided = left.is_empty() || self.state_of_runs()? == before;
            found = Some(left);
            if is_decided {
                break;
            }
            thread::sleep(PAUSE);
        }
        self.verified.faults.extend(found.into_iter().flatten());
        Ok(())
    }

    /// A state that changes whenever a run begins or ends a publication.
    fn state_of_runs(&self) -> Result<(Vec<String>, Vec<Option<Stamp>>), LakeError> {
        let mut runs = files_below(&self.lake.folder.runs())?;
        // A run that is repeated changes what is shown, and has no new record.
        runs.push(self.lake.folder.repeated_run());
        let stamps = runs.iter().map(|path| Stamp::read(path).ok());
        Ok((self.lake.changing.marks()?, stamps.collect()))
    }

    fn check_published_once(&mut self) -> Result<(), LakeError> {
        let folder = &self.lake.folder;
        let faults = self.verified.faults.iter();
        let state = PublishedState {
            damaged: faults
                .filter(|fault| fault.path.starts_with("blobs"))
                .filter_map(|fault| digest_named(&fault.path))
                .collect(),
            changing: self.lake.changing.pipelines()?,
        };
        let mut expected = BTreeMap::new();
        let pipelines = match self.lake.recorded_pipelines() {
            Ok(pipelines) => pipelines,
            // Reported already; without it the published files cannot be checked.
            Err(LakeError::Damaged { .. } | LakeError::Json { .. }) => return Ok(()),
            Err(err) => return Err(err),
        };
        for pipeline in pipelines {
            let (of_pipeline, lost) = match self.lake.promised_by(&pipeline) {
                Ok(expected) => expected,
                Err(
                    LakeError::Damaged { .. } | LakeError::Json { .. } | LakeError::Lost { .. },
                ) => {
                    return Ok(());
                }
                Err(err) => return Err(err),
            };
            for unit in lost {
                let path = self.lake.records.path(&unit);
                if !path.exists() {
                    self.fault(&path, "is missing; its published file exists");
                }
            }
            expected.extend(of_pipeline);
        }
        for folder_name in [TABLES, FILES, REPORTS] {
            for path in files_below(&folder.join(folder_name))? {
                let name = folder.below(&path);
                if HISTORY
                    .iter()
                    .any(|table| name.starts_with(Path::new(TABLES).join(table)))
                {
                    continue;
                }
                let promise = expected.remove(&*name.to_string_lossy());
                self.check_published_file(&state, &path, promise);
            }
        }
        for (name, digest) in expected {
            if !state.is_changing(Path::new(&name)) && !self.unfetched.contains(&digest) {
                self.fault(&folder.join(&name), "is missing: a unit made it");
            }
        }
        self.check_run_tables()?;
        self.check_unit_tables(&state)?;
        self.check_views()
    }

    /// Checks a file below the newest tables, files and charts.
    fn check_published_file(
        &mut self,
        state: &PublishedState,
        path: &Path,
        expected: Option<Digest>,
    ) {
        self.verified.n_files += 1;
        let digest = match self.digest_published(path) {
            Ok(digest) => digest,
            Err(_) if atomic::is_no_file(path) => return self.fault(path, NO_FILE),
            Err(err) if err.kind() == io::ErrorKind::NotFound => return,
            Err(err) => return self.fault(path, format!("cannot be read: {err}")),
        };
        let name = self.lake.folder.below(path);
        // A run that is not recorded yet may have published its artifacts.
        let is_new = || state.is_changing(name) && self.lake.blobs.path(&digest).exists();
        match expected {
            _ if state.damaged.contains(&digest) => {
                self.fault(path, "has the bytes of a damaged blob");
            }
            Some(expected) if expected == digest => {}
            _ if is_new() => {}
            Some(_) => self.fault(path, "does not match the digest in its unit's record"),
            None => self.fault(path, "belongs to no current unit"),
        }
    }

    /// The digest of a published file; a linked blob has been read already.
    fn digest_published(&self, path: &Path) -> io::Result<Digest> {
        let metadata = fs::metadata(path)?;
        match self.inodes.get(&(metadata.dev(), metadata.ino())) {
            // A blob that was replaced meanwhile has left its inode to another file.
            Some(digest) if is_at(&self.lake.blobs.path(digest), &metadata) => Ok(*digest),
            _ => digest_file(path),
        }
    }

    /// Checks the tables of runs.
    fn check_run_tables(&mut self) -> Result<(), LakeError> {
        let folder = &self.lake.folder;
        let mut there: BTreeSet<PathBuf> = folder.run_tables()?.into_iter().collect();
        let mut running = BTreeSet::new();
        for number in self.lake.register.numbers()? {
            let Ok(run) = self.lake.register.read(number) else {
                running.insert(number);
                continue;
            };
            if run.record.status == RunStatus::Running {
                running.insert(number);
            }
            for (name, file) in &run.history {
                let path = folder.run_table(name, number);
                there.remove(&path);
                self.verified.n_files += 1;
                match digest_file(&path) {
                    Ok(digest) if digest == file.digest => {}
                    Ok(_) => self.fault(&path, "does not match its run's record"),
                    Err(err) => self.fault(&path, format!("cannot be read: {err}")),
                }
                let blob = self.lake.file(file);
                if !blob.exists() {
                    self.fault(&blob, "is missing: it is a table of a run");
                }
            }
        }
        for path in there {
            // A finishing run writes its tables before its record.
            if !run_of(&path).is_some_and(|run| running.contains(&run)) {
                self.fault(&path, "belongs to no recorded run");
            }
        }
        Ok(())
    }

    /// Checks the tables of all units.
    fn check_unit_tables(&mut self, state: &PublishedState) -> Result<(), LakeError> {
        let folder = &self.lake.folder;
        let mut expected = self.lake.promised_versions()?;
        for path in files_below(&folder.versions())? {
            self.verified.n_files += 1;
            let is_promised = expected.remove(&path).is_some();
            let Some((partition, unit)) = unit_of(&path) else {
                self.fault(&path, "belongs to no unit");
                continue;
            };
            let Some(stored) = self.lake.records.read(&unit)? else {
                if is_promised {
                    let record = self.lake.records.path(&unit);
                    if !record.exists() {
                        self.fault(&record, "is missing; its table exists");
                    }
                }
                self.fault(&path, "the record of its unit is missing or damaged");
                continue;
            };
            let made = stored.outcome.file(table::FILE);
            match (self.digest_published(&path), made) {
                (Ok(digest), _) if state.damaged.contains(&digest) => {
                    self.fault(&path, "has the bytes of a damaged blob");
                }
                (Ok(digest), Some(file))
                    if digest == file.digest && stored.partition == partition => {}
                (Ok(_), _) => {
                    self.fault(&path, "does not match the digest in its unit's record");
                }
                (Err(err), _) => self.fault(&path, format!("cannot be read: {err}")),
            }
        }
        for (path, unit) in expected {
            let stored = self.lake.records.read(&unit)?;
            let has_table = stored.is_some_and(|stored| stored.outcome.file(table::FILE).is_some());
            // Asked in this order: what a process that ended meanwhile has made is there.
            if has_table && !self.lake.may_be_published(&unit)? && !path.exists() {
                self.fault(&path, "is missing: a unit made it");
            }
        }
        Ok(())
    }

    fn check_views(&mut self) -> Result<(), LakeError> {
        let path = self.lake.folder.views();
        self.verified.n_files += usize::from(path.exists());
        let [first, ..] = HISTORY;
        if !self.lake.folder.tables().join(first).exists() {
            return Ok(());
        }
        // A run may end between two of these lines.
        for _ in 0..TRIES {
            let views = views::text(self.lake)?;
            let there = atomic::read_if_there(&path)?;
            if there.as_deref() == Some(views.as_bytes()) || !self.lake.changing.marks()?.is_empty()
            {
                return Ok(());
            }
            thread::sleep(PAUSE);
        }
        self.fault(&path, "is out of date with the tables");
        Ok(())
    }
}

/// Whether the file at a path is this one.
fn is_at(path: &Path, file: &Metadata) -> bool {
    fs::metadata(path).is_ok_and(|there| (there.dev(), there.ino()) == (file.dev(), file.ino()))
}

/// State shared by the checks of published files.
struct PublishedState {
    /// Blobs that are damaged.
    damaged: BTreeSet<Digest>,
    /// Pipelines whose published files are being changed, or were when a program died.
    changing: BTreeSet<String>,
}

impl PublishedState {
    /// Whether a file, named below the lake, is one that its pipeline may be changing.
    fn is_changing(&self, name: &Path) -> bool {
        let mut folders = name.iter().skip(1).filter_map(|folder| folder.to_str());
        let folders = [folders.next(), folders.next()];
        let pipeline = match (name.starts_with(TABLES), folders) {
            (true, [_, Some(folder)]) => folder.strip_prefix("pipeline="),
            (_, [pipeline, _]) => pipeline,
        };
        pipeline.is_some_and(|pipeline| self.changing.contains(pipeline))
    }
}
