//! Verification of the whole lake: every byte against its stored digest.

mod published;

use std::{
    collections::{BTreeSet, HashMap},
    fs,
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
};

use dataflow::{Digest, RecordOutcome, Stamp};
use serde::{Deserialize, Serialize};

use crate::{
    LakeError,
    atomic::{self, io_error},
    digests::{OnBytes, check_digests},
    folder::{files_below, names_in},
    lake::Lake,
    newest::Newest,
    records::Stored,
    repair, replicated_files, sealed, snapshot, sources,
};

/// What is said of a pipe, a folder or a broken link.
const NO_FILE: &str = "is a folder, a pipe or a broken link in the place of a file";

/// A fault in the lake.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Fault {
    /// The file, below the lake, or a file outside.
    pub path: PathBuf,
    /// Description of the fault.
    pub what: String,
    /// Whether the file is useless, so that it can be dropped and rebuilt.
    #[serde(skip)]
    pub can_drop: bool,
}

/// The result of a verification.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct VerificationReport {
    /// Number of files checked.
    pub n_files: usize,
    /// Bytes read.
    pub n_bytes: u64,
    /// The faults, ordered by path.
    pub faults: Vec<Fault>,
}

impl Lake {
    /// Checks the whole lake: that every file holds what was stored, and that the published files
    /// are exactly those in the records.
    ///
    /// # Errors
    ///
    /// Fails if there is no lake or a folder cannot be read; a file that cannot is a fault.
    pub fn verify(&self, on_bytes: &OnBytes) -> Result<VerificationReport, LakeError> {
        self.check_exists()?;
        // Files collected meanwhile are not faults. A read-only lake has no garbage collection.
        let _shared = self.locks.block_collection().ok();
        self.verify_alone(on_bytes)
    }

    /// Checks everything while garbage collection is blocked.
    fn verify_alone(&self, on_bytes: &OnBytes) -> Result<VerificationReport, LakeError> {
        let mut verifier = Verifier {
            lake: self,
            verified: VerificationReport::default(),
            inodes: HashMap::new(),
            unfetched: names_in(&self.folder.unfetched())?
                .iter()
                .filter_map(|name| name.parse().ok())
                .collect(),
        };
        verifier.check_blobs(on_bytes)?;
        verifier.check_records()?;
        verifier.check_replicated()?;
        verifier.check_caches()?;
        verifier.check_published()?;
        verifier.verified.faults.sort();
        Ok(verifier.verified)
    }

    /// Checks the files outside the lake with unchanged stamps: finds those whose content changed
    /// behind an unchanged size, time and inode, and drops their cached digests, so that the next
    /// run sees the change.
    ///
    /// # Errors
    ///
    /// Fails if the lake cannot be written; a file that cannot be read is a fault.
    pub fn verify_inputs(&self, on_bytes: &OnBytes) -> Result<VerificationReport, LakeError> {
        let entries: Vec<(PathBuf, Stamp, Digest)> = {
            let known = self.sources.known();
            let entries = known.entries.iter();
            let mut entries: Vec<_> = entries
                .map(|(path, entry)| (PathBuf::from(path), entry.stamp, entry.digest))
                .collect();
            entries.sort_by(|a, b| a.0.cmp(&b.0));
            entries
        };
        // The next run reads files with changed stamps anyway, and reports missing ones.
        let unchanged: Vec<(PathBuf, Digest)> = entries
            .into_iter()
            .filter(|(path, stamp, _)| Stamp::read(path).is_ok_and(|now| now == *stamp))
            .map(|(path, _, digest)| (path, digest))
            .collect();
        let (faults, n_bytes) = check_digests(&unchanged, on_bytes, |path| Fault {
            path: path.to_owned(),
            what: "changed since it was read, behind an unchanged size, time and inode".to_owned(),
            can_drop: false,
        });
        let verified = VerificationReport {
            n_files: unchanged.len(),
            n_bytes,
            faults,
        };
        for fault in &verified.faults {
            self.sources.forget(&fault.path.to_string_lossy());
        }
        if !verified.faults.is_empty() {
            self.prepare()?;
            self.sources.save(&self.locks)?;
        }
        Ok(verified)
    }

    /// Removes damaged files, so that the next run that needs them rebuilds them, and restores
    /// those with copies. Everything is checked once more while commits are blocked: files repaired
    /// meanwhile stay. Returns the number of files removed.
    ///
    /// # Errors
    ///
    /// Fails if a file cannot be removed.
    pub fn drop_damaged(&self, on_bytes: &OnBytes) -> Result<usize, LakeError> {
        self.prepare()?;
        let mut n_dropped = 0;
        loop {
            let _alone = self.locks.lock_collection()?;
            let faults = self.verify_alone(on_bytes)?.faults;
            let mut droppable: Vec<PathBuf> = faults
                .iter()
                .filter(|fault| fault.can_drop)
                .map(|fault| self.root().join(&fault.path))
                .collect();
            // A link that leads nowhere is there by itself.
            droppable.retain(|path| path.symlink_metadata().is_ok());
            for path in &droppable {
                atomic::remove_if_there(path)?;
            }
            n_dropped += droppable.len();
            // The dropped files may be those of a record.
            if droppable.is_empty() {
                break;
            }
        }
        repair::repair(self)?;
        Ok(n_dropped)
    }
}

struct Verifier<'a> {
    lake: &'a Lake,
    verified: VerificationReport,
    /// The existing blobs, by device and inode.
    inodes: HashMap<(u64, u64), Digest>,
    /// Blobs that were left in the depot.
    unfetched: BTreeSet<Digest>,
}

impl Verifier<'_> {
    fn fault(&mut self, path: &Path, what: impl Into<String>) {
        self.verified.faults.push(Fault {
            path: self.lake.folder.below(path).to_owned(),
            what: what.into(),
            can_drop: true,
        });
    }

    fn check_blobs(&mut self, on_bytes: &OnBytes) -> Result<(), LakeError> {
        let mut files = Vec::new();
        for path in files_below(&self.lake.folder.blobs())? {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            match name.parse::<Digest>() {
                Ok(digest) => {
                    if let Ok(metadata) = fs::metadata(&path) {
                        let inode = (metadata.dev(), metadata.ino());
                        self.inodes.insert(inode, digest);
                    }
                    files.push((path, digest));
                }
                Err(_) => self.fault(&path, "does not belong here: its name is not a digest"),
            }
        }
        let folder = &self.lake.folder;
        let (mut faults, n_bytes) = check_digests(&files, on_bytes, |path| Fault {
            path: folder.below(path).to_owned(),
            what: "bytes differ from the digest in the file name".to_owned(),
            can_drop: true,
        });
        self.verified.n_files += files.len();
        self.verified.n_bytes += n_bytes;
        self.verified.faults.append(&mut faults);
        Ok(())
    }

    fn check_records(&mut self) -> Result<(), LakeError> {
        let records = &self.lake.records;
        for path in files_below(&self.lake.folder.units())? {
            let Some(stored) = self.sealed_as::<Stored>(&path) else {
                continue;
            };
            let fingerprint = stored.fingerprint;
            if path != records.path(&fingerprint) {
                self.fault(&path, "record's fingerprint differs from its file name");
                continue;
            }
            let lacking = self.lacking(&stored.outcome);
            match records.whole(stored)? {
                None => self.fault(&path, "its recipe is missing or damaged"),
                Some(record) if record.fingerprint.digest() != fingerprint => {
                    self.fault(&path, "recipe's fingerprint differs from the file name");
                }
                Some(_) => {}
            }
            if let Some(lacking) = lacking {
                self.fault(&path, lacking);
            }
        }
        Ok(())
    }

    /// Returns the file of a result that is not in the lake.
    fn lacking(&self, outcome: &RecordOutcome) -> Option<String> {
        outcome.files()?.iter().find_map(|(name, file)| {
            let path = self.lake.file(file);
            // A run may have left it in the depot meanwhile.
            let is_left = self.unfetched.contains(&file.digest)
                || self
                    .lake
                    .folder
                    .unfetched()
                    .join(file.digest.to_hex())
                    .exists();
            let is_here = fs::metadata(&path).is_ok_and(|blob| blob.len() == file.size);
            (!is_here && !is_left).then(|| format!("its file `{name}` is missing or cut off"))
        })
    }

    /// Checks the files with backup copies, and the copies.
    fn check_replicated(&mut self) -> Result<(), LakeError> {
        let lake = self.lake;
        let runs = lake.folder.runs();
        for (path, check) in replicated_files::all(lake)? {
            let is_run = path.starts_with(&runs);
            self.replicas_of(&path, &|path, bytes| {
                check(lake, path, bytes)?;
                if !is_run {
                    return Ok(());
                }
                let run = lake.register.parse(path, bytes)?;
                lake.register.units(&run).map(drop)
            });
        }
        Ok(())
    }

    fn replicas_of(&mut self, path: &Path, check: &impl Fn(&Path, &[u8]) -> Result<(), LakeError>) {
        let copy = self.lake.folder.copy_of(path);
        for path in [path, &copy] {
            if let Some(bytes) = self.bytes_of(path) {
                self.report_unless_ok(path, check(path, &bytes));
            }
        }
        // The copy is written second, so that it may not exist yet.
        if !path.exists() && copy.exists() {
            self.fault(path, "is missing; its copy is there");
        }
    }

    /// Reports what is in the place of a file and is none.
    fn expect_nothing(&mut self, path: &Path) {
        if atomic::is_no_file(path) {
            self.fault(path, NO_FILE);
        }
    }

    /// Checks what only saves time.
    fn check_caches(&mut self) -> Result<(), LakeError> {
        let folder = &self.lake.folder;
        for name in names_in(&folder.newest())? {
            let path = folder.newest().join(name);
            self.check_cache(&path, |bytes| Newest::is_whole(&path, bytes));
        }
        self.check_cache(&folder.snapshot(), snapshot::is_whole);
        self.check_cache(&folder.sources(), sources::is_whole);
        Ok(())
    }

    fn check_cache(&mut self, path: &Path, is_whole: impl Fn(&[u8]) -> bool) {
        if self.bytes_of(path).is_some_and(|bytes| !is_whole(&bytes)) {
            self.fault(path, "its bytes are not the ones that were written");
        }
    }

    /// Reads a file, or reports why it cannot be read; `None` too if there is nothing.
    fn bytes_of(&mut self, path: &Path) -> Option<Vec<u8>> {
        match atomic::read_if_there(path) {
            Ok(Some(bytes)) => {
                self.verified.n_files += 1;
                self.verified.n_bytes += bytes.len() as u64;
                Some(bytes)
            }
            Ok(None) => {
                self.expect_nothing(path);
                None
            }
            Err(err) => {
                self.fault(path, format!("cannot be read: {err}"));
                None
            }
        }
    }

    /// Reads a sealed file, or reports its fault.
    fn sealed_as<T: for<'de> Deserialize<'de>>(&mut self, path: &Path) -> Option<T> {
        self.verified.n_files += 1;
        let read = fs::metadata(path).map(|metadata| self.verified.n_bytes += metadata.len());
        let read = read.map_err(io_error("read", path));
        match read.and_then(|()| sealed::read(path)) {
            Ok(Some(value)) => Some(value),
            Ok(None) => {
                self.expect_nothing(path);
                None
            }
            Err(err) => {
                self.report_unless_ok(path, Err(err));
                None
            }
        }
    }

    /// Reports the fault of a file that was read, if it has one.
    fn report_unless_ok(&mut self, path: &Path, read: Result<(), LakeError>) {
        match read {
            Ok(()) => {}
            Err(LakeError::Damaged { path: at }) if at == path => {
                self.fault(path, "its bytes are not the ones that were written");
            }
            Err(LakeError::Json { source, .. }) => {
                let what = format!("was written by another version of the program: {source}");
                self.fault(path, what);
            }
            Err(err) => self.fault(path, err.to_string()),
        }
    }
}

#[cfg(test)]
mod tests {
    use dataflow::Store;

    use super::*;
    use crate::sources::Entry;

    #[expect(
        clippy::disallowed_methods,
        reason = "a test's file may well be half a file"
    )]
    fn put(path: &Path, text: &str) {
        fs::write(path, text).unwrap();
    }

    #[test]
    fn an_input_changed_behind_an_unchanged_stamp_is_found_and_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let input = folder.path().join("recording");
        let lake = Lake::open(&folder.path().join("lake"));
        put(&input, "new bytes");
        // A test cannot set back `ctime`, so the cached entry is set instead.
        let remembered = Entry {
            stamp: Stamp::read(&input).unwrap(),
            digest: Digest::of_bytes(b"old bytes"),
        };
        let key = input.to_str().unwrap().to_owned();
        lake.sources.known().entries.insert(key, remembered);
        assert_eq!(lake.source_digest(&input, None).unwrap(), remembered.digest);

        let verified = lake.verify_inputs(&|_, _| {}).unwrap();
        let paths: Vec<&Path> = verified.faults.iter().map(|fault| &*fault.path).collect();
        assert_eq!(paths, [input.as_path()]);
        let now = Digest::of_bytes(b"new bytes");
        assert_eq!(lake.source_digest(&input, None).unwrap(), now);
        let again = lake.verify_inputs(&|_, _| {}).unwrap();
        assert_eq!(again.faults, []);
    }
}
