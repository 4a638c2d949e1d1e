//! Tables of the runs that machines have sent to their depot, for queries.
//!
//! Nothing but the records of runs and the tables asked for is fetched; a table comes whole, for only
//! then can its bytes be checked.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::PathBuf,
    sync::Arc,
};

use arrow_array::{ArrayRef, Int64Array, RecordBatch, StringArray};
use arrow_schema::{ArrowError, Field, Schema};
use dataflow::{
    ArtifactName, Digest, FileRef, NodeName, OutputFingerprint, RecordOutcome, UnitRef,
};

use crate::{
    LakeError, StageTable, TableFiles,
    atomic::io_error,
    catalog::{ExpectedFile, check},
    folder::{Folder, HISTORY},
    history,
    lake::Lake,
    published,
    records::Stored,
    register::Run,
    scratch::Scratch,
    shared::{Shared, SharedRun, keys},
    table,
};

/// The runs in a depot, and the tables that they made.
///
/// A run is named `MACHINE:NUMBER-DIGITS`: as its lake numbers it, and what tells that lake from others
/// of the machine. Of all runs the newest is the one that came last, by the depot's clock. Only finished
/// runs are sent.
pub struct DepotTables<'a> {
    lake: &'a Lake,
    /// Keys of the runs that are not read yet, the newest last.
    left: Vec<String>,
    /// The newest first.
    runs: Vec<DepotRun>,
    /// Tables under the names that queries expect.
    folder: Scratch,
}

/// A run in the depot.
struct DepotRun {
    run: Run,
    units: Vec<Stored>,
    recipes: BTreeMap<Digest, OutputFingerprint>,
}

impl DepotRun {
    /// Its name.
    fn name(&self) -> String {
        let process = Digest::of_bytes(self.run.process.as_bytes()).to_hex();
        let digits = process.get(..NAMED).unwrap_or(&process);
        format!("{}:{}-{digits}", self.run.host, self.run.number)
    }

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

/// Digits that tell lakes of a machine apart.
const NAMED: usize = 6;

/// A table's file, and the path under which queries find it.
type TableLink = (FileRef, PathBuf);

impl Lake {
    /// Lists the runs in the depot.
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
        let mut left = lake.depot()?.list(keys::RUNS)?;
        left.sort_by(|a, b| (a.modified, &a.key).cmp(&(b.modified, &b.key)));
        Ok(Self {
            lake,
            left: left.into_iter().map(|entry| entry.key).collect(),
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
        let unread = self.left.iter().filter_map(|key| key.rsplit_once('/'));
        let unread = unread.map(|(folder, _)| folder.to_owned());
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
        let units = self.runs.iter().flat_map(DepotRun::refs);
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
                let published: BTreeSet<&NodeName> = run.run.published().collect();
                outputs.retain(|node| {
                    if published.contains(node) {
                        found
                            .stages
                            .extend(self.table_had_by(run, node, &mut wanted));
                    }
                    !published.contains(node)
                });
            }
        }
        match self.fetch(&wanted)?.first() {
            None => Ok(found),
            Some((file, _)) => Err(Shared::lost(&file.digest)),
        }
    }

    /// Fetches every partition of a table that any run had, each once; those that the depot has lost are
    /// counted. Of one that came out differently on two machines it is that of the newest run.
    ///
    /// # Errors
    ///
    /// Fails as [`Self::newest`] does.
    pub fn of_all_runs(&mut self, table: &str) -> Result<TableFiles, LakeError> {
        self.read_all()?;
        let mut all = TableFiles::default();
        let mut wanted = Vec::new();
        for run in &self.runs {
            for node in run.run.published().filter(|node| node.artifact == *table) {
                all.stages.extend(self.table_had_by(run, node, &mut wanted));
            }
        }
        wanted.sort_by(|(_, a), (_, b)| a.cmp(b));
        wanted.dedup_by(|(_, a), (_, b)| a == b);
        let lost = self.fetch(&wanted)?.into_iter();
        let lost: BTreeSet<&PathBuf> = lost.map(|(_, path)| path).collect();
        for table in &mut all.stages {
            table.files.retain(|_, path| !lost.contains(path));
        }
        all.stages.retain(|table| !table.files.is_empty());
        all.n_collected = lost.len();
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
        for (idx, run) in self.runs.iter().enumerate() {
            let units = run.refs();
            let units: Vec<(UnitRef, Arc<RecordOutcome>)> = units
                .map(|(unit, stored)| (unit, Arc::new(stored.outcome.clone())))
                .collect();
            let tables = history::tables(&run.run, &run.run.record, &units);
            let Some(rows) = tables.into_iter().nth(at) else {
                continue;
            };
            let folder = self.folder.path().join(name).join(idx.to_string());
            let path = folder.join(table::FILE);
            let rows = rows.and_then(|rows| named(name, &rows, run));
            let rows = rows.map_err(LakeError::parquet("write", &path))?;
            fs::create_dir_all(&folder).map_err(io_error("create", &folder))?;
            table::write_batch(&folder, &rows)?;
            files.push(path);
        }
        Ok(files)
    }

    /// The partitions of an output that a run had, whose files are added to those that are `wanted`.
    fn table_had_by(
        &self,
        run: &DepotRun,
        node: &NodeName,
        wanted: &mut Vec<TableLink>,
    ) -> Option<StageTable> {
        let column = run.run.column_of(node)?;
        let folder = Folder::new(self.folder.path());
        let mut files = BTreeMap::new();
        for (unit, stored) in run.refs().filter(|(unit, _)| unit.node == *node) {
            if let Some(file) = stored.outcome.file(table::FILE) {
                let path = folder.version_table(
                    &node.artifact,
                    column,
                    &unit.partition,
                    &unit.fingerprint,
                );
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

    /// Fetches tables and links them; returns those that the depot has lost.
    fn fetch<'w>(&self, wanted: &'w [TableLink]) -> Result<Vec<&'w TableLink>, LakeError> {
        // What is fetched is in no run of this lake.
        let _kept = self.lake.locks.block_collection()?;
        let shared = self.lake.depot()?;
        let blobs = &self.lake.blobs;
        shared.fetch_all(blobs, wanted.iter().map(|(file, _)| file))?;
        let is_here = |wanted: &&TableLink| blobs.path(&wanted.0.digest).exists();
        let (here, lost): (Vec<&TableLink>, Vec<&TableLink>) = wanted.iter().partition(is_here);
        if !lost.is_empty()
            && let Some(err) = shared.offline()
        {
            return Err(err);
        }
        // Those that were here before may be damaged.
        let expected = here
            .iter()
            .map(|(file, _)| (blobs.path(&file.digest), file.digest));
        check(&expected.collect::<Vec<ExpectedFile>>())?;
        for (file, path) in here {
            published::link_file(self.lake, &file.digest, path)?;
        }
        Ok(lost)
    }

    fn read_all(&mut self) -> Result<(), LakeError> {
        while self.at(self.runs.len())?.is_some() {}
        Ok(())
    }

    /// Returns a run, 0 for the newest; `None` where there are fewer runs.
    fn at(&mut self, idx: usize) -> Result<Option<&DepotRun>, LakeError> {
        while self.runs.len() <= idx {
            let Some(key) = self.left.pop() else {
                return Ok(None);
            };
            // It was removed meanwhile.
            let Some(bytes) = self.lake.depot()?.read(&key)? else {
                continue;
            };
            let Ok(shared) = SharedRun::parse(&key, &bytes) else {
                return Err(LakeError::LostInDepot { key });
            };
            // An earlier version of the program sent no record of the run.
            self.runs.extend(shared.run.map(|run| DepotRun {
                run,
                units: shared.units,
                recipes: shared.recipes,
            }));
        }
        Ok(self.runs.get(idx))
    }
}

/// Adds the name of a run to its rows of a table, and in `runs` its machine and number.
fn named(table: &str, rows: &RecordBatch, run: &DepotRun) -> Result<RecordBatch, ArrowError> {
    let text =
        |value: &str| -> ArrayRef { Arc::new(StringArray::from(vec![value; rows.num_rows()])) };
    let mut added = vec![("run", text(&run.name()))];
    if table == "runs" {
        let number = i64::try_from(run.run.number).unwrap_or(i64::MAX);
        let number: ArrayRef = Arc::new(Int64Array::from(vec![number; rows.num_rows()]));
        added.extend([("machine", text(&run.run.host)), ("number", number)]);
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
