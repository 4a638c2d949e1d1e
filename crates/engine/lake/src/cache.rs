//! The newest states of pipelines, cached by this process.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::{Arc, Mutex},
};

use ::clock::lock;
use dataflow::{Digest, RecordOutcome, Stamp, UnitRef};

use crate::{
    LakeError,
    blobs::Blobs,
    folder::{Folder, names_in},
    lock::Locks,
    newest::{self, Newest},
    records::Records,
    stamps::Stamps,
};

/// The newest states of the loaded pipelines.
pub(crate) struct Cache {
    folder: Folder,
    known: Mutex<BTreeMap<String, Newest>>,
}

impl Cache {
    pub(crate) fn new(folder: Folder) -> Self {
        Self {
            folder,
            known: Mutex::default(),
        }
    }

    /// Reads the newest state of a pipeline, with its stamps of records and blobs.
    pub(crate) fn enter(
        &self,
        pipeline: &str,
        records: &Stamps,
        blobs: &Stamps,
    ) -> Result<(), LakeError> {
        let mut read = Newest::read(&newest::path(&self.folder, pipeline))?;
        blobs.recall(std::mem::take(&mut read.stamps));
        records.recall(std::mem::take(&mut read.records));
        lock(&self.known).insert(pipeline.to_owned(), read);
        Ok(())
    }

    /// Applies a function to the newest state of a pipeline; it is empty until it is loaded.
    pub(crate) fn with<T>(&self, pipeline: &str, of: impl FnOnce(&mut Newest) -> T) -> T {
        of(lock(&self.known).entry(pipeline.to_owned()).or_default())
    }

    /// Returns the result of a unit that is or was newest in a loaded pipeline.
    pub(crate) fn outcome(&self, fingerprint: &Digest) -> Option<Arc<RecordOutcome>> {
        let known = lock(&self.known);
        let mut known = known.values();
        known.find_map(|newest| newest.outcome(fingerprint).cloned())
    }

    /// Returns the result of a unit that is safe from collection, because a pipeline's newest runs
    /// had it.
    pub(crate) fn current_outcome(&self, fingerprint: &Digest) -> Option<Arc<RecordOutcome>> {
        let known = lock(&self.known);
        let mut known = known.values();
        known.find_map(|newest| newest.current_outcome(fingerprint).cloned())
    }

    /// Saves the newest state of a pipeline, merged with what other processes saved meanwhile.
    pub(crate) fn keep(
        &self,
        pipeline: &str,
        units: Option<&[(UnitRef, Arc<RecordOutcome>)]>,
        (records, blobs): (&Records, &Blobs),
        locks: &Locks,
    ) -> Result<(), LakeError> {
        let touched = blobs.settle();
        let mut known = lock(&self.known);
        let newest = known.entry(pipeline.to_owned()).or_default();
        let path = newest::path(&self.folder, pipeline);
        let _turn = locks.lock_publication(pipeline)?;
        let mut there = Newest::read(&path)?;
        blobs.stamps.recall(std::mem::take(&mut there.stamps));
        records.stamps.recall(std::mem::take(&mut there.records));
        there.merge_published(newest);
        *newest = there;
        if let Some(units) = units {
            newest.merge_run(units);
        }
        for published in newest.published.values_mut() {
            for (path, file) in published.iter_mut() {
                if let Ok(stamp) = Stamp::read(&self.folder.join(path))
                    && (blobs.stamps.get(&file.digest) == Some(stamp)
                        || touched.contains(&file.digest)
                            && stamp.differs_by_links_alone(file.stamp))
                {
                    file.stamp = stamp;
                }
            }
        }
        newest.write(
            &self.folder,
            &path,
            |unit| records.stamps.get(unit),
            |blob| blobs.stamps.get(blob),
        )
    }

    /// Lists the units that the newest runs of all pipelines still have.
    pub(crate) fn all_current(&self) -> Result<BTreeSet<Digest>, LakeError> {
        let mut current = BTreeSet::new();
        for name in names_in(&self.folder.newest())? {
            let pipeline = newest::pipeline_of(&name);
            let units = Newest::read(&newest::path(&self.folder, pipeline))?.list();
            let units = units.into_iter().filter(|unit| unit.current);
            current.extend(units.map(|unit| unit.fingerprint));
        }
        Ok(current)
    }

    /// Removes collected units from the newest states of all pipelines.
    pub(crate) fn forget(&self, gone: &BTreeSet<Digest>, locks: &Locks) -> Result<(), LakeError> {
        for name in names_in(&self.folder.newest())? {
            let pipeline = newest::pipeline_of(&name);
            let _turn = locks.lock_publication(pipeline)?;
            let path = newest::path(&self.folder, pipeline);
            let mut newest = Newest::read(&path)?;
            let stamps: BTreeMap<_, _> = std::mem::take(&mut newest.stamps).into_iter().collect();
            let records: BTreeMap<_, _> = std::mem::take(&mut newest.records).into_iter().collect();
            newest.forget(|unit| gone.contains(unit));
            newest.write(
                &self.folder,
                &path,
                |unit| records.get(unit).copied(),
                |blob| stamps.get(blob).copied(),
            )?;
        }
        Ok(())
    }
}
