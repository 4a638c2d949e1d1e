//! Checking the whole lake: every byte against the digest that it was stored with.

use std::{
    collections::{BTreeSet, HashMap},
    fs, io,
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicU64, AtomicUsize, Ordering},
    },
};

use dataflow::{Digest, RecordOutcome};
use serde::{Deserialize, Serialize, de::IgnoredAny};

use crate::{
    LakeError,
    atomic::io_error,
    blobs::digest_file,
    compact,
    folder::{Lake, names_in},
    history, lock, newest,
    published::{EVERY, FILES, REPORTS, TABLES},
    runs, sealed,
    stamp::Stamp,
    store::COLLECTING,
};

/// Something in the lake that is not as it was stored.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Fault {
    /// The file, below the lake, or a file outside.
    pub path: PathBuf,
    /// What is wrong with it.
    pub what: String,
    /// Whether the file is of no use to anybody, so that it can be dropped and made again.
    #[serde(skip)]
    pub can_drop: bool,
}

/// What was checked.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Verified {
    /// Number of files checked.
    pub n_files: usize,
    /// Bytes read.
    pub n_bytes: u64,
    /// What is wrong, ordered by path.
    pub faults: Vec<Fault>,
}

/// Told how many bytes of how many are read.
pub type OnBytes<'a> = dyn Fn(u64, u64) + Sync + 'a;

impl Lake {
    /// Checks everything that lies in the lake.
    ///
    /// # Errors
    ///
    /// Fails if a folder cannot be read; a file that cannot is a fault.
    pub fn verify(&self, on_bytes: &OnBytes) -> Result<Verified, LakeError> {
        let mut verifier = Verifier {
            lake: self,
            verified: Verified::default(),
            inodes: HashMap::new(),
        };
        verifier.blobs(on_bytes)?;
        verifier.records()?;
        verifier.lists_of_units()?;
        verifier.runs()?;
        verifier.sealed_in("tags")?;
        verifier.newest()?;
        verifier.sealed(Path::new("sources.json"));
        for folder in [TABLES, FILES, REPORTS, EVERY] {
            verifier.shown(Path::new(folder))?;
        }
        verifier.verified.faults.sort();
        Ok(verifier.verified)
    }

    /// Checks the files outside the lake that look as they did when they were read: finds those that
    /// were changed behind an unchanged size, time and inode, and forgets what was remembered of
    /// them, so that the next run sees the change.
    ///
    /// # Errors
    ///
    /// Fails if the lake cannot be written; a file that cannot be read is a fault.
    pub fn verify_inputs(&self, on_bytes: &OnBytes) -> Result<Verified, LakeError> {
        let entries: Vec<(PathBuf, Stamp, Digest)> = {
            let known = self.sources().known();
            let entries = known.entries.iter();
            let mut entries: Vec<_> = entries
                .map(|(path, entry)| (PathBuf::from(path), entry.stamp, entry.digest))
                .collect();
            entries.sort_by(|a, b| a.0.cmp(&b.0));
            entries
        };
        // What looks different is read by the next run anyway, and what is gone is missed by it.
        let unchanged: Vec<(PathBuf, Digest)> = entries
            .into_iter()
            .filter(|(path, stamp, _)| Stamp::read(path).is_ok_and(|now| now == *stamp))
            .map(|(path, _, digest)| (path, digest))
            .collect();
        let verified = check_digests(&unchanged, on_bytes, |path| Fault {
            path: path.to_owned(),
            what: "changed since it was read, behind an unchanged size, time and inode".to_owned(),
            can_drop: false,
        });
        for fault in &verified.faults {
            self.sources().forget(&fault.path.to_string_lossy());
        }
        if !verified.faults.is_empty() {
            self.prepare()?;
            self.sources().save(&self.staging(), &self.locks())?;
        }
        Ok(verified)
    }

    /// Removes damaged files, so that the next run that needs them makes them again, and shows the
    /// tables of runs again. Everything is checked once more while nobody keeps a unit: what was
    /// mended meanwhile stays. Returns the number of files removed.
    ///
    /// # Errors
    ///
    /// Fails if a file cannot be removed.
    pub fn drop_damaged(&self, on_bytes: &OnBytes) -> Result<usize, LakeError> {
        self.prepare()?;
        let _alone = lock::exclude(&self.locks(), COLLECTING)?;
        let faults = self.verify(on_bytes)?.faults;
        let droppable = faults.iter().filter(|fault| fault.can_drop);
        let mut n_dropped = 0;
        for fault in droppable {
            crate::atomic::remove_if_there(&self.root().join(&fault.path))?;
            n_dropped += 1;
        }
        history::mend(self)?;
        Ok(n_dropped)
    }
}

struct Verifier<'a> {
    lake: &'a Lake,
    verified: Verified,
    /// The blobs that are there, by device and inode.
    inodes: HashMap<(u64, u64), Digest>,
}

impl Verifier<'_> {
    fn fault(&mut self, path: &Path, what: impl Into<String>) {
        let root = self.lake.root();
        self.verified.faults.push(Fault {
            path: path.strip_prefix(root).unwrap_or(path).to_owned(),
            what: what.into(),
            can_drop: true,
        });
    }

    fn blobs(&mut self, on_bytes: &OnBytes) -> Result<(), LakeError> {
        let mut files = Vec::new();
        let folder = self.lake.blobs().root().to_owned();
        for path in files_below(&folder)? {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            match name.parse::<Digest>() {
                Ok(digest) => {
                    if let Ok(metadata) = fs::metadata(&path) {
                        let inode = (metadata.dev(), metadata.ino());
                        self.inodes.insert(inode, digest);
                    }
                    files.push((path, digest));
                }
                Err(_) => self.fault(&path, "does not belong here: its name is no digest"),
            }
        }
        let root = self.lake.root();
        let mut checked = check_digests(&files, on_bytes, |path| Fault {
            path: path.strip_prefix(root).unwrap_or(path).to_owned(),
            what: "its bytes are not the ones that its name promises".to_owned(),
            can_drop: true,
        });
        self.verified.n_files += checked.n_files;
        self.verified.n_bytes += checked.n_bytes;
        self.verified.faults.append(&mut checked.faults);
        Ok(())
    }

    fn records(&mut self) -> Result<(), LakeError> {
        let records = self.lake.records();
        for path in files_below(&records.recipes())? {
            let recipe = self.sealed_as::<dataflow::Recipe>(&path);
            if recipe.is_some_and(|recipe| Some(recipe.digest()) != named_by(&path)) {
                self.fault(&path, "it is not the recipe that its name promises");
            }
        }
        for path in files_below(&records.folder())? {
            let Some(stored) = self.sealed_as::<crate::records::Stored>(&path) else {
                continue;
            };
            let fingerprint = stored.fingerprint;
            if named_by(&path) != Some(fingerprint) {
                self.fault(&path, "it is not the record that its name promises");
                continue;
            }
            let lacking = self.lacking(&stored.outcome);
            match records.whole(stored)? {
                None => self.fault(&path, "its recipe is missing or damaged"),
                Some(record) if record.fingerprint.digest() != fingerprint => {
                    self.fault(
                        &path,
                        "its fingerprint is not the one that its name promises",
                    );
                }
                Some(_) => {}
            }
            if let Some(lacking) = lacking {
                self.fault(&path, lacking);
            }
        }
        Ok(())
    }

    /// Says which file of a result is not in the lake.
    fn lacking(&self, outcome: &RecordOutcome) -> Option<String> {
        let RecordOutcome::Made { files, .. } = outcome else {
            return None;
        };
        files.iter().find_map(|(name, file)| {
            let path = self.lake.file(file);
            let is_there = fs::metadata(&path).is_ok_and(|blob| blob.len() == file.size);
            (!is_there).then(|| format!("its file `{name}` is missing or cut off"))
        })
    }

    fn lists_of_units(&mut self) -> Result<(), LakeError> {
        for path in files_below(&runs::manifests(self.lake.root()))? {
            self.verified.n_files += 1;
            match digest_file(&path) {
                Ok(digest) if Some(digest) == named_by(&path) => {}
                Ok(_) => self.fault(&path, "its bytes are not the ones that its name promises"),
                Err(err) => self.fault(&path, format!("cannot be read: {err}")),
            }
        }
        Ok(())
    }

    fn runs(&mut self) -> Result<(), LakeError> {
        let root = self.lake.root();
        for path in files_below(&runs::folder(root))? {
            let Some(run) = self.sealed_as::<runs::Run>(&path) else {
                continue;
            };
            if path != runs::path(root, run.number) {
                self.fault(&path, "it is not the run that its name promises");
            } else if runs::units(root, &run).is_err() {
                self.fault(&path, "the list of its units is missing or damaged");
            }
        }
        Ok(())
    }

    fn sealed_in(&mut self, folder: &str) -> Result<(), LakeError> {
        let folder = Path::new(folder);
        for name in names_in(&self.lake.root().join(folder))? {
            self.sealed(&folder.join(name));
        }
        Ok(())
    }

    fn newest(&mut self) -> Result<(), LakeError> {
        let folder = self.lake.root().join(newest::FOLDER);
        for name in names_in(&folder)? {
            let path = folder.join(name);
            self.verified.n_files += 1;
            let bytes = fs::read(&path).unwrap_or_default();
            self.verified.n_bytes += bytes.len() as u64;
            if compact::Reader::of(&bytes).is_none() {
                self.fault(&path, "its bytes are not the ones that were written");
            }
        }
        Ok(())
    }

    /// Checks a sealed file that may not be there.
    fn sealed(&mut self, path: &Path) {
        let path = self.lake.root().join(path);
        if path.exists() {
            let _value: Option<IgnoredAny> = self.sealed_as(&path);
        }
    }

    /// Reads a sealed file, or reports what is wrong with it.
    fn sealed_as<T: for<'de> Deserialize<'de>>(&mut self, path: &Path) -> Option<T> {
        self.verified.n_files += 1;
        let read = fs::metadata(path).map(|metadata| self.verified.n_bytes += metadata.len());
        let read = read.map_err(io_error("read", path));
        match read.and_then(|()| sealed::read(path)) {
            Ok(value) => value,
            Err(LakeError::Damaged { .. }) => {
                self.fault(path, "its bytes are not the ones that were written");
                None
            }
            Err(LakeError::Json { source, .. }) => {
                let what = format!("was written by another version of the program: {source}");
                self.fault(path, what);
                None
            }
            Err(err) => {
                self.fault(path, err.to_string());
                None
            }
        }
    }

    /// Checks what people see: the same files as blobs, or copies of them.
    fn shown(&mut self, folder: &Path) -> Result<(), LakeError> {
        let blobs: BTreeSet<Digest> = self.inodes.values().copied().collect();
        let faults = self.verified.faults.iter();
        let damaged: BTreeSet<Digest> = faults
            .filter(|fault| fault.path.starts_with("blobs"))
            .filter_map(|fault| named_by(&fault.path))
            .collect();
        for path in files_below(&self.lake.root().join(folder))? {
            self.verified.n_files += 1;
            let inode = fs::metadata(&path).map(|metadata| (metadata.dev(), metadata.ino()));
            if let Some(digest) = inode.ok().and_then(|inode| self.inodes.get(&inode)) {
                if damaged.contains(digest) {
                    self.fault(&path, "it shows damaged bytes");
                }
                continue;
            }
            match digest_file(&path) {
                // A run may show what it has made since the blobs were listed.
                Ok(digest)
                    if blobs.contains(&digest) || self.lake.blobs().path(&digest).exists() => {}
                Ok(_) => self.fault(&path, "it is not what a unit made"),
                Err(err) => self.fault(&path, format!("cannot be read: {err}")),
            }
        }
        Ok(())
    }
}

/// The digest that a file's name is.
fn named_by(path: &Path) -> Option<Digest> {
    path.file_stem()?.to_str()?.parse().ok()
}

/// Every file below a folder, ordered by path.
pub(crate) fn files_below(folder: &Path) -> Result<Vec<PathBuf>, LakeError> {
    let mut files = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        let entries = match fs::read_dir(&folder) {
            Err(err) if err.kind() == io::ErrorKind::NotFound => continue,
            entries => entries.map_err(io_error("read", &folder))?,
        };
        for entry in entries {
            let entry = entry.map_err(io_error("read", &folder))?;
            if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                folders.push(entry.path());
            } else {
                files.push(entry.path());
            }
        }
    }
    files.sort();
    Ok(files)
}

/// Reads files on all cores and reports those that have other digests.
fn check_digests(
    files: &[(PathBuf, Digest)],
    on_bytes: &OnBytes,
    fault: impl Fn(&Path) -> Fault + Sync,
) -> Verified {
    let sizes = files
        .iter()
        .map(|(path, _)| fs::metadata(path).map_or(0, |m| m.len()));
    let sizes: Vec<u64> = sizes.collect();
    let total = sizes.iter().sum();
    let (next, done) = (AtomicUsize::new(0), AtomicU64::new(0));
    let faults = Mutex::new(Vec::new());
    let work = || {
        loop {
            let idx = next.fetch_add(1, Ordering::Relaxed);
            let (Some((path, expected)), Some(size)) = (files.get(idx), sizes.get(idx)) else {
                return;
            };
            if !digest_file(path).is_ok_and(|digest| digest == *expected) {
                let mut faults = faults.lock().unwrap_or_else(PoisonError::into_inner);
                faults.push(fault(path));
            }
            on_bytes(done.fetch_add(*size, Ordering::Relaxed) + size, total);
        }
    };
    let n_threads = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..n_threads {
            scope.spawn(work);
        }
    });
    let mut faults = faults.into_inner().unwrap_or_else(PoisonError::into_inner);
    faults.sort();
    Verified {
        n_files: files.len(),
        n_bytes: total,
        faults,
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
        // No file system lets a test set back the time of change, so what is remembered is set.
        let remembered = Entry {
            stamp: Stamp::read(&input).unwrap(),
            digest: Digest::of_bytes(b"old bytes"),
        };
        let key = input.to_str().unwrap().to_owned();
        lake.sources().known().entries.insert(key, remembered);
        assert_eq!(lake.source_digest(&input).unwrap(), remembered.digest);

        let verified = lake.verify_inputs(&|_, _| {}).unwrap();
        let paths: Vec<&Path> = verified.faults.iter().map(|fault| &*fault.path).collect();
        assert_eq!(paths, [input.as_path()]);
        let now = Digest::of_bytes(b"new bytes");
        assert_eq!(lake.source_digest(&input).unwrap(), now);
        let again = lake.verify_inputs(&|_, _| {}).unwrap();
        assert_eq!(again.faults, []);
    }
}
