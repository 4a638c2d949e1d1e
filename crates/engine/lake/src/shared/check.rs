//! Verification of a depot: every byte against its stored digest.

use std::{
    collections::BTreeMap,
    panic::resume_unwind,
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex,
        atomic::{AtomicU64, AtomicUsize, Ordering},
    },
    thread,
};

use ::clock::lock;
use dataflow::{Digest, RecordOutcome};
use depot::{DepotError, Link, Piece, Put, PutMode};

use super::{Shared, index::SharedRun, keys};
use crate::{
    LakeError, atomic,
    digests::OnBytes,
    records::{Stored, parse_recipe},
    sealed,
};

/// Files read at once.
const AT_ONCE: usize = 8;

/// Content of the file by which a depot is tested.
const TRIED: &[u8] = b"tried";

const DAMAGED: &str = "its bytes are not the ones that were stored";

const MISPLACED: &str = "its name is not that of its content";

/// A fault in a depot: the key, and a description.
pub(crate) type KeyFault = (PathBuf, String);

impl Shared {
    /// Reads every file of the depot. Returns the number of files, their bytes, and the faults.
    pub(crate) fn check(
        &self,
        on_bytes: &OnBytes,
    ) -> Result<(usize, u64, Vec<KeyFault>), DepotError> {
        let link = self.remote.link()?;
        let mut entries = Vec::new();
        // A record comes after its files, so it is listed before them.
        let prefixes = [
            keys::RUNS,
            keys::DIFFERING,
            keys::UNITS,
            keys::RECIPES,
            keys::BLOBS,
        ];
        for prefix in prefixes {
            entries.extend(link.list(prefix)?);
        }
        let sizes = entries.iter().map(|entry| (entry.key.as_str(), entry.size));
        let checker = Checker {
            link,
            there: sizes.collect(),
            copies: Mutex::default(),
        };
        let total = entries.iter().map(|entry| entry.size).sum();
        let (next, done) = (AtomicUsize::new(0), AtomicU64::new(0));
        let faults = Mutex::new(Vec::new());
        let work = || {
            while let Some(entry) = entries.get(next.fetch_add(1, Ordering::Relaxed)) {
                if let Some(what) = checker.fault(&entry.key)? {
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
        faults.extend(checker.contradictions());
        faults.sort();
        faults.dedup_by(|(a, _), (b, _)| a == b);
        Ok((entries.len(), total, faults))
    }

    /// Stores a file in the depot, reads and removes it; returns whether the bytes read are the bytes stored.
    pub(crate) fn try_out(&self) -> Result<bool, DepotError> {
        let link = self.remote.to_write()?;
        let key = format!("doctor/{}", atomic::process_name());
        link.put_bytes(&key, TRIED, PutMode::IfAbsent)?;
        let read = link.read(&key)?;
        link.remove(&key)?;
        Ok(read.as_deref() == Some(TRIED))
    }

    /// Checks that a file which is there is not replaced where it is to be created: some object stores
    /// ignore the condition.
    pub(crate) fn check_creates(&self) -> Result<(), DepotError> {
        let link = self.remote.to_write()?;
        let key = format!("doctor/{}-twice", atomic::process_name());
        let create = || link.put_bytes(&key, TRIED, PutMode::IfAbsent);
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
        self.remote.link()?.remove(&key.to_string_lossy())
    }
}

/// The copies of a record in a depot, by unit and by when and where it was made.
type Copies = BTreeMap<(Digest, u64, String), BTreeMap<PathBuf, RecordOutcome>>;

/// The check of a depot's files: each by itself, and copies of a record against each other.
struct Checker<'a> {
    link: &'a Link,
    /// Sizes of the files that are there.
    there: BTreeMap<&'a str, u64>,
    copies: Mutex<Copies>,
}

impl Checker<'_> {
    /// Returns the fault of a file, if it has one.
    fn fault(&self, key: &str) -> Result<Option<String>, DepotError> {
        let path = Path::new(key);
        if key.starts_with(keys::BLOBS) {
            let mut hasher = blake3::Hasher::new();
            let is_there = self.link.get(key, &mut |piece| {
                match piece {
                    Piece::Begin => hasher.reset(),
                    Piece::Bytes(bytes) => hasher.update(bytes),
                };
                Ok(())
            })?;
            let digest = Digest::from(*hasher.finalize().as_bytes());
            let is_whole = key == keys::blob(&digest);
            return Ok((is_there && !is_whole).then(|| DAMAGED.to_owned()));
        }
        // It was removed meanwhile.
        let Some(bytes) = self.link.read(key)? else {
            return Ok(None);
        };
        let checked = if key.starts_with(keys::RECIPES) {
            parse_recipe(path, &bytes).map(|recipe| {
                let is_its_place = key == keys::recipe(&recipe.digest());
                (!is_its_place).then(|| MISPLACED.to_owned())
            })
        } else if key.starts_with(keys::RUNS) {
            SharedRun::parse(key, &bytes).map(|run| {
                run.units.iter().for_each(|stored| self.note(key, stored));
                None
            })
        } else {
            match sealed::parse_exact(path, &bytes) {
                Ok(stored) => Ok(self.fault_of_record(key, &stored)?),
                Err(err) => Err(err),
            }
        };
        Ok(match checked {
            Ok(fault) => fault,
            Err(LakeError::Json { source, .. }) => Some(format!("is no record: {source}")),
            Err(_) => Some(DAMAGED.to_owned()),
        })
    }

    /// Returns the fault of the record of a unit, if it has one.
    fn fault_of_record(&self, key: &str, stored: &Stored) -> Result<Option<String>, DepotError> {
        let is_its_place = if key.starts_with(keys::DIFFERING) {
            let folder = format!("{}/{}", keys::DIFFERING, stored.fingerprint);
            Path::new(key).parent() == Some(Path::new(&folder))
        } else {
            key == keys::record(&stored.fingerprint)
        };
        if !is_its_place {
            return Ok(Some(MISPLACED.to_owned()));
        }
        self.note(key, stored);
        for (name, file) in stored.outcome.files().into_iter().flatten() {
            match self.there.get(&*keys::blob(&file.digest)) {
                None => return Ok(Some(format!("its file `{name}` is not there"))),
                Some(size) if *size != file.size => {
                    return Ok(Some(format!(
                        "its file `{name}` has {size} bytes, and not the {} that it says",
                        file.size
                    )));
                }
                Some(_) => {}
            }
        }
        let key = keys::recipe(&stored.recipe);
        let Some(recipe) = self.link.read(&key)? else {
            return Ok(Some("its recipe is not there".to_owned()));
        };
        // A damaged recipe is a fault of its own.
        let Ok(recipe) = parse_recipe(Path::new(&key), &recipe) else {
            return Ok(None);
        };
        let is_own = stored.is_of(&Arc::new(recipe));
        Ok((!is_own).then(|| "it is not the record of the unit that it names".to_owned()))
    }

    fn note(&self, key: &str, stored: &Stored) {
        let made = &stored.provenance;
        let unit = (stored.fingerprint, made.started_ns, made.host.clone());
        let mut copies = lock(&self.copies);
        let of_unit = copies.entry(unit).or_default();
        of_unit.insert(PathBuf::from(key), stored.outcome.clone());
    }

    /// The faults of copies of one record that say different things.
    fn contradictions(&self) -> Vec<KeyFault> {
        let copies = lock(&self.copies);
        let differ = copies.values().filter(|copies| {
            let mut outcomes = copies.values();
            let first = outcomes.next();
            outcomes.any(|outcome| Some(outcome) != first)
        });
        let keys = differ.flat_map(BTreeMap::keys);
        let what = "it and another file of the depot say different things of one unit";
        keys.map(|key| (key.clone(), what.to_owned())).collect()
    }
}
