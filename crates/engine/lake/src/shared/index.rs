//! Index of a depot's records, built with few requests.
//!
//! The first records are asked for one by one. From then on the names of all are listed, and most
//! records come together: a run leaves those of all its units in one file.

use std::{
    collections::{BTreeMap, HashMap, HashSet},
    path::Path,
    sync::{Arc, Mutex},
    time::{Duration, Instant},
};

use ::clock::lock;
use dataflow::{Digest, OutputFingerprint, PipelineName, text_of};
use depot::DepotError;
use serde::{Deserialize, Serialize};

use super::{keys, remote::Remote};
use crate::{
    LakeError,
    records::{Records, Stored, parse_recipe},
    register::Run,
    sealed,
};

/// Records that are asked for one by one before the names of all are listed.
const N_SINGLE: usize = 2;

/// Runs of a pipeline of which the records are read, the newest.
const N_RUNS: usize = 8;

/// Age after which a list of names is refreshed for a name that is not in it; a list that took long
/// lives longer.
const FRESH: Duration = Duration::from_mins(1);
const FRESH_PER_TIME: u32 = 20;

/// A run as it is in a depot.
#[derive(Serialize, Deserialize)]
pub(crate) struct SharedRun {
    /// The pipeline.
    #[serde(deserialize_with = "text_of::<PipelineName, _>")]
    pub(crate) pipeline: String,
    /// The run, unless an earlier version of the program sent it. Its `made_now` are positions in
    /// `units`; it has no manifest and no tables.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) run: Option<Run>,
    /// The records of its units.
    pub(crate) units: Vec<Stored>,
    /// The recipes of its units.
    pub(crate) recipes: BTreeMap<Digest, OutputFingerprint>,
}

impl SharedRun {
    /// Parses a run from a file of a depot: it is one of the pipeline in the key, and the records of its
    /// units are those of the units that they name.
    ///
    /// # Errors
    ///
    /// Fails if it is damaged or not so.
    pub(crate) fn parse(key: &str, bytes: &[u8]) -> Result<Self, LakeError> {
        let path = Path::new(key);
        let shared: Self = sealed::parse_exact(path, bytes)?;
        let folder = keys::runs(&shared.pipeline);
        let is_of_key = path.parent() == Some(Path::new(&folder));
        let is_of_pipeline =
            |run: &Run| run.record.pipeline == shared.pipeline && run.has_known_tables();
        let recipes = shared.recipes.iter();
        let recipes: HashMap<Digest, Arc<OutputFingerprint>> = recipes
            .filter(|(digest, recipe)| recipe.digest() == **digest)
            .map(|(digest, recipe)| (*digest, Arc::new(recipe.clone())))
            .collect();
        let is_own = |stored: &Stored| {
            let recipe = recipes.get(&stored.recipe);
            recipe.is_some_and(|recipe| stored.is_of(recipe))
                || !shared.recipes.contains_key(&stored.recipe)
        };
        let is_sound = is_of_key
            && recipes.len() == shared.recipes.len()
            && shared.run.as_ref().is_none_or(is_of_pipeline)
            && shared.units.iter().all(is_own);
        is_sound
            .then_some(shared)
            .ok_or_else(|| LakeError::damaged(path))
    }
}

/// A record that was found, and its recipe.
pub(crate) type FoundRecord = (Arc<Stored>, Arc<OutputFingerprint>);

/// Index of a depot's records, as far as they are known.
#[derive(Default)]
pub(crate) struct Index(Mutex<IndexedRecords>);

#[derive(Default)]
struct IndexedRecords {
    /// The pipeline whose runs are read.
    pipeline: String,
    n_single: usize,
    names: Option<Names>,
    /// Keys of the runs that are not read yet, the newest last; `None` before they are listed.
    runs: Option<Vec<String>>,
    records: HashMap<Digest, Arc<Stored>>,
    recipes: HashMap<Digest, Arc<OutputFingerprint>>,
}

/// The names of all records at a time.
struct Names {
    digests: HashSet<Digest>,
    listed: Instant,
    took: Duration,
}

impl Names {
    fn is_fresh(&self) -> bool {
        ::clock::since(self.listed) < FRESH.max(self.took * FRESH_PER_TIME)
    }
}

impl Index {
    /// Begins to look for the units of a pipeline.
    pub(crate) fn enter(&self, pipeline: &str) {
        let mut known = lock(&self.0);
        if known.pipeline != pipeline {
            pipeline.clone_into(&mut known.pipeline);
            known.runs = None;
        }
    }

    /// Asks for a record, however lately the names of all were listed; returns whether it is there.
    ///
    /// # Errors
    ///
    /// Fails if the depot cannot be asked.
    pub(crate) fn expect(&self, remote: &Remote, fingerprint: &Digest) -> Result<bool, DepotError> {
        if lock(&self.0).records.contains_key(fingerprint) {
            return Ok(true);
        }
        let found = fetch(remote, fingerprint)?;
        let is_there = found.is_some();
        let found = found.map(|stored| (*fingerprint, stored));
        lock(&self.0).records.extend(found);
        Ok(is_there)
    }

    /// Drops a record that is stored here now: there may be very many.
    pub(crate) fn forget(&self, fingerprint: &Digest) {
        lock(&self.0).records.remove(fingerprint);
    }

    /// Lists the fingerprints of all records.
    ///
    /// # Errors
    ///
    /// Fails if the depot cannot be asked.
    pub(crate) fn fingerprints(remote: &Remote) -> Result<HashSet<Digest>, DepotError> {
        names(remote).map(|names| names.digests)
    }

    /// Returns the record of a fingerprint, if the depot has a whole one, and its recipe.
    pub(crate) fn record(
        &self,
        remote: &Remote,
        records: &Records,
        fingerprint: &Digest,
    ) -> Result<Option<FoundRecord>, LakeError> {
        let mut known = lock(&self.0);
        let Some(stored) = known.stored(remote, fingerprint)? else {
            return Ok(None);
        };
        let Some(recipe) = known.recipe(remote, records, &stored.recipe)? else {
            return Ok(None);
        };
        let is_own = stored.fingerprint == *fingerprint && stored.is_of(&recipe);
        Ok(is_own.then_some((stored, recipe)))
    }
}

impl IndexedRecords {
    fn stored(
        &mut self,
        remote: &Remote,
        fingerprint: &Digest,
    ) -> Result<Option<Arc<Stored>>, DepotError> {
        if let Some(stored) = self.records.get(fingerprint) {
            return Ok(Some(Arc::clone(stored)));
        }
        if self.names.is_none() && self.n_single < N_SINGLE {
            self.n_single += 1;
            return self.fetch(remote, fingerprint);
        }
        let is_named = |names: &Names| names.digests.contains(fingerprint);
        if !self
            .names
            .as_ref()
            .is_some_and(|names| is_named(names) || names.is_fresh())
        {
            self.names = Some(names(remote)?);
        }
        if !self.names.as_ref().is_some_and(is_named) {
            return Ok(None);
        }
        while self.read_run(remote)? {
            if let Some(stored) = self.records.get(fingerprint) {
                return Ok(Some(Arc::clone(stored)));
            }
        }
        self.fetch(remote, fingerprint)
    }

    fn fetch(
        &mut self,
        remote: &Remote,
        fingerprint: &Digest,
    ) -> Result<Option<Arc<Stored>>, DepotError> {
        let found = fetch(remote, fingerprint)?;
        if let Some(stored) = &found {
            self.records.insert(*fingerprint, Arc::clone(stored));
        }
        Ok(found)
    }

    /// Reads the records of one more run of the pipeline; returns whether there was one.
    fn read_run(&mut self, remote: &Remote) -> Result<bool, DepotError> {
        if self.runs.is_none() {
            let mut runs = remote.list(&keys::runs(&self.pipeline))?;
            runs.sort_by_key(|run| run.modified);
            let from = runs.len().saturating_sub(N_RUNS);
            let newest = runs.into_iter().skip(from).map(|run| run.key);
            self.runs = Some(newest.collect());
        }
        let Some(key) = self.runs.as_mut().and_then(Vec::pop) else {
            return Ok(false);
        };
        // One that is damaged or of another version has no records.
        let run = remote.parsed(&key, |bytes| SharedRun::parse(&key, bytes).ok())?;
        for stored in run.into_iter().flat_map(|run| {
            let recipes = run.recipes.into_iter();
            self.recipes
                .extend(recipes.map(|(digest, recipe)| (digest, Arc::new(recipe))));
            run.units
        }) {
            let record = self.records.entry(stored.fingerprint);
            record.or_insert_with(|| Arc::new(stored));
        }
        Ok(true)
    }

    fn recipe(
        &mut self,
        remote: &Remote,
        records: &Records,
        digest: &Digest,
    ) -> Result<Option<Arc<OutputFingerprint>>, LakeError> {
        if let Some(recipe) = self.recipes.get(digest) {
            return Ok(Some(Arc::clone(recipe)));
        }
        let mut recipe = records.recipe(digest)?;
        if recipe.is_none() {
            let key = keys::recipe(digest);
            recipe = remote.parsed(&key, |bytes| parse_recipe(Path::new(&key), bytes).ok())?;
        }
        let recipe = recipe.map(Arc::new);
        if let Some(recipe) = &recipe {
            self.recipes.insert(*digest, Arc::clone(recipe));
        }
        Ok(recipe)
    }
}

/// Returns the record of a unit, if the depot has a whole one.
fn fetch(remote: &Remote, fingerprint: &Digest) -> Result<Option<Arc<Stored>>, DepotError> {
    let key = keys::record(fingerprint);
    let stored: Option<Stored> = remote.parsed(&key, |bytes| {
        sealed::parse_exact(Path::new(&key), bytes).ok()
    })?;
    let stored = stored.filter(|stored| stored.fingerprint == *fingerprint);
    Ok(stored.map(Arc::new))
}

/// The names of all records in a depot.
fn names(remote: &Remote) -> Result<Names, DepotError> {
    let listed = ::clock::now();
    let entries = remote.list(keys::UNITS)?;
    let digests = entries
        .iter()
        .filter_map(|entry| keys::digest_of(&entry.key));
    Ok(Names {
        digests: digests.collect(),
        listed,
        took: ::clock::since(listed),
    })
}
