//! Marks of pipelines whose published tables and files are being changed.
//!
//! Until the run that changes them is recorded, the published files differ from the newest record
//! without being damaged. A mark is an empty file `changing/PIPELINE.PROCESS`: it outlives its
//! process, and is removed when a later run has published all of the pipeline's outputs.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Mutex,
};

use ::clock::lock;
use dataflow::NodeName;

use crate::{
    LakeError, atomic,
    folder::{Folder, names_in},
    lock::Locks,
};

/// The publications of this process, by pipeline, and the marks of all processes.
pub(crate) struct ChangingMarks {
    folder: Folder,
    known: Mutex<BTreeMap<String, Progress>>,
}

#[derive(Default)]
struct Progress {
    /// Nodes whose published files are up to date.
    published: BTreeSet<NodeName>,
    /// Whether a publication was begun and not finished.
    failed: bool,
    /// Whether the whole pipeline is published.
    whole: bool,
}

impl ChangingMarks {
    pub(crate) fn new(folder: Folder) -> Self {
        Self {
            folder,
            known: Mutex::default(),
        }
    }

    /// Begins a run of a pipeline: nothing of it is published yet.
    pub(crate) fn reset_progress(&self, pipeline: &str) {
        lock(&self.known).insert(pipeline.to_owned(), Progress::default());
    }

    /// Records whether a publication succeeded.
    pub(crate) fn record_result<T>(
        &self,
        pipeline: &str,
        node: Option<&NodeName>,
        result: Result<T, LakeError>,
    ) -> Result<T, LakeError> {
        let mut known = lock(&self.known);
        let progress = known.entry(pipeline.to_owned()).or_default();
        progress.failed |= result.is_err();
        progress.published.extend(node.cloned());
        result
    }

    /// Records whether all nodes of a pipeline are published.
    pub(crate) fn record_whole<'n>(
        &self,
        pipeline: &str,
        mut nodes: impl Iterator<Item = &'n NodeName>,
    ) {
        let mut known = lock(&self.known);
        let progress = known.entry(pipeline.to_owned()).or_default();
        progress.whole = !progress.failed && nodes.all(|node| progress.published.contains(node));
    }

    /// Marks a pipeline before its published files change.
    pub(crate) fn mark(&self, pipeline: &str) -> Result<(), LakeError> {
        let path = self.folder.changing().join(mine(pipeline));
        if path.exists() {
            return Ok(());
        }
        self.folder.write(&path, b"")
    }

    /// Removes this process's mark once the publication is recorded, and those of dead processes
    /// once their unfinished publications are replaced.
    pub(crate) fn unmark(&self, pipeline: &str, locks: &Locks) -> Result<(), LakeError> {
        let folder = self.folder.changing();
        let known = lock(&self.known);
        let Some(progress) = known.get(pipeline).filter(|progress| !progress.failed) else {
            return Ok(());
        };
        for name in self.marks()? {
            let Some((of, process)) = name.rsplit_once('.') else {
                continue;
            };
            let is_over = of == pipeline && progress.whole && !locks.is_alive(process);
            if name == mine(pipeline) || is_over {
                atomic::remove_if_there(&folder.join(name))?;
            }
        }
        let _kept = std::fs::remove_dir(&folder);
        Ok(())
    }

    /// The marked pipelines.
    pub(crate) fn pipelines(&self) -> Result<BTreeSet<String>, LakeError> {
        let marks = self.marks()?;
        let pipelines = marks.iter().filter_map(|name| name.rsplit_once('.'));
        Ok(pipelines.map(|(pipeline, _)| pipeline.to_owned()).collect())
    }

    /// The names of all marks.
    pub(crate) fn marks(&self) -> Result<Vec<String>, LakeError> {
        names_in(&self.folder.changing())
    }
}

fn mine(pipeline: &str) -> String {
    format!("{pipeline}.{}", atomic::process_name())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_whole_publication_removes_the_marks_of_dead_processes_and_leaves_those_of_live_ones() {
        let root = tempfile::tempdir().unwrap();
        let folder = Folder::new(root.path());
        std::fs::create_dir(folder.staging()).unwrap();
        let locks = Locks::new(folder.locks());
        let marks = ChangingMarks::new(folder.clone());
        let _alive = locks
            .try_take("process-alive", "artifacts")
            .unwrap()
            .unwrap();
        for mark in ["cgf.alive", "cgf.dead", "other.dead"] {
            folder.write(&folder.changing().join(mark), b"").unwrap();
        }
        marks.mark("cgf").unwrap();
        assert_eq!(marks.marks().unwrap().len(), 4);
        marks.record_whole("cgf", [].into_iter());
        marks.unmark("cgf", &locks).unwrap();
        let left: BTreeSet<String> = marks.marks().unwrap().into_iter().collect();
        assert_eq!(left, ["cgf.alive", "other.dead"].map(str::to_owned).into());
    }
}
