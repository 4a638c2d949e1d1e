//! Verification of a depot: every byte against its stored digest.

use std::{
    collections::BTreeSet,
    panic::resume_unwind,
    path::{Path, PathBuf},
    sync::{
        Mutex,
        atomic::{AtomicU64, AtomicUsize, Ordering},
    },
    thread,
};

use dataflow::Digest;
use depot::{Content, DepotError, Entry, Link, Put, PutMode};

use super::{Shared, index::SharedRun, keys};
use crate::{
    atomic,
    digests::OnBytes,
    mutex::lock,
    records::{Stored, parse_recipe},
    sealed,
};

/// Files read at once.
const AT_ONCE: usize = 8;

/// Content of the file by which a depot is tested.
const TRIED: &[u8] = b"tried";

/// A fault in a depot: the key, and a description.
pub(crate) type KeyFault = (PathBuf, String);

impl Shared {
    /// Reads every file of the depot. Returns the number of files, their bytes, and the faults.
    pub(crate) fn check(
        &self,
        on_bytes: &OnBytes,
    ) -> Result<(usize, u64, Vec<KeyFault>), DepotError> {
        let link = self.remote.link();
        let mut entries = Vec::new();
        // A record comes after its files, so it is listed before them.
        for prefix in [keys::RUNS, keys::UNITS, keys::RECIPES, keys::BLOBS] {
            entries.extend(link.list(prefix)?);
        }
        let there: BTreeSet<&str> = entries.iter().map(|entry| entry.key.as_str()).collect();
        let total = entries.iter().map(|entry| entry.size).sum();
        let (next, done) = (AtomicUsize::new(0), AtomicU64::new(0));
        let faults = Mutex::new(Vec::new());
        let work = || {
            while let Some(entry) = entries.get(next.fetch_add(1, Ordering::Relaxed)) {
                if let Some(what) = fault(link, entry, &there)? {
                    lock(&faults).push((PathBuf::from(&entry.key), what));
                }
                on_bytes(
                    done.fetch_add(entry.size, Ordering::Relaxed) + entry.size,
                    total,
                );
            }
            Ok::<_, DepotError>(())
        };
        thread::scope(|scope| {
            let workers: Vec<_> = (0..AT_ONCE).map(|_| scope.spawn(work)).collect();
            workers
                .into_iter()
                .try_for_each(|worker| worker.join().unwrap_or_else(|panic| resume_unwind(panic)))
        })?;
        let mut faults = std::mem::take(&mut *lock(&faults));
        faults.sort();
        Ok((entries.len(), total, faults))
    }

    /// Stores a file in the depot, reads and removes it; returns whether the bytes read are the bytes stored.
    pub(crate) fn try_out(&self) -> Result<bool, DepotError> {
        let link = self.remote.to_write()?;
        let key = format!("doctor/{}", atomic::process_name());
        let content = || Content::of_bytes(TRIED.to_vec());
        link.put(&key, content(), PutMode::IfAbsent)?;
        let read = link.read(&key)?;
        link.remove(&key)?;
        Ok(read.as_deref() == Some(TRIED))
    }

    /// Checks that a file which is there is not replaced where it is to be created: some object stores
    /// ignore the condition.
    pub(crate) fn check_creates(&self) -> Result<(), DepotError> {
        let link = self.remote.to_write()?;
        let key = format!("doctor/{}-twice", atomic::process_name());
        let create = || {
            let content = Content::of_bytes(TRIED.to_vec());
            link.put(&key, content, PutMode::IfAbsent)
        };
        create()?;
        let again = create()?;
        link.remove(&key)?;
        match again {
            Put::There => Ok(()),
            Put::New => Err(DepotError::Unreliable {
                why: "it replaces files that are there, so that no claim would hold".to_owned(),
            }),
        }
    }

    /// Removes a file from the depot.
    pub(crate) fn remove(&self, key: &Path) -> Result<(), DepotError> {
        self.remote.link().remove(&key.to_string_lossy())
    }
}

/// Returns the fault of a file of a depot, if it has one.
fn fault(link: &Link, entry: &Entry, there: &BTreeSet<&str>) -> Result<Option<String>, DepotError> {
    let key = entry.key.as_str();
    let path = Path::new(key);
    let damaged = || {
        Ok(Some(
            "its bytes are not the ones that were stored".to_owned(),
        ))
    };
    if key.starts_with(keys::BLOBS) {
        let mut hasher = blake3::Hasher::new();
        let is_there = link.get(key, &mut |piece| {
            hasher.update(piece);
            Ok(())
        })?;
        let digest = Digest::from(*hasher.finalize().as_bytes());
        return match keys::digest_of(key) {
            Some(named) if named == digest || !is_there => Ok(None),
            _ => damaged(),
        };
    }
    // It was removed meanwhile.
    let Some(bytes) = link.read(key)? else {
        return Ok(None);
    };
    if key.starts_with(keys::RECIPES) {
        return parse_recipe(path, &bytes).map_or_else(|_| damaged(), |_| Ok(None));
    }
    if key.starts_with(keys::RUNS) {
        let run = sealed::parse::<SharedRun>(path, &bytes);
        return run.map_or_else(|_| damaged(), |_| Ok(None));
    }
    let Ok(stored) = sealed::parse::<Stored>(path, &bytes) else {
        return damaged();
    };
    if keys::digest_of(key) != Some(stored.fingerprint) {
        return damaged();
    }
    let files = stored.outcome.files().into_iter().flatten();
    let lacking = files
        .filter(|(_, file)| !there.contains(keys::blob(&file.digest).as_str()))
        .map(|(name, _)| format!("its file `{name}` is not there"));
    let recipe = (!there.contains(keys::recipe(&stored.recipe).as_str()))
        .then(|| "its recipe is not there".to_owned());
    Ok(lacking.chain(recipe).next())
}
