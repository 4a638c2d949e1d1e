//! Garbage collection in a depot.
//!
//! Kept are the units of the newest runs of every pipeline on every machine, and everything that is
//! younger than the grace period, by the depot's own clock: a unit that some machine is about to
//! refer to has blobs that were sent, or sent again, within a day.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
    time::{Duration, SystemTime},
};

use dataflow::{Digest, RecordOutcome};
use depot::{DepotError, Entry, Link, PutMode, WRITING};

use super::{Shared, index::SharedRun, keys};
use crate::{
    LakeError, atomic,
    records::{Records, Stored},
    sealed,
};

/// Age below which nothing is removed.
const GRACE: Duration = Duration::from_hours(7 * 24);

/// Files to remove from a depot.
#[derive(Debug, Default)]
pub(crate) struct Garbage {
    /// Keys, in an order in which nothing refers to what is gone already.
    pub(crate) keys: Vec<String>,
    /// Units by `stage.artifact`, each with the bytes of its files.
    pub(crate) units: Vec<(String, u64)>,
    pub(crate) n_blobs: usize,
    pub(crate) n_bytes: u64,
    pub(crate) n_leftovers: usize,
    pub(crate) n_kept: usize,
}

/// Digests to which kept units refer.
#[derive(Default)]
struct ReferencedKeys {
    units: BTreeSet<Digest>,
    recipes: BTreeSet<Digest>,
    blobs: BTreeSet<Digest>,
}

impl ReferencedKeys {
    fn add(&mut self, stored: &Stored) {
        self.units.insert(stored.fingerprint);
        self.recipes.insert(stored.recipe);
        self.blobs
            .extend(files(&stored.outcome).map(|(digest, _)| digest));
    }
}

impl Shared {
    /// Lists the unreferenced files; of each pipeline on each machine the newest `n_runs` are kept.
    pub(crate) fn garbage(&self, records: &Records, n_runs: usize) -> Result<Garbage, LakeError> {
        let link = self.remote.link()?;
        let before = oldest_kept(link)?;
        let is_old = |entry: &Entry| entry.modified < before;
        let mut kept = ReferencedKeys::default();
        let mut garbage = Garbage::default();
        let mut n_left: BTreeMap<(String, String), usize> = BTreeMap::new();
        let mut runs = link.list(keys::RUNS)?;
        // Names begin with the time at which the run started.
        runs.sort_by(|a, b| b.key.cmp(&a.key));
        for run in runs {
            let left = n_left.entry(series(&run.key)).or_insert(n_runs);
            if is_old(&run) && *left == 0 {
                garbage.keys.push(run.key);
                continue;
            }
            *left = left.saturating_sub(1);
            let shared: Option<SharedRun> = read(link, &run.key)?;
            for stored in shared.into_iter().flat_map(|shared| shared.units) {
                kept.add(&stored);
            }
        }
        for unit in link.list(keys::UNITS)? {
            let is_kept = keys::digest_of(&unit.key).is_some_and(|it| kept.units.contains(&it));
            if is_kept {
                garbage.n_kept += 1;
                continue;
            }
            let stored: Option<Stored> = read_if_whole(link, &unit.key)?;
            if !is_old(&unit) {
                garbage.n_kept += 1;
                if let Some(stored) = &stored {
                    kept.add(stored);
                }
                continue;
            }
            if let Some(stored) = stored {
                let name = match records.output(&stored)? {
                    Some(output) => format!("{}.{output}", stored.stage),
                    None => format!("{} of another machine", stored.stage),
                };
                let n_bytes = files(&stored.outcome).map(|(_, size)| size).sum();
                garbage.units.push((name, n_bytes));
            }
            garbage.keys.push(unit.key);
        }
        for (prefix, kept) in [(keys::RECIPES, &kept.recipes), (keys::BLOBS, &kept.blobs)] {
            for entry in link.list(prefix)? {
                let is_kept = keys::digest_of(&entry.key).is_some_and(|it| kept.contains(&it));
                if is_kept || !is_old(&entry) {
                    continue;
                }
                if prefix == keys::BLOBS {
                    garbage.n_blobs += 1;
                    garbage.n_bytes += entry.size;
                }
                garbage.keys.push(entry.key);
            }
        }
        for prefix in [keys::DIFFERING, WRITING, keys::MESSAGES, keys::LOGS] {
            let left = link.list(prefix)?.into_iter().filter(is_old);
            let n_before = garbage.keys.len();
            garbage.keys.extend(left.map(|entry| entry.key));
            garbage.n_leftovers += garbage.keys.len() - n_before;
        }
        Ok(garbage)
    }
}

/// The pipeline and the machine of a run, from its key `runs/PIPELINE/TIME-PID-TIME-MACHINE.json`.
fn series(key: &str) -> (String, String) {
    let (folder, name) = key.rsplit_once('/').unwrap_or_default();
    let machine = name.rsplit('-').next().unwrap_or_default();
    (folder.to_owned(), machine.to_owned())
}

/// The time before which unreferenced files are removed, by the depot's clock: that of a file stored
/// just now.
fn oldest_kept(link: &Link) -> Result<SystemTime, LakeError> {
    let key = format!("clock/{}", atomic::process_name());
    link.put_bytes(&key, b"", PutMode::Always)?;
    let stored = link.head(&key)?;
    link.remove(&key)?;
    let now = stored
        .ok_or_else(|| LakeError::damaged(Path::new(&key)))?
        .modified;
    Ok(now.checked_sub(GRACE).unwrap_or(SystemTime::UNIX_EPOCH))
}

fn files(outcome: &RecordOutcome) -> impl Iterator<Item = (Digest, u64)> {
    let files = outcome.files().into_iter().flatten();
    files.map(|(_, file)| (file.digest, file.size))
}

/// Reads a file that says what to keep; `None` if it was removed meanwhile.
fn read<T: serde::de::DeserializeOwned>(link: &Link, key: &str) -> Result<Option<T>, LakeError> {
    let bytes = link.read(key)?;
    bytes
        .map(|bytes| sealed::parse(Path::new(key), &bytes))
        .transpose()
}

/// Reads a file that only describes itself.
fn read_if_whole<T: serde::de::DeserializeOwned>(
    link: &Link,
    key: &str,
) -> Result<Option<T>, DepotError> {
    let bytes = link.read(key)?;
    Ok(bytes.and_then(|bytes| sealed::parse(Path::new(key), &bytes).ok()))
}
