//! Depot operations that a person starts: send, fetch, verify and remove.

use std::{
    collections::{BTreeMap, BTreeSet, HashSet},
    time::Duration,
};

use dataflow::{Digest, FileRef, NodeName, RunStatus};

use crate::{
    GcMode, GcReport, LakeError,
    digests::OnBytes,
    lake::Lake,
    published,
    shared::{Item, Shared, key_of, keys},
    verify::{Fault, VerificationReport},
};

/// Time without a limit.
const NO_LIMIT: Duration = Duration::from_hours(10 * 24);

/// Time for which a person waits for a depot that is down.
const LONGEST_DOWN: Duration = Duration::from_secs(30);

impl Lake {
    /// Sends every result that the depot lacks, of the lake's runs or left to be sent, and waits for it. Returns how many
    /// of them are still to be sent; what a run beside it makes meanwhile is that run's to send.
    ///
    /// # Errors
    ///
    /// Fails if the lake has no depot, or it or a record of the lake cannot be read.
    pub fn push(&self) -> Result<usize, LakeError> {
        let shared = self.depot()?;
        self.check_exists()?;
        self.prepare()?;
        let mut there = shared.fingerprints()?;
        let files = shared.list(keys::BLOBS)?.into_iter();
        let files: HashSet<(Digest, u64)> = files
            .filter_map(|entry| Some((keys::digest_of(&entry.key)?, entry.size)))
            .collect();
        let recipes = shared.list(keys::RECIPES)?.into_iter();
        let recipes: HashSet<Digest> = recipes
            .filter_map(|entry| keys::digest_of(&entry.key))
            .collect();
        let is_lost = |file: &FileRef| !files.contains(&(file.digest, file.size));
        let runs = shared.list(keys::RUNS)?.into_iter();
        let runs: HashSet<String> = runs.map(|entry| entry.key).collect();
        for number in self.register.ordered()? {
            let run = self.run(number)?;
            for unit in &run.record.units {
                let Some(stored) = self.records.read(&unit.fingerprint)? else {
                    continue;
                };
                let mut files = stored
                    .outcome
                    .files()
                    .into_iter()
                    .flat_map(BTreeMap::values);
                // What was left there and lost is not here either.
                let is_lost = files.any(|file| is_lost(file) && self.file(file).exists());
                if there.insert(unit.fingerprint) || is_lost || !recipes.contains(&stored.recipe) {
                    shared.send_unit(&unit.fingerprint)?;
                }
            }
            if run.record.status == RunStatus::Finished && !runs.contains(&key_of(&run)) {
                shared.send_run(number)?;
            }
        }
        // One without a record is being made.
        let mut asked = HashSet::new();
        for item in shared.outbox.list()? {
            if let Item::Unit(fingerprint) = item
                && self.records.is_whole(&fingerprint)?
            {
                asked.insert(item);
            }
        }
        shared.finish(NO_LIMIT, LONGEST_DOWN)?;
        let left = shared.outbox.list()?.into_iter();
        Ok(left.filter(|item| asked.contains(item)).count())
    }

    /// Fetches the files of the newest results that were left in the depot, of these outputs or of
    /// all, and shows them. Returns how many the depot no longer has.
    ///
    /// # Errors
    ///
    /// Fails if the lake has no depot, no run has made an output, a record of the lake cannot be read,
    /// or a file cannot be written.
    pub fn pull(&self, outputs: &[NodeName]) -> Result<usize, LakeError> {
        self.depot()?;
        self.check_exists()?;
        self.prepare()?;
        let mut wanted: BTreeSet<(Digest, u64)> = BTreeSet::new();
        let mut made: BTreeSet<NodeName> = BTreeSet::new();
        for fingerprint in self.newest_published_units()? {
            let Some(stored) = self.records.read(&fingerprint)? else {
                continue;
            };
            let stage = stored.stage.clone();
            let artifact = self.records.output(&stored)?;
            let output = artifact.map(|artifact| NodeName { stage, artifact });
            let is_asked = output
                .as_ref()
                .is_some_and(|output| outputs.contains(output));
            if outputs.is_empty() || is_asked {
                let files = stored
                    .outcome
                    .files()
                    .into_iter()
                    .flat_map(|files| files.values());
                wanted.extend(files.map(|file| (file.digest, file.size)));
            }
            made.extend(output);
        }
        if let Some(output) = outputs.iter().find(|output| !made.contains(output)) {
            return Err(LakeError::NeverMade {
                output: output.clone(),
                made: made.iter().map(ToString::to_string).collect(),
            });
        }
        let files = wanted.into_iter();
        let files = files.map(|(digest, size)| FileRef { digest, size });
        let files: Vec<FileRef> = files.collect();
        self.fetch_all(&files)?;
        let n_lost = files
            .iter()
            .filter(|file| !self.file(file).exists())
            .count();
        for pipeline in self.recorded_pipelines()? {
            let _turn = self.locks.lock_publication(&pipeline)?;
            for (path, blob) in self.promised_by(&pipeline)?.0 {
                let path = self.folder.join(path);
                if !path.exists() && self.blobs.path(&blob).exists() {
                    published::link_file(self, &blob, &path)?;
                }
            }
        }
        Ok(n_lost)
    }

    /// Stores a file in the depot, reads and removes it; returns whether the bytes read are the bytes stored.
    ///
    /// # Errors
    ///
    /// Fails if the lake has no depot, or it cannot be used.
    pub fn try_depot(&self) -> Result<bool, LakeError> {
        Ok(self.depot()?.try_out()?)
    }

    /// Checks every byte of the depot against what was stored, and that records have their files.
    ///
    /// # Errors
    ///
    /// Fails if the lake has no depot or it cannot be read.
    pub fn verify_depot(&self, on_bytes: &OnBytes) -> Result<VerificationReport, LakeError> {
        let (n_files, n_bytes, faults) = self.depot()?.check(on_bytes)?;
        let faults = faults.into_iter().map(|(path, what)| Fault {
            path,
            what,
            can_drop: true,
        });
        Ok(VerificationReport {
            n_files,
            n_bytes,
            faults: faults.collect(),
        })
    }

    /// Removes damaged files from the depot, so that they are made and sent again. Returns how many.
    ///
    /// # Errors
    ///
    /// Fails if the lake has no depot or it cannot be written.
    pub fn drop_damaged_in_depot(&self, faults: &[Fault]) -> Result<usize, LakeError> {
        for fault in faults {
            self.depot()?.remove(&fault.path)?;
        }
        Ok(faults.len())
    }

    /// Removes or counts the unreferenced files of the depot: of each pipeline on each machine,
    /// the newest `n_runs` are kept, and everything younger than a week.
    ///
    /// # Errors
    ///
    /// Fails if the lake has no depot, or it cannot be read or written.
    pub fn collect_depot(&self, n_runs: usize, collecting: GcMode) -> Result<GcReport, LakeError> {
        let shared = self.depot()?;
        let garbage = shared.garbage(&self.records, n_runs)?;
        let mut report = GcReport {
            n_blobs: garbage.n_blobs,
            n_bytes: garbage.n_bytes,
            n_leftovers: garbage.n_leftovers,
            n_kept: garbage.n_kept,
            ..GcReport::default()
        };
        for (output, n_bytes) in garbage.units {
            let of_output = report.units.entry(output).or_default();
            of_output.n_units += 1;
            of_output.n_bytes += n_bytes;
        }
        if collecting == GcMode::Remove {
            for key in &garbage.keys {
                shared.remove(key.as_ref())?;
            }
        }
        Ok(report)
    }

    pub(crate) fn depot(&self) -> Result<&Shared, LakeError> {
        self.shared.as_ref().ok_or(LakeError::NoDepot)
    }
}
