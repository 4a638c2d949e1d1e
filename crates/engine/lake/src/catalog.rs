//! Tables according to the records: which unit made each newest partition, and the digests of its
//! files.
//!
//! The published files below `tables/` and `every/` derive from this, and can be lost, exchanged or
//! added to; queries are answered from the records.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use dataflow::{Artifact, Digest, NodeName, PartitionKey, RunStatus, StageName, UnitRef};

use crate::{
    LakeError, digests::check_digests, folder::PublishedFolders, lake::Lake, register::Run, table,
};

/// The newest partitions of a node, as published by the newest run that reached it.
pub(crate) struct PublishedNode {
    pub(crate) node: NodeName,
    /// The column of partitions' keys.
    pub(crate) column: String,
    pub(crate) units: Vec<UnitRef>,
}

/// The partitions of a table from one stage of one pipeline. Their bytes have been checked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StageTable {
    /// The pipeline.
    pub pipeline: String,
    /// The stage.
    pub stage: StageName,
    /// The column of partitions' keys.
    pub column: String,
    /// The table's file of each partition, by key, below a folder `COLUMN=KEY` and one
    /// `fingerprint=DIGITS`.
    pub files: BTreeMap<PartitionKey, PathBuf>,
}

/// The remaining partitions of a table.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct TableFiles {
    /// Its partitions by stage.
    pub stages: Vec<StageTable>,
    /// Number of partitions removed by garbage collection.
    pub n_collected: usize,
}

/// A file and its expected digest.
pub(crate) type ExpectedFile = (PathBuf, Digest);

impl Lake {
    /// Returns the newest partitions of a table: of the pipeline with the newest run among those
    /// that publish the table.
    ///
    /// # Errors
    ///
    /// Fails if a record or a file of it is lost or damaged.
    pub fn newest_table(&self, table: &str) -> Result<TableFiles, LakeError> {
        let mut recorded = Recorded::of(self)?;
        let mut asked = BTreeSet::new();
        let mut idx = 0;
        while let Some(run) = recorded.at(idx)? {
            idx += 1;
            let pipeline = run.record.pipeline.clone();
            if !asked.insert(pipeline.clone()) {
                continue;
            }
            let mut expected = Vec::new();
            let mut found = TableFiles::default();
            for published in recorded.published_nodes(&pipeline, |node| node.artifact == *table)? {
                let mut files = BTreeMap::new();
                for unit in &published.units {
                    let stored = self.records.read(&unit.fingerprint)?;
                    let stored = stored.ok_or_else(|| self.lost_record(&unit.fingerprint))?;
                    if let Some(file) = stored.outcome.file(table::FILE) {
                        let path = self.version_path(&published.column, unit);
                        expected.push((path.clone(), file.digest));
                        files.insert(unit.partition.clone(), path);
                    }
                }
                found.add(&pipeline, &published.node.stage, &published.column, files);
            }
            if !found.stages.is_empty() {
                check(&expected)?;
                return Ok(found);
            }
        }
        Ok(TableFiles::default())
    }

    /// Returns the newest partitions of a table by key, each with only the table's file; with a stage, those that
    /// it made: several stages of a pipeline may make the same table.
    ///
    /// # Errors
    ///
    /// Fails if a record or a file of it is lost or damaged.
    pub fn newest_partitions(
        &self,
        name: &str,
        stage: Option<&str>,
    ) -> Result<BTreeMap<PartitionKey, Artifact>, LakeError> {
        let tables = self.newest_table(name)?.stages.into_iter();
        let of_stage = tables.filter(|table| stage.is_none_or(|stage| table.stage == *stage));
        let files = of_stage.flat_map(|table| table.files);
        let artifacts = files.map(|(key, file)| {
            let artifact = Artifact {
                key: key.clone(),
                labels: BTreeMap::new(),
                files: BTreeMap::from([(table::FILE.to_owned(), file)]),
            };
            (key, artifact)
        });
        Ok(artifacts.collect())
    }

    /// Returns the partitions of a table that a run had.
    ///
    /// # Errors
    ///
    /// Fails if a record or a file of it is lost or damaged.
    pub fn table_of_run(&self, table: &str, run: &Run) -> Result<TableFiles, LakeError> {
        let mut expected = Vec::new();
        let found = self.table_had_by(table, run, &mut expected)?;
        check(&expected)?;
        Ok(found)
    }

    /// Returns every partition of a table that any run had, each once.
    ///
    /// # Errors
    ///
    /// Fails if a record or a file of it is lost or damaged.
    pub fn table_of_all_runs(&self, table: &str) -> Result<TableFiles, LakeError> {
        let mut expected = Vec::new();
        let mut all = TableFiles::default();
        let mut lists = BTreeSet::new();
        for number in self.register.numbers()? {
            let run = self.register.read(number)?;
            // Runs that had the same units share their list.
            if lists.insert((run.record.pipeline.clone(), run.manifest)) {
                let run = self.run(number)?;
                let found = self.table_had_by(table, &run, &mut expected)?;
                all.stages.extend(found.stages);
                all.n_collected += found.n_collected;
            }
        }
        expected.sort();
        expected.dedup();
        check(&expected)?;
        Ok(all)
    }

    /// Lists the partitions of a table that a run had, and the expected digests of their files.
    fn table_had_by(
        &self,
        table: &str,
        run: &Run,
        expected: &mut Vec<ExpectedFile>,
    ) -> Result<TableFiles, LakeError> {
        let mut found = TableFiles::default();
        for node in run.published().filter(|node| node.artifact == *table) {
            let Some(column) = run.column_of(node) else {
                continue;
            };
            let mut files = BTreeMap::new();
            for unit in run.record.units.iter().filter(|unit| unit.node == *node) {
                let path = self.version_path(column, unit);
                let Some(stored) = self.records.read(&unit.fingerprint)? else {
                    // Garbage collection removes a unit completely.
                    if path.exists() || self.records.path(&unit.fingerprint).exists() {
                        return Err(self.lost_record(&unit.fingerprint));
                    }
                    found.n_collected += 1;
                    continue;
                };
                if let Some(file) = stored.outcome.file(table::FILE) {
                    // It was collected, and a run that goes on has made it again.
                    if !path.exists() && self.may_be_published(&unit.fingerprint)? {
                        found.n_collected += 1;
                        continue;
                    }
                    expected.push((path.clone(), file.digest));
                    files.insert(unit.partition.clone(), path);
                }
            }
            found.add(&run.record.pipeline, &node.stage, column, files);
        }
        Ok(found)
    }

    /// Returns the files of a table of runs, by the runs' numbers. Their bytes have been checked.
    ///
    /// # Errors
    ///
    /// Fails if a record of a run or a file is lost or damaged.
    pub fn history_table(&self, name: &str) -> Result<BTreeMap<u64, PathBuf>, LakeError> {
        let mut files = BTreeMap::new();
        let mut expected = Vec::new();
        for number in self.register.numbers()? {
            let run = self.register.read(number)?;
            if let Some(file) = run.history.get(name) {
                let path = self.folder.run_table(name, number);
                expected.push((path.clone(), file.digest));
                files.insert(number, path);
            }
        }
        check(&expected)?;
        Ok(files)
    }

    /// Path of a unit's table below `every/`.
    fn version_path(&self, column: &str, unit: &UnitRef) -> PathBuf {
        let artifact = &unit.node.artifact;
        self.folder
            .version_table(artifact, column, &unit.partition, &unit.fingerprint)
    }

    /// Paths of the tables of units that runs have published; some of the units made none.
    pub(crate) fn promised_versions(&self) -> Result<BTreeMap<PathBuf, Digest>, LakeError> {
        let mut expected = BTreeMap::new();
        let mut lists = BTreeSet::new();
        for number in self.register.numbers()? {
            let Ok(run) = self.register.read(number) else {
                continue;
            };
            let nodes: Vec<_> = run.published().cloned().collect();
            // Runs that had the same units share their list.
            if !lists.insert((run.manifest, nodes.clone())) {
                continue;
            }
            let units = self.register.units(&run).unwrap_or_default();
            for unit in units.iter().filter(|unit| nodes.contains(&unit.node)) {
                if let Some(column) = run.column_of(&unit.node) {
                    expected.insert(self.version_path(column, unit), unit.fingerprint);
                }
            }
        }
        Ok(expected)
    }

    fn lost_record(&self, fingerprint: &Digest) -> LakeError {
        let path = self.records.path(fingerprint);
        if path.exists() {
            LakeError::Damaged { path }
        } else {
            LakeError::Lost { path }
        }
    }

    /// The published files of a pipeline, by path below the lake, with their expected digests, and
    /// the units whose records are lost.
    pub(crate) fn promised_by(
        &self,
        pipeline: &str,
    ) -> Result<(BTreeMap<String, Digest>, Vec<Digest>), LakeError> {
        let (mut expected, mut lost) = (BTreeMap::new(), Vec::new());
        for node in Recorded::of(self)?.published_nodes(pipeline, |_| true)? {
            for unit in &node.units {
                let Some(stored) = self.records.read(&unit.fingerprint)? else {
                    lost.push(unit.fingerprint);
                    continue;
                };
                let folders = PublishedFolders::of(pipeline, &node.node);
                for (name, file) in stored.outcome.files().into_iter().flatten() {
                    let path = folders.path(&node.column, &unit.partition, name.as_str());
                    expected.insert(path, file.digest);
                }
            }
        }
        Ok((expected, lost))
    }

    /// Units of the newest partitions of every pipeline.
    pub(crate) fn newest_published_units(&self) -> Result<BTreeSet<Digest>, LakeError> {
        let mut recorded = Recorded::of(self)?;
        let mut units = BTreeSet::new();
        for pipeline in recorded.pipelines()? {
            for node in recorded.published_nodes(&pipeline, |_| true)? {
                units.extend(node.units.iter().map(|unit| unit.fingerprint));
            }
        }
        Ok(units)
    }

    /// Pipelines with recorded runs, the one with the newest run first.
    pub(crate) fn recorded_pipelines(&self) -> Result<Vec<String>, LakeError> {
        Recorded::of(self)?.pipelines()
    }
}

impl TableFiles {
    fn add(
        &mut self,
        pipeline: &str,
        stage: &StageName,
        column: &str,
        files: BTreeMap<PartitionKey, PathBuf>,
    ) {
        if !files.is_empty() {
            self.stages.push(StageTable {
                pipeline: pipeline.to_owned(),
                stage: stage.clone(),
                column: column.to_owned(),
                files,
            });
        }
    }
}

/// The runs of a lake, the newest or most recently repeated first, each read on first use.
struct Recorded<'a> {
    lake: &'a Lake,
    /// Numbers of the runs that are not read yet, in order.
    left: Vec<u64>,
    read: Vec<Run>,
}

impl<'a> Recorded<'a> {
    fn of(lake: &'a Lake) -> Result<Self, LakeError> {
        Ok(Self {
            lake,
            left: lake.register.ordered()?,
            read: Vec::new(),
        })
    }

    /// Returns a run without its units, 0 for the newest; `None` where there are fewer runs.
    fn at(&mut self, idx: usize) -> Result<Option<&Run>, LakeError> {
        while self.read.len() <= idx {
            let Some(number) = self.left.pop() else {
                return Ok(None);
            };
            self.read.push(self.lake.register.read(number)?);
        }
        Ok(self.read.get(idx))
    }

    fn pipelines(&mut self) -> Result<Vec<String>, LakeError> {
        let mut pipelines = Vec::new();
        let mut idx = 0;
        while let Some(run) = self.at(idx)? {
            idx += 1;
            if !pipelines.contains(&run.record.pipeline) {
                pipelines.push(run.record.pipeline.clone());
            }
        }
        Ok(pipelines)
    }

    /// Returns the published partitions of these nodes, each as of the newest run that published
    /// it, without nodes that were no longer in the pipeline at its last finished run.
    fn published_nodes(
        &mut self,
        pipeline: &str,
        is_asked: impl Fn(&NodeName) -> bool,
    ) -> Result<Vec<PublishedNode>, LakeError> {
        let mut found: BTreeMap<NodeName, PublishedNode> = BTreeMap::new();
        // Known once a finished run is seen: nodes in which later runs failed stay.
        let mut left: Option<BTreeSet<NodeName>> = None;
        let mut idx = 0;
        while left.as_ref().is_none_or(|left| !left.is_empty()) {
            let register = &self.lake.register;
            let Some(run) = self.at(idx)? else {
                break;
            };
            idx += 1;
            if run.record.pipeline != pipeline {
                continue;
            }
            let published: BTreeSet<&NodeName> =
                run.published().filter(|node| is_asked(node)).collect();
            let is_new = |node: &&&NodeName| {
                !found.contains_key(**node)
                    && left.as_ref().is_none_or(|left| left.contains(**node))
            };
            let new: Vec<&NodeName> = published.iter().filter(is_new).copied().collect();
            let units = if new.is_empty() {
                Vec::new()
            } else {
                register.units(run)?
            };
            let new = new.into_iter().filter_map(|node| {
                let of_node = units.iter().filter(|unit| unit.node == *node);
                let published = PublishedNode {
                    node: node.clone(),
                    column: run.column_of(node)?.to_owned(),
                    units: of_node.cloned().collect(),
                };
                Some((node.clone(), published))
            });
            found.extend(new.collect::<Vec<_>>());
            if left.is_none() && run.record.status == RunStatus::Finished {
                let outputs = run.record.outputs.iter().map(|output| &output.node);
                left = Some(outputs.filter(|node| is_asked(node)).cloned().collect());
            }
            if let Some(left) = &mut left {
                left.retain(|node| !found.contains_key(node));
            }
        }
        Ok(found.into_values().collect())
    }
}

/// Checks files against their expected digests.
pub(crate) fn check(expected: &[ExpectedFile]) -> Result<(), LakeError> {
    let (wrong, _) = check_digests(expected, &|_, _| {}, Path::to_owned);
    match wrong.into_iter().next() {
        None => Ok(()),
        Some(path) if path.exists() => Err(LakeError::Damaged { path }),
        Some(path) => Err(LakeError::Lost { path }),
    }
}
