//! Tables of the runs that machines have sent to their depot, for queries.
//!
//! Nothing but the records of runs and the tables asked for is fetched; a table comes whole, for only
//! then can its bytes be checked.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
    sync::Arc,
};

use arrow_array::{ArrayRef, Int64Array, RecordBatch, StringArray};
use arrow_schema::{ArrowError, Field, Schema};
use dataflow::{ArtifactName, FileRef, NodeName, RecordOutcome, UnitRef};

use crate::{
    LakeError, StageTable, TableFiles,
    atomic::io_error,
    folder::{Folder, HISTORY},
    history,
    lake::Lake,
    published,
    records::Stored,
    register::Run,
    scratch::Scratch,
    sealed,
    shared::{SharedRun, keys},
    table,
};

/// The runs in a depot, and the tables that they made.
///
/// A run is named `MACHINE:NUMBER`, as that machine numbers it; where two lakes of a machine have a run
/// of that number, the number of its process follows.
pub struct DepotTables<'a> {
    lake: &'a Lake,
    /// Keys of the runs that are not read yet, the newest last.
    left: Vec<String>,
    /// The newest first.
    runs: Vec<SharedRun>,
    /// Tables under the names that queries expect.
    folder: Scratch,
}

impl SharedRun {
    /// Its units with their records, without those whose recipe is missing.
    fn refs(&self) -> impl Iterator<Item = (UnitRef, &Stored)> {
        let units = self.units.iter().enumerate();
        units.filter_map(|(idx, stored)| {
            let recipe = self.recipes.get(&stored.recipe)?;
            let unit = UnitRef {
                node: NodeName {
                    stage: stored.stage.clone(),
                    artifact: recipe.output.clone(),
                },
                partition: stored.partition.clone(),
                fingerprint: stored.fingerprint,
                made_now: self.run.made_now.contains(&idx),
            };
            Some((unit, stored))
        })
    }

    fn outputs(&self) -> impl Iterator<Item = &NodeName> {
        let outputs = self.run.record.outputs.iter();
        outputs.map(|output| &output.node)
    }
}

/// A table's file, and the path under which queries find it.
type Wanted = (FileRef, PathBuf);

impl Lake {
    /// Lists the runs in the depot, of which the newest of each pipeline are read.
    ///
    /// # Errors
    ///
    /// Fails if the lake has no depot, that cannot be read, or the lake's folder cannot be written.
    pub fn depot_tables(&self) -> Result<DepotTables<'_>, LakeError> {
        self.depot()?;
        self.prepare()?;
        DepotTables::open(self)
    }
}

impl<'a> DepotTables<'a> {
    fn open(lake: &'a Lake) -> Result<Self, LakeError> {
        let mut left: Vec<String> = lake
            .depot()?
            .list(keys::RUNS)?
            .into_iter()
            .map(|entry| entry.key)
            .collect();
        // Names begin with the time at which the run started.
        left.sort_by(|a, b| parts(a).1.cmp(parts(b).1));
        Ok(Self {
            lake,
            left,
            runs: Vec::new(),
            folder: Scratch::make(lake)?,
        })
    }

    /// Whether no machine has sent a run.
    pub fn is_empty(&self) -> bool {
        self.runs.is_empty() && self.left.is_empty()
    }

    /// Names of the artifacts that the newest run of each pipeline may have made.
    ///
    /// # Errors
    ///
    /// Fails if the depot cannot be read.
    pub fn artifacts(&mut self) -> Result<BTreeSet<ArtifactName>, LakeError> {
        let unread = self.left.iter().map(|key| parts(key).0.to_owned());
        let read = self.runs.iter();
        let read = read.map(|run| keys::runs(&run.run.record.pipeline));
        let mut pipelines: BTreeSet<String> = unread.chain(read).collect();
        let mut names = BTreeSet::new();
        let mut idx = 0;
        while !pipelines.is_empty() {
            let Some(run) = self.at(idx)? else { break };
            idx += 1;
            if pipelines.remove(&keys::runs(&run.run.record.pipeline)) {
                names.extend(run.outputs().map(|node| node.artifact.clone()));
            }
        }
        Ok(names)
    }

    /// Names of the artifacts of which some run has a table.
    ///
    /// # Errors
    ///
    /// Fails if the depot cannot be read.
    pub fn tables(&mut self) -> Result<BTreeSet<ArtifactName>, LakeError> {
        self.read_all()?;
        let units = self.runs.iter().flat_map(SharedRun::refs);
        let tables = units.filter(|(_, stored)| stored.outcome.file(table::FILE).is_some());
        Ok(tables.map(|(unit, _)| unit.node.artifact).collect())
    }

    /// Fetches the newest partitions of a table: of the pipeline with the newest run, on any machine,
    /// among those that made the table.
    ///
    /// # Errors
    ///
    /// Fails if the depot cannot be read or has lost a file, or a file cannot be written.
    pub fn newest(&mut self, table: &str) -> Result<TableFiles, LakeError> {
        let mut asked = BTreeSet::new();
        let mut idx = 0;
        while let Some(run) = self.at(idx)? {
            let pipeline = run.run.record.pipeline.clone();
            let outputs = run.outputs().filter(|node| node.artifact == *table);
            let outputs: Vec<NodeName> = outputs.cloned().collect();
            if asked.insert(pipeline.clone()) {
                let found = self.newest_of(&pipeline, outputs, idx)?;
                if !found.stages.is_empty() {
                    return Ok(found);
                }
            }
            idx += 1;
        }
        Ok(TableFiles::default())
    }

    /// Fetches these outputs of a pipeline, each as the newest run that had it, of those from `idx`.
    fn newest_of(
        &mut self,
        pipeline: &str,
        outputs: Vec<NodeName>,
        mut idx: usize,
    ) -> Result<TableFiles, LakeError> {
        let mut outputs: BTreeSet<NodeName> = outputs.into_iter().collect();
        let mut found = TableFiles::default();
        let mut wanted = Vec::new();
        while !outputs.is_empty() {
            self.at(idx)?;
            let Some(run) = self.runs.get(idx) else { break };
            idx += 1;
            if run.run.record.pipeline == pipeline {
                let shown: BTreeSet<&NodeName> = run.run.shown().collect();
                outputs.retain(|node| {
                    if shown.contains(node) {
                        found
                            .stages
                            .extend(self.table_had_by(run, node, &mut wanted));
                    }
                    !shown.contains(node)
                });
            }
        }
        self.fetch(&wanted)?;
        Ok(found)
    }

    /// Fetches every partition of a table that any run had, each once.
    ///
    /// # Errors
    ///
    /// Fails as [`Self::newest`] does.
    pub fn of_all_runs(&mut self, table: &str) -> Result<TableFiles, LakeError> {
        self.read_all()?;
        let mut all = TableFiles::default();
        let mut wanted = Vec::new();
        for run in &self.runs {
            for node in run.run.shown().filter(|node| node.artifact == *table) {
                all.stages.extend(self.table_had_by(run, node, &mut wanted));
            }
        }
        wanted.sort_by(|(_, a), (_, b)| a.cmp(b));
        wanted.dedup_by(|(_, a), (_, b)| a == b);
        self.fetch(&wanted)?;
        Ok(all)
    }

    /// Writes the rows of a table of runs, with the runs' names in a column `run`, and in `runs` their
    /// machines and numbers; returns its files.
    ///
    /// # Errors
    ///
    /// Fails if the depot cannot be read, or a file cannot be written.
    pub fn history(&mut self, name: &str) -> Result<Vec<PathBuf>, LakeError> {
        self.read_all()?;
        let mut files = Vec::new();
        let Some(at) = HISTORY.iter().position(|known| *known == name) else {
            return Ok(files);
        };
        for (idx, (shared, run)) in self.runs.iter().zip(self.names()).enumerate() {
            let units = shared.refs();
            let units: Vec<(UnitRef, Arc<RecordOutcome>)> = units
                .map(|(unit, stored)| (unit, Arc::new(stored.outcome.clone())))
                .collect();
            let of_run = &shared.run;
            let tables = history::tables(of_run, &of_run.record, &units);
            let Some(rows) = tables.into_iter().nth(at) else {
                continue;
            };
            let folder = self.folder.path().join(name).join(idx.to_string());
            let path = folder.join(table::FILE);
            let rows = rows.and_then(|rows| named(name, &rows, &run, of_run));
            let rows = rows.map_err(LakeError::parquet("write", &path))?;
            fs::create_dir_all(&folder).map_err(io_error("create", &folder))?;
            table::write_batch(&folder, &rows)?;
            files.push(path);
        }
        Ok(files)
    }

    /// The names of the runs.
    fn names(&self) -> Vec<String> {
        let name = |run: &SharedRun| format!("{}:{}", run.run.host, run.run.number);
        let mut counts: BTreeMap<String, usize> = BTreeMap::new();
        for run in &self.runs {
            *counts.entry(name(run)).or_default() += 1;
        }
        let names = self.runs.iter().map(|run| {
            let (name, process) = (name(run), &run.run.process);
            let number = process.split('-').next().unwrap_or(process);
            match counts.get(&name) {
                Some(1) | None => name,
                Some(_) => format!("{name}-{number}"),
            }
        });
        names.collect()
    }

    /// The partitions of an output that a run had, whose files are added to those that are `wanted`.
    fn table_had_by(
        &self,
        run: &SharedRun,
        node: &NodeName,
        wanted: &mut Vec<Wanted>,
    ) -> Option<StageTable> {
        let column = run.run.column_of(node)?;
        let folder = Folder::new(self.folder.path());
        let mut files = BTreeMap::new();
        for (unit, stored) in run.refs().filter(|(unit, _)| unit.node == *node) {
            if let Some(file) = stored.outcome.file(table::FILE) {
                let path =
                    folder.every_table(&node.artifact, column, &unit.partition, &unit.fingerprint);
                wanted.push((file.clone(), path.clone()));
                files.insert(unit.partition, path);
            }
        }
        (!files.is_empty()).then(|| StageTable {
            pipeline: run.run.record.pipeline.clone(),
            stage: node.stage.clone(),
            column: column.to_owned(),
            files,
        })
    }

    /// Fetches tables, checked while they come, and links them.
    fn fetch(&self, wanted: &[Wanted]) -> Result<(), LakeError> {
        // What is fetched is in no run of this lake.
        let _kept = self.lake.locks.block_collection()?;
        let shared = self.lake.depot()?;
        shared.fetch_all(&self.lake.blobs, wanted.iter().map(|(file, _)| file))?;
        for (file, path) in wanted {
            if !self.lake.blobs.path(&file.digest).exists() {
                return Err(shared.lost(&file.digest));
            }
            published::show(self.lake, &file.digest, path)?;
        }
        Ok(())
    }

    fn read_all(&mut self) -> Result<(), LakeError> {
        while self.at(self.runs.len())?.is_some() {}
        Ok(())
    }

    /// Returns a run, 0 for the newest; `None` where there are fewer runs.
    fn at(&mut self, idx: usize) -> Result<Option<&SharedRun>, LakeError> {
        while self.runs.len() <= idx {
            let Some(key) = self.left.pop() else {
                return Ok(None);
            };
            // It was removed meanwhile.
            let Some(bytes) = self.lake.depot()?.read(&key)? else {
                continue;
            };
            self.runs.push(sealed::parse(Path::new(&key), &bytes)?);
        }
        Ok(self.runs.get(idx))
    }
}

/// Adds the name of a run to its rows of a table, and in `runs` its machine and number.
fn named(
    table: &str,
    rows: &RecordBatch,
    name: &str,
    run: &Run,
) -> Result<RecordBatch, ArrowError> {
    let text =
        |value: &str| -> ArrayRef { Arc::new(StringArray::from(vec![value; rows.num_rows()])) };
    let mut added = vec![("run", text(name))];
    if table == "runs" {
        let number = i64::try_from(run.number).unwrap_or(i64::MAX);
        let number: ArrayRef = Arc::new(Int64Array::from(vec![number; rows.num_rows()]));
        added.extend([("machine", text(&run.host)), ("number", number)]);
    }
    let mut fields: Vec<Arc<Field>> = rows.schema().fields().iter().cloned().collect();
    let mut columns = rows.columns().to_vec();
    for (name, column) in added {
        fields.push(Arc::new(Field::new(
            name,
            column.data_type().clone(),
            false,
        )));
        columns.push(column);
    }
    RecordBatch::try_new(Arc::new(Schema::new(fields)), columns)
}

/// The folder and the name in a key.
fn parts(key: &str) -> (&str, &str) {
    key.rsplit_once('/').unwrap_or(("", key))
}
