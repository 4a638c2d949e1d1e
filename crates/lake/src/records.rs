//! Records of units: what each depended on and gave, by its fingerprint's digest.

use std::{
    collections::BTreeMap,
    fs::File,
    path::{Path, PathBuf},
    sync::Arc,
};

use dataflow::{Digest, Fingerprint, Recipe, Record, RecordOutcome};
use serde::{Deserialize, Serialize};

use crate::{LakeError, clock::now, folder::Lake, sealed};

/// When, where and by what a unit was made: never part of an artifact.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// When its making began, in nanoseconds since 1970.
    pub started_ns: u64,
    /// How long it took, in seconds.
    pub took_s: f64,
    /// The program and its version.
    pub program: String,
    /// The machine's name.
    pub host: String,
    /// Threads that the machine offered.
    pub threads: usize,
}

/// A record as it lies in the lake.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Stored {
    pub(crate) fingerprint: Digest,
    pub(crate) recipe: Digest,
    pub(crate) stage: String,
    partition: String,
    inputs: BTreeMap<String, BTreeMap<String, Digest>>,
    files: BTreeMap<String, Digest>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    facts: BTreeMap<String, String>,
    seed: u64,
    pub(crate) outcome: RecordOutcome,
    pub(crate) provenance: Provenance,
}

/// The folders of records and recipes.
pub(crate) struct Records {
    root: PathBuf,
}

impl Records {
    pub(crate) fn new(root: &Path) -> Self {
        Self {
            root: root.to_owned(),
        }
    }

    /// The folder of records.
    pub(crate) fn folder(&self) -> PathBuf {
        self.root.join("units")
    }

    /// The folder of recipes.
    pub(crate) fn recipes(&self) -> PathBuf {
        self.root.join("recipes")
    }

    /// Where a record lies.
    pub(crate) fn path(&self, fingerprint: &Digest) -> PathBuf {
        let name = fingerprint.to_hex();
        let folder = self.folder().join(name.get(..2).unwrap_or_default());
        folder.join(format!("{name}.json"))
    }

    fn recipe_path(&self, digest: &Digest) -> PathBuf {
        self.recipes().join(format!("{digest}.json"))
    }

    /// Keeps a record and the recipe that it shares with others.
    pub(crate) fn keep(
        &self,
        lake: &Lake,
        record: &Record,
        provenance: Provenance,
    ) -> Result<(), LakeError> {
        let fingerprint = &record.fingerprint;
        let recipe = fingerprint.recipe.digest();
        let path = self.recipe_path(&recipe);
        if !matches!(sealed::read::<Recipe>(&path), Ok(Some(_))) {
            sealed::write(&lake.staging(), &path, fingerprint.recipe.as_ref())?;
        }
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
        sealed::write(&lake.staging(), &path, &stored)
    }

    /// Reads the record of a fingerprint; a damaged one is as good as none: the unit is made again.
    pub(crate) fn read(&self, fingerprint: &Digest) -> Result<Option<Stored>, LakeError> {
        let stored: Option<Stored> = sealed::read_if_whole(&self.path(fingerprint))?;
        Ok(stored.filter(|stored| stored.fingerprint == *fingerprint))
    }

    /// Puts a record and its recipe together; `None` if the recipe is lost.
    pub(crate) fn whole(&self, stored: Stored) -> Result<Option<Record>, LakeError> {
        let recipe: Option<Recipe> = sealed::read_if_whole(&self.recipe_path(&stored.recipe))?;
        let Some(recipe) = recipe.filter(|recipe| recipe.digest() == stored.recipe) else {
            return Ok(None);
        };
        Ok(Some(Record {
            fingerprint: Fingerprint {
                recipe: Arc::new(recipe),
                stage: stored.stage,
                partition: stored.partition,
                inputs: stored.inputs,
                files: stored.files,
                facts: stored.facts,
                seed: stored.seed,
            },
            outcome: stored.outcome,
        }))
    }

    /// The artifact that a record's unit makes; `None` if its recipe is lost.
    pub(crate) fn output(&self, stored: &Stored) -> Result<Option<String>, LakeError> {
        let recipe: Option<Recipe> = sealed::read_if_whole(&self.recipe_path(&stored.recipe))?;
        Ok(recipe.map(|recipe| recipe.output))
    }

    /// Notes that a record is in use, so that nobody collects it.
    pub(crate) fn mark_used(&self, fingerprint: &Digest) {
        // A lake that cannot be written is not collected either.
        let _marked = File::open(self.path(fingerprint)).and_then(|file| file.set_modified(now()));
    }
}
