//! Records of units: fingerprint and outcome, by the fingerprint's digest.

use std::{
    collections::{BTreeMap, HashSet},
    fs::File,
    io::Write,
    path::{Path, PathBuf},
    sync::{Arc, Mutex},
};

use ::clock::lock;
use dataflow::{
    ArtifactName, Digest, Fingerprint, OutputFingerprint, PartitionKey, Record, RecordOutcome,
    StageName, Stamp,
};
use serde::{Deserialize, Serialize};

use crate::{
    LakeError, atomic,
    clock::now,
    folder::{Folder, digest_named, files_below},
    replicas, sealed,
    stamps::Stamps,
};

/// Provenance of a unit (time, machine, program): never part of an artifact.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// Start time, in nanoseconds since 1970.
    pub started_ns: u64,
    /// Duration, in seconds.
    pub took_s: f64,
    /// The program and its version.
    pub program: String,
    /// The machine's name.
    pub host: String,
    /// Threads that the machine offered.
    pub threads: usize,
}

/// A record as stored in the lake.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Stored {
    pub(crate) fingerprint: Digest,
    pub(crate) recipe: Digest,
    pub(crate) stage: StageName,
    pub(crate) partition: PartitionKey,
    inputs: BTreeMap<ArtifactName, BTreeMap<PartitionKey, Digest>>,
    files: BTreeMap<String, Digest>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    facts: BTreeMap<String, String>,
    seed: u64,
    pub(crate) outcome: RecordOutcome,
    pub(crate) provenance: Provenance,
}

impl Stored {
    /// Whether it is the record of the unit that it names, which other lakes may use: its fingerprint
    /// is that of its own fields and of this recipe.
    pub(crate) fn is_of(&self, recipe: &Arc<OutputFingerprint>) -> bool {
        let whole = self.clone().fingerprint(Arc::clone(recipe));
        whole.digest() == self.fingerprint && !self.outcome.is_provisional()
    }

    /// Joins it with its recipe.
    pub(crate) fn fingerprint(self, recipe: Arc<OutputFingerprint>) -> Fingerprint {
        Fingerprint {
            recipe,
            stage: self.stage,
            partition: self.partition,
            inputs: self.inputs,
            files: self.files,
            facts: self.facts,
            seed: self.seed,
        }
    }
}

/// Parses a recipe from a file's bytes, if it matches the file's name.
pub(crate) fn parse_recipe(path: &Path, bytes: &[u8]) -> Result<OutputFingerprint, LakeError> {
    let recipe: OutputFingerprint = sealed::parse_exact(path, bytes)?;
    if digest_named(path) == Some(recipe.digest()) {
        Ok(recipe)
    } else {
        Err(LakeError::damaged(path))
    }
}

/// The folders of records and recipes.
pub(crate) struct Records {
    folder: Folder,
    /// Stamps of whole records.
    pub(crate) stamps: Stamps,
    /// Own digests of all records: without the inputs from other stages.
    own: Mutex<Option<HashSet<Digest>>>,
}

impl Records {
    pub(crate) fn new(folder: Folder) -> Self {
        Self {
            folder,
            stamps: Stamps::default(),
            own: Mutex::default(),
        }
    }

    /// Records the stamp of a record that was just written or verified.
    fn remember(&self, fingerprint: &Digest) {
        if let Ok(stamp) = Stamp::read(&self.path(fingerprint)) {
            self.stamps.learn(fingerprint, stamp);
        }
    }

    /// Whether a record exists with its recipe. It is read only if its stamp has changed since it
    /// was last verified.
    pub(crate) fn is_whole(&self, fingerprint: &Digest) -> Result<bool, LakeError> {
        let stamp = Stamp::read(&self.path(fingerprint)).ok();
        if stamp.is_some() && stamp == self.stamps.get(fingerprint) {
            return Ok(true);
        }
        let Some(stored) = self.read(fingerprint)? else {
            return Ok(false);
        };
        let is_whole = self.whole(stored)?.is_some();
        if is_whole {
            self.remember(fingerprint);
        }
        Ok(is_whole)
    }

    /// Path of a record.
    pub(crate) fn path(&self, fingerprint: &Digest) -> PathBuf {
        let name = fingerprint.to_hex();
        let folder = self.folder.units().join(name.get(..2).unwrap_or_default());
        folder.join(format!("{name}.json"))
    }

    fn recipe_path(&self, digest: &Digest) -> PathBuf {
        self.folder.recipes().join(format!("{digest}.json"))
    }

    /// Stores a record and its shared recipe.
    pub(crate) fn keep(&self, record: &Record, provenance: Provenance) -> Result<(), LakeError> {
        let fingerprint = &record.fingerprint;
        let recipe = fingerprint.recipe.digest();
        self.keep_recipe(&recipe, &fingerprint.recipe)?;
        let stored = Stored {
            fingerprint: fingerprint.digest(),
            recipe,
            stage: fingerprint.stage.clone(),
            partition: fingerprint.partition.clone(),
            inputs: fingerprint.inputs.clone(),
            files: fingerprint.files.clone(),
            facts: fingerprint.facts.clone(),
            seed: fingerprint.seed,
            outcome: record.outcome.clone(),
            provenance,
        };
        let path = self.path(&stored.fingerprint);
        sealed::write(&self.folder.staging(), &path, &stored)?;
        self.remember(&stored.fingerprint);
        Ok(())
    }

    fn keep_recipe(&self, digest: &Digest, recipe: &OutputFingerprint) -> Result<(), LakeError> {
        let path = self.recipe_path(digest);
        if self.recipe(digest)?.is_none() {
            let bytes = sealed::seal(&path, recipe)?;
            replicas::write(&self.folder, &path, &bytes)?;
        }
        Ok(())
    }

    /// Stores a record from elsewhere. It is not synced: a damaged one counts as missing and comes
    /// again.
    pub(crate) fn adopt(
        &self,
        stored: &Stored,
        recipe: &OutputFingerprint,
    ) -> Result<(), LakeError> {
        let path = self.path(&stored.fingerprint);
        if self.read(&stored.fingerprint)?.is_some() {
            return Ok(());
        }
        self.keep_recipe(&stored.recipe, recipe)?;
        let bytes = sealed::seal(&path, stored)?;
        atomic::place(&self.folder.staging(), &path, |beside| {
            let written = File::create_new(beside).and_then(|mut file| file.write_all(&bytes));
            written.map_err(atomic::io_error("write", &path))
        })?;
        self.remember(&stored.fingerprint);
        Ok(())
    }

    /// Reads the record of a fingerprint; a damaged one counts as missing: the unit is rebuilt.
    pub(crate) fn read(&self, fingerprint: &Digest) -> Result<Option<Stored>, LakeError> {
        let stored: Option<Stored> = sealed::read_if_whole(&self.path(fingerprint))?;
        Ok(stored.filter(|stored| stored.fingerprint == *fingerprint))
    }

    /// Reads a recipe; if it and its copy are damaged, it counts as missing.
    pub(crate) fn recipe(&self, digest: &Digest) -> Result<Option<OutputFingerprint>, LakeError> {
        match replicas::read(&self.folder, &self.recipe_path(digest), parse_recipe) {
            Err(LakeError::Damaged { .. } | LakeError::Json { .. }) => Ok(None),
            read => read,
        }
    }

    /// Joins a record with its recipe; `None` if the recipe is lost.
    pub(crate) fn whole(&self, stored: Stored) -> Result<Option<Record>, LakeError> {
        let Some(recipe) = self.recipe(&stored.recipe)? else {
            return Ok(None);
        };
        let outcome = stored.outcome.clone();
        Ok(Some(Record {
            fingerprint: stored.fingerprint(Arc::new(recipe)),
            outcome,
        }))
    }

    /// Whether there is a record of a unit that differs from this one only by its inputs from other
    /// stages. Reads all records, once, unless the recipe is new.
    pub(crate) fn may_hold(&self, unit: &Fingerprint) -> Result<bool, LakeError> {
        let recipe = unit.recipe.digest();
        if self.recipe(&recipe)?.is_none() {
            return Ok(false);
        }
        let mut own = lock(&self.own);
        let own = match own.take() {
            Some(known) => own.insert(known),
            None => own.insert(self.read_own(&unit.recipe)?),
        };
        Ok(own.contains(&unit.own_digest(&recipe)))
    }

    /// Invalidates the list of records, since others may have been added.
    pub(crate) fn invalidate(&self) {
        lock(&self.own).take();
    }

    fn read_own(&self, any: &Arc<OutputFingerprint>) -> Result<HashSet<Digest>, LakeError> {
        let mut own = HashSet::new();
        for path in files_below(&self.folder.units())? {
            let stored: Option<Stored> = sealed::read_if_whole(&path)?;
            if let Some(stored) = stored {
                let recipe = stored.recipe;
                // Only the given digest counts, not the recipe itself.
                own.insert(stored.fingerprint(Arc::clone(any)).own_digest(&recipe));
            }
        }
        Ok(own)
    }

    /// The artifact of a record's unit; `None` if its recipe is lost.
    pub(crate) fn output(&self, stored: &Stored) -> Result<Option<ArtifactName>, LakeError> {
        let recipe = self.recipe(&stored.recipe)?;
        Ok(recipe.map(|recipe| recipe.output))
    }

    /// Marks a record as used, so that it is not collected.
    pub(crate) fn mark_used(&self, fingerprint: &Digest) {
        // A read-only lake is not collected either.
        let _marked =
            atomic::open(&self.path(fingerprint)).and_then(|file| file.set_modified(now()));
    }
}
