//! The lake's implementation of [`Store`].

use std::{
    collections::BTreeMap,
    io,
    path::{Path, PathBuf},
    sync::Arc,
};

use dataflow::{
    BoxedDiagnostic, Digest, FileName, FileRef, Fingerprint, NewestUnit, Node, NodeName,
    PublishedUnit, Record, RecordOutcome, RunRecord, RunStatus, Stamp, Store, Turn, UnitName,
    UnitRef, UnitTransaction,
};

use crate::{
    GcMode, LakeError, folder::is_published, history, lake::Lake, newest::Newest, published,
    repair, repeated_runs::RepeatedRun, shared::Shared, staging::UnitInProgress,
};

impl Lake {
    /// Whether every file of a result exists, unchanged, or was left in the depot.
    fn is_whole(&self, outcome: &RecordOutcome) -> Result<bool, LakeError> {
        let shared = self.shared.as_ref();
        for file in outcome.files().into_iter().flat_map(BTreeMap::values) {
            if !self.blobs.is_unchanged(file)?
                && !shared.is_some_and(|shared| shared.can_fetch(&file.digest))
            {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Returns the result that a record holds.
    fn recall_old(&self, fingerprint: &Digest) -> Result<Option<Arc<RecordOutcome>>, LakeError> {
        let stored = self.records.read(fingerprint)?;
        Ok(stored.map(|stored| Arc::new(stored.outcome)))
    }

    /// Marks an old record as used, so that it is not collected.
    fn use_old(&self, fingerprint: &Digest) {
        // A read-only lake is not collected either.
        if let Ok(_shared) = self.locks.block_collection() {
            // What is marked stays as long as this process is known to live.
            let _alive = self.locks.enter();
            self.records.mark_used(fingerprint);
        }
    }

    /// Lets the run of this number count as the newest.
    fn repeat(&self, pipeline: &str, again: RepeatedRun) -> Result<(), LakeError> {
        self.prepare()?;
        // Until it is settled the views are those of another run.
        self.changing.mark(pipeline)?;
        self.register.keep_repeated(again, &self.locks)?;
        if let Some(shared) = &self.shared {
            // Of the runs in the depot the newest is the one that came last.
            shared.send_run(again.run)?;
        }
        Ok(())
    }

    /// Caches are optional: a read-only lake must not fail a run that makes nothing.
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

    /// Returns an intact result: of the newest runs, or an older one, which is marked as used.
    fn find(&self, fingerprint: &Digest) -> Result<Option<Arc<RecordOutcome>>, LakeError> {
        if let Some(outcome) = self.cache.current_outcome(fingerprint)
            && self.records.is_whole(fingerprint)?
            && self.is_whole(&outcome)?
        {
            return Ok(Some(outcome));
        }
        if !self.records.path(fingerprint).exists() {
            return Ok(None);
        }
        self.use_old(fingerprint);
        let Some(outcome) = self.recall_old(fingerprint)? else {
            return Ok(None);
        };
        Ok(self.is_whole(&outcome)?.then_some(outcome))
    }
}

/// Results shared with other machines.
impl Lake {
    /// Returns a result from the depot.
    fn find_elsewhere(
        &self,
        fingerprint: &Digest,
    ) -> Result<Option<Arc<RecordOutcome>>, LakeError> {
        match &self.shared {
            Some(shared) => shared.lookup(&self.records, &self.blobs, fingerprint),
            None => Ok(None),
        }
    }

    /// Whether a result whose record is in the depot can be used: its files may be lost there.
    pub(crate) fn is_complete(&self, fingerprint: &Digest) -> bool {
        let Ok(Some(outcome)) = self.lookup(fingerprint) else {
            return false;
        };
        let fetched = self.fetch_published(&[&*outcome]);
        !outcome.is_provisional() && fetched.is_ok_and(|fetched| fetched.into_iter().all(|it| it))
    }

    /// Stores the records that were found in the depot.
    fn adopt(&self) -> Result<(), LakeError> {
        match &self.shared {
            Some(shared) if shared.has_found() => {
                self.prepare()?;
                shared.adopt(&self.records, &self.blobs)
            }
            _ => Ok(()),
        }
    }
}

impl Store for Lake {
    fn enter(&self, pipeline: &str) -> Result<(), BoxedDiagnostic> {
        if let Some(shared) = &self.shared {
            shared.enter(pipeline);
        }
        self.records.invalidate();
        self.cache
            .enter(pipeline, &self.records.stamps, &self.blobs.stamps)?;
        self.changing.reset_progress(pipeline);
        Ok(())
    }

    fn takes_turns(&self) -> bool {
        self.shared.is_some()
    }

    fn turn(&self, fingerprint: &Digest) -> Turn {
        let shared = self.shared.as_ref();
        let turn = shared.map_or(Turn::Own, |shared| shared.turn(fingerprint, false));
        if turn == Turn::Made && !self.is_complete(fingerprint) {
            return Turn::Own;
        }
        turn
    }

    fn end_turn(&self, fingerprint: &Digest) {
        if let Some(shared) = &self.shared {
            shared.end_turn(fingerprint);
        }
    }

    fn look_ahead(&self, node: &NodeName, fingerprints: Vec<Digest>) {
        if let Some(shared) = &self.shared {
            shared.look_ahead(node, fingerprints);
        }
    }

    fn lookup(&self, fingerprint: &Digest) -> Result<Option<Arc<RecordOutcome>>, BoxedDiagnostic> {
        match self.find(fingerprint)? {
            Some(outcome) => Ok(Some(outcome)),
            None => Ok(self.find_elsewhere(fingerprint)?),
        }
    }

    fn recall(&self, fingerprint: &Digest) -> Result<Option<Arc<RecordOutcome>>, BoxedDiagnostic> {
        // The record comes first: the cached newest state may be older.
        match self.recall_old(fingerprint)? {
            Some(outcome) => Ok(Some(outcome)),
            None => match self.cache.outcome(fingerprint) {
                Some(outcome) => Ok(Some(outcome)),
                None => Ok(self.find_elsewhere(fingerprint)?),
            },
        }
    }

    fn fetch_published(&self, outcomes: &[&RecordOutcome]) -> Result<Vec<bool>, BoxedDiagnostic> {
        if self.shared.is_none() {
            return Ok(vec![true; outcomes.len()]);
        }
        let published = |outcome: &&RecordOutcome| -> Vec<FileRef> {
            let files = outcome.files().into_iter().flatten();
            let published = files.filter(|(name, file)| {
                is_published(name.as_str()) && self.is_only_in_depot(&file.digest)
            });
            published.map(|(_, file)| file.clone()).collect()
        };
        let absent: Vec<Vec<FileRef>> = outcomes.iter().map(published).collect();
        if absent.iter().any(|files| !files.is_empty()) {
            self.fetch_all(absent.iter().flatten())?;
        }
        let is_here = |files: Vec<FileRef>| files.iter().all(|file| self.file(file).exists());
        Ok(absent.into_iter().map(is_here).collect())
    }

    fn bytes_elsewhere(&self, outcome: &RecordOutcome) -> u64 {
        let files = outcome.files().into_iter().flat_map(BTreeMap::values);
        let absent = files.filter(|file| self.is_only_in_depot(&file.digest));
        absent.map(|file| file.size).sum()
    }

    fn arrived(&self, fingerprint: &Digest) -> Result<Option<Arc<RecordOutcome>>, BoxedDiagnostic> {
        if let Some(outcome) = self.recall_old(fingerprint)? {
            return Ok(Some(outcome));
        }
        match &self.shared {
            Some(shared) => {
                shared.expect(fingerprint)?;
                let found = shared.lookup(&self.records, &self.blobs, fingerprint)?;
                self.adopt()?;
                Ok(found)
            }
            None => Ok(None),
        }
    }

    fn took_s(&self, fingerprint: &Digest) -> Result<Option<f64>, BoxedDiagnostic> {
        let stored = self.records.read(fingerprint)?;
        Ok(stored.map(|stored| stored.provenance.took_s))
    }

    fn claim(&self, fingerprint: &Digest, unit: &UnitName) -> Result<(), BoxedDiagnostic> {
        match &self.shared {
            Some(shared) => Ok(shared.claim(fingerprint, unit)?),
            None => Ok(()),
        }
    }

    fn mark_suspect(&self, files: &BTreeMap<FileName, FileRef>) -> Result<(), BoxedDiagnostic> {
        if let Some(shared) = &self.shared {
            shared.mark_suspect(files.values());
        }
        Ok(())
    }

    fn remembered(&self, fingerprint: &Digest) -> Result<Option<Record>, BoxedDiagnostic> {
        Ok(self.record(fingerprint)?)
    }

    fn may_hold(&self, unit: &Fingerprint) -> Result<bool, BoxedDiagnostic> {
        Ok(self.records.may_hold(unit)?)
    }

    fn newest_units(&self, pipeline: &str) -> Result<Vec<NewestUnit>, BoxedDiagnostic> {
        Ok(self.cache.with(pipeline, |newest| newest.list()))
    }

    fn source_digest(&self, path: &Path, stamp: Option<Stamp>) -> Result<Digest, io::Error> {
        self.sources.digest(path, stamp)
    }

    fn begin(
        &self,
        fingerprint: &Digest,
        unit: &UnitName,
        waiting: &dyn Fn(&str),
    ) -> Result<Box<dyn UnitTransaction + '_>, BoxedDiagnostic> {
        self.prepare()?;
        self.adopt()?;
        Ok(Box::new(UnitInProgress::begin(
            self,
            fingerprint,
            unit,
            waiting,
        )?))
    }

    fn open(
        &self,
        files: &BTreeMap<FileName, FileRef>,
    ) -> Result<Option<BTreeMap<String, PathBuf>>, BoxedDiagnostic> {
        let mut paths = BTreeMap::new();
        let mut is_whole = true;
        for (name, file) in files {
            let is_here = self.blobs.is_whole(file)?;
            if !is_here {
                self.blobs.drop(file)?;
            }
            let fetch = |shared: &Shared| shared.fetch(&self.blobs, file);
            if is_here || self.shared.as_ref().map_or(Ok(false), fetch)? {
                paths.insert(name.to_string(), self.blobs.path(&file.digest));
            } else {
                is_whole = false;
            }
        }
        Ok(is_whole.then_some(paths))
    }

    fn publish(
        &self,
        pipeline: &str,
        node: &Node,
        made: &[PublishedUnit],
    ) -> Result<(), BoxedDiagnostic> {
        let _permit = self.in_flight.permit_commit();
        self.adopt()?;
        let published_of = |newest: &mut Newest| newest.published.get(&node.name).cloned();
        let before = self.cache.with(pipeline, published_of);
        let published = published::publish(self, pipeline, node, made, before.as_ref());
        let published = self
            .changing
            .record_result(pipeline, Some(&node.name), published)?;
        if let Some(published) = published {
            self.cache.with(pipeline, |newest| {
                newest.set_published(&node.name, published);
            });
        }
        Ok(())
    }

    fn retire(&self, pipeline: &str, kept: &[Node]) -> Result<(), BoxedDiagnostic> {
        let _permit = self.in_flight.permit_commit();
        let is_kept = |name: &NodeName| kept.iter().any(|node| node.name == *name);
        let old = self
            .cache
            .with(pipeline, |newest| newest.published_by_others(is_kept));
        let retired = published::retire(self, pipeline, &is_kept, &old);
        self.changing.record_result(pipeline, None, retired)?;
        let names = kept.iter().map(|node| &node.name);
        self.changing.record_whole(pipeline, names);
        self.cache.with(pipeline, |newest| newest.retire(is_kept));
        Ok(())
    }

    fn begin_run(&self, run: &RunRecord) -> Result<u64, BoxedDiagnostic> {
        let _permit = self.in_flight.permit_commit();
        self.prepare()?;
        self.adopt()?;
        if let Some(shared) = &self.shared {
            shared.start();
        }
        self.collect_staging(GcMode::Remove)?;
        Ok(self.register.begin(run, &self.locks)?)
    }

    fn keep_progress(&self, number: u64, record: &RunRecord) -> Result<(), BoxedDiagnostic> {
        let _permit = self.in_flight.permit_commit();
        let mut current = self.register.current();
        if let Some(run) = current.as_mut().filter(|run| run.number == number) {
            self.register.keep_progress(run, record.clone())?;
        }
        Ok(())
    }

    fn end_run(
        &self,
        number: u64,
        record: &RunRecord,
        units: &[(UnitRef, Arc<RecordOutcome>)],
    ) -> Result<(), BoxedDiagnostic> {
        let _permit = self.in_flight.permit_commit();
        let run = self.register.current().take();
        let run = match run.filter(|run| run.number == number) {
            Some(run) => run,
            None => self.register.read(number)?,
        };
        let history = history::keep(self, &run, record, units)?;
        self.register.end(run, record.clone(), history)?;
        if let Some(shared) = &self.shared {
            if shared.is_down() {
                // Processes that were started without it marked nothing.
                for (unit, _) in units.iter().filter(|(unit, _)| unit.made_now) {
                    shared.send_unit(&unit.fingerprint)?;
                }
            }
            if record.status == RunStatus::Finished {
                shared.send_run(number)?;
            }
        }
        repair::repair(self)?;
        // Last, since the views change with it.
        Ok(self.changing.unmark(&record.pipeline, &self.locks)?)
    }

    fn find_run(&self, run: &RunRecord) -> Result<Option<u64>, BoxedDiagnostic> {
        let _permit = self.in_flight.permit_commit();
        let Some((number, again)) = self.register.find_repeated(run)? else {
            return Ok(None);
        };
        if let Some(again) = again {
            self.repeat(&run.pipeline, again)?;
        }
        Ok(Some(number))
    }

    fn settle(
        &self,
        pipeline: &str,
        units: Option<&[(UnitRef, Arc<RecordOutcome>)]>,
    ) -> Result<(), BoxedDiagnostic> {
        let _permit = self.in_flight.permit_commit();
        self.adopt()?;
        let is_changed = self.cache.with(pipeline, |newest| newest.is_changed());
        if units.is_some() || is_changed || self.blobs.learned() || self.records.stamps.learned() {
            let parts = (&self.records, &self.blobs);
            let kept = self
                .prepare()
                .and_then(|()| self.cache.keep(pipeline, units, parts, &self.locks));
            Self::unless_read_only(units, kept)?;
        }
        // The files of a run in progress are incomplete.
        if self.register.current().is_none() {
            let again = match units {
                None => self.register.repeated_of(pipeline)?,
                // It was found or recorded.
                Some(_) => None,
            };
            let repaired = again
                .map_or(Ok(()), |again| self.repeat(pipeline, again))
                .and_then(|()| self.collect_staging(GcMode::Remove))
                .and_then(|_| repair::repair(self))
                .and_then(|()| self.changing.unmark(pipeline, &self.locks));
            Self::unless_read_only(units, repaired)?;
        }
        match self.sources.save(&self.locks) {
            Err(_) if units.is_none() => Ok(()),
            saved => Ok(saved?),
        }
    }
}
