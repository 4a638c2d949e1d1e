//! The lake as the store that a run needs.

use std::{
    collections::BTreeMap,
    io,
    path::{Path, PathBuf},
    sync::Arc,
};

use dataflow::{
    Advised, Digest, FileRef, Fingerprint, Making, NewestUnit, Node, NodeName, Record,
    RecordOutcome, RunRecord, Showing, Store, UnitRef,
};

use crate::{
    Collecting, LakeError, again, changing,
    folder::Lake,
    history, lock,
    making::UnitInTheMaking,
    mend,
    newest::{self, Newest},
    published, runs,
};

/// Lock under which records are taken into use, and collected.
pub(crate) const COLLECTING: &str = "collecting";

impl Lake {
    /// Whether every file of a result is there, unchanged.
    fn is_whole(&self, outcome: &RecordOutcome) -> Result<bool, LakeError> {
        let RecordOutcome::Made { files, .. } = outcome else {
            return Ok(true);
        };
        for file in files.values() {
            if !self.blobs().is_unchanged(file)? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Returns the result that a record holds.
    fn recall_old(&self, fingerprint: &Digest) -> Result<Option<Arc<RecordOutcome>>, LakeError> {
        let stored = self.records().read(fingerprint)?;
        Ok(stored.map(|stored| Arc::new(stored.outcome)))
    }

    /// Returns the result of a unit that is or was newest in a pipeline that was entered.
    fn newest_outcome(&self, fingerprint: &Digest) -> Option<Arc<RecordOutcome>> {
        let newest = self.newest();
        let mut known = newest.values();
        known.find_map(|newest| newest.outcome(fingerprint).cloned())
    }

    /// Returns the result of a unit that nobody collects, because a pipeline's newest runs had it.
    fn current_outcome(&self, fingerprint: &Digest) -> Option<Arc<RecordOutcome>> {
        let newest = self.newest();
        let mut known = newest.values();
        known.find_map(|newest| newest.current_outcome(fingerprint).cloned())
    }

    /// Takes an old record into use: whoever collects what is not used leaves it.
    fn use_old(&self, fingerprint: &Digest) {
        // A lake that cannot be written is not collected either.
        if let Ok(_shared) = lock::share(&self.locks(), COLLECTING) {
            self.records().mark_used(fingerprint);
        }
    }

    /// What was learned by reading is a convenience: a lake that cannot be written to is no fault of a
    /// run that makes nothing.
    fn unless_read_only(
        units: Option<&[(UnitRef, Arc<RecordOutcome>)]>,
        kept: Result<(), LakeError>,
    ) -> Result<(), LakeError> {
        use io::ErrorKind::{PermissionDenied, ReadOnlyFilesystem};
        match kept {
            Err(LakeError::Io { source, .. })
                if units.is_none()
                    && matches!(source.kind(), PermissionDenied | ReadOnlyFilesystem) =>
            {
                Ok(())
            }
            kept => kept,
        }
    }

    /// Returns a whole result: one of the newest runs', or an older one, which is taken into use.
    fn find(&self, fingerprint: &Digest) -> Result<Option<Arc<RecordOutcome>>, LakeError> {
        if let Some(outcome) = self.current_outcome(fingerprint)
            && self.records().is_whole(fingerprint)?
            && self.is_whole(&outcome)?
        {
            return Ok(Some(outcome));
        }
        if !self.records().path(fingerprint).exists() {
            return Ok(None);
        }
        self.use_old(fingerprint);
        let Some(outcome) = self.recall_old(fingerprint)? else {
            return Ok(None);
        };
        Ok(self.is_whole(&outcome)?.then_some(outcome))
    }
}

impl Store for Lake {
    fn enter(&self, pipeline: &str) -> Result<(), Advised> {
        self.records().look_again();
        let mut read = Newest::read(&newest::path(self.root(), pipeline))?;
        self.blobs().recall(std::mem::take(&mut read.stamps));
        self.records().recall(std::mem::take(&mut read.records));
        self.changing().enter(pipeline);
        self.newest().insert(pipeline.to_owned(), read);
        Ok(())
    }

    fn lookup(&self, fingerprint: &Digest) -> Result<Option<Arc<RecordOutcome>>, Advised> {
        Ok(self.find(fingerprint)?)
    }

    fn recall(&self, fingerprint: &Digest) -> Result<Option<Arc<RecordOutcome>>, Advised> {
        // The record comes first: what is remembered of the newest state may be older.
        match self.recall_old(fingerprint)? {
            Some(outcome) => Ok(Some(outcome)),
            None => Ok(self.newest_outcome(fingerprint)),
        }
    }

    fn remembered(&self, fingerprint: &Digest) -> Result<Option<Record>, Advised> {
        Ok(self.record(fingerprint)?)
    }

    fn may_hold(&self, unit: &Fingerprint) -> Result<bool, Advised> {
        Ok(self.records().may_hold(unit)?)
    }

    fn newest_units(&self, pipeline: &str) -> Result<Vec<NewestUnit>, Advised> {
        let newest = self.newest();
        Ok(newest.get(pipeline).map(Newest::list).unwrap_or_default())
    }

    fn source_digest(&self, path: &Path) -> Result<Digest, io::Error> {
        self.sources().digest(path)
    }

    fn begin(
        &self,
        fingerprint: &Digest,
        unit: &str,
        waiting: &dyn Fn(&str),
    ) -> Result<Box<dyn Making + '_>, Advised> {
        self.prepare()?;
        Ok(Box::new(UnitInTheMaking::begin(
            self,
            fingerprint,
            unit,
            waiting,
        )?))
    }

    fn open(
        &self,
        files: &BTreeMap<String, FileRef>,
    ) -> Result<Option<BTreeMap<String, PathBuf>>, Advised> {
        let mut paths = BTreeMap::new();
        let mut is_whole = true;
        for (name, file) in files {
            if self.blobs().is_whole(file)? {
                paths.insert(name.clone(), self.blobs().path(&file.digest));
            } else {
                self.blobs().drop(file)?;
                is_whole = false;
            }
        }
        Ok(is_whole.then_some(paths))
    }

    fn publish(&self, pipeline: &str, node: &Node, made: &[Showing]) -> Result<(), Advised> {
        let _landing = self.flight().land();
        let before = {
            let newest = self.newest();
            let newest = newest.get(pipeline);
            newest.and_then(|newest| newest.shown(&node.name).cloned())
        };
        let shown = published::publish(self, pipeline, node, made, before.as_ref());
        let shown = self.changing().note(pipeline, Some(&node.name), shown)?;
        if let Some(shown) = shown {
            let mut newest = self.newest();
            let newest = newest.entry(pipeline.to_owned()).or_default();
            newest.show(&node.name, shown);
        }
        Ok(())
    }

    fn retire(&self, pipeline: &str, kept: &[Node]) -> Result<(), Advised> {
        let _landing = self.flight().land();
        let is_kept = |name: &NodeName| kept.iter().any(|node| node.name == *name);
        let mut newest = self.newest();
        let newest = newest.entry(pipeline.to_owned()).or_default();
        let shown = newest.all_shown().iter();
        let old = shown.filter(|(node, _)| !is_kept(node));
        let old = old.flat_map(|(_, shown)| shown.clone()).collect();
        let retired = published::retire(self, pipeline, &is_kept, &old);
        self.changing().note(pipeline, None, retired)?;
        let names = kept.iter().map(|node| &node.name);
        self.changing().has(pipeline, names);
        newest.retire(is_kept);
        Ok(())
    }

    fn begin_run(&self, run: &RunRecord) -> Result<u64, Advised> {
        let _landing = self.flight().land();
        self.prepare()?;
        self.collect_staging(Collecting::Remove)?;
        let run = runs::begin(self, run)?;
        let number = run.number;
        *self.current_run() = Some(run);
        Ok(number)
    }

    fn keep_progress(&self, number: u64, record: &RunRecord) -> Result<(), Advised> {
        let _landing = self.flight().land();
        let mut current = self.current_run();
        if let Some(run) = current.as_mut().filter(|run| run.number == number) {
            runs::keep_progress(self, run, record.clone())?;
        }
        Ok(())
    }

    fn end_run(
        &self,
        number: u64,
        record: &RunRecord,
        units: &[(UnitRef, Arc<RecordOutcome>)],
    ) -> Result<(), Advised> {
        let _landing = self.flight().land();
        let run = self.current_run().take();
        let run = match run.filter(|run| run.number == number) {
            Some(run) => run,
            None => runs::read(self.root(), number)?,
        };
        let history = history::keep(self, &run, record, units)?;
        runs::end(self, run, record.clone(), history)?;
        changing::unmark(self, &record.pipeline)?;
        Ok(mend::mend(self)?)
    }

    fn find_run(&self, run: &RunRecord) -> Result<Option<u64>, Advised> {
        let _landing = self.flight().land();
        Ok(again::find(self, run)?)
    }

    fn settle(
        &self,
        pipeline: &str,
        units: Option<&[(UnitRef, Arc<RecordOutcome>)]>,
    ) -> Result<(), Advised> {
        let _landing = self.flight().land();
        let is_changed = self.newest().get(pipeline).is_some_and(Newest::is_changed);
        if units.is_some() || is_changed || self.blobs().learned() || self.records().learned() {
            Self::unless_read_only(units, self.keep_newest(pipeline, units))?;
        }
        // What a run is about to record is not all there yet.
        if self.current_run().is_none() {
            let mended = self
                .collect_staging(Collecting::Remove)
                .and_then(|_| changing::unmark(self, pipeline))
                .and_then(|()| mend::mend(self));
            Self::unless_read_only(units, mended)?;
        }
        match self.sources().save(&self.staging(), &self.locks()) {
            Err(_) if units.is_none() => Ok(()),
            saved => Ok(saved?),
        }
    }
}
