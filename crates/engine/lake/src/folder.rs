//! The folder layout of a lake.

use std::{
    borrow::Cow,
    fs, io,
    path::{Path, PathBuf},
};

use dataflow::{ArtifactName, Digest, NodeName, PartitionKey};

use crate::{
    LakeError,
    atomic::{self, io_error},
    table,
};

/// Folder of the tables, below the lake.
pub(crate) const TABLES: &str = "tables";

/// Folder of published files that are neither tables nor charts, below the lake.
pub(crate) const FILES: &str = "files";

/// Folder of charts and pages, below the lake.
pub(crate) const REPORTS: &str = "reports";

/// Folder of every table ever made, by the unit that made it, below the lake.
pub(crate) const VERSIONS: &str = "every";

/// Folder of backup copies, below the lake.
const COPIES: &str = "copies";

/// Endings of the names of what people look at: charts, pages, and the tables in pages.
const SHOWN: [&str; 4] = [".svg", ".html", ".md", ".csv"];

/// Prefix of a run's table folder, before its number.
const RUN: &str = "run=";

/// Prefix of a unit's table folder below [`VERSIONS`], before its digits.
const FINGERPRINT: &str = "fingerprint=";

/// The tables of what runs did, in the order in which they are documented.
///
/// | table       | one row per                     | columns |
/// |-------------|---------------------------------|---------|
/// | `runs`      | run                             | `run`, `pipeline`, `file`, `profile`, `overrides`, `seed`, `status`, `message`, `started` (UTC), `seconds`, `n_units`, `n_made_now`, `n_skipped` |
/// | `settings`  | value of a stage in a run       | `run`, `stage`, `key` (dotted), `value` (JSON), `number` (null if it is none) |
/// | `units`     | unit of a run                   | `run`, `pipeline`, `stage`, `artifact`, `partition`, `fingerprint`, `result`, `reason`, `made_now` |
/// | `artifacts` | file of an artifact of a run    | `run`, `stage`, `artifact`, `partition`, `file`, `digest`, `bytes` |
/// | `metrics`   | metric of an artifact of a run  | `run`, `stage`, `artifact`, `partition`, `metric`, `value` |
pub(crate) const HISTORY: [&str; 5] = ["runs", "settings", "units", "artifacts", "metrics"];

/// The folder of a lake.
#[derive(Debug, Clone)]
pub(crate) struct Folder(PathBuf);

impl Folder {
    pub(crate) fn new(root: &Path) -> Self {
        Self(root.to_owned())
    }

    pub(crate) fn root(&self) -> &Path {
        &self.0
    }

    /// Returns a file or folder by its name below the lake.
    pub(crate) fn join(&self, name: impl AsRef<Path>) -> PathBuf {
        self.0.join(name)
    }

    /// Returns the name of a file below the lake.
    pub(crate) fn name_of<'p>(&self, path: &'p Path) -> Cow<'p, str> {
        self.below(path).to_string_lossy()
    }

    /// Returns a path relative to the lake.
    pub(crate) fn below<'p>(&self, path: &'p Path) -> &'p Path {
        path.strip_prefix(&self.0).unwrap_or(path)
    }

    pub(crate) fn staging(&self) -> PathBuf {
        self.join("staging")
    }

    pub(crate) fn locks(&self) -> PathBuf {
        self.join("locks")
    }

    /// Resume state of interrupted units, by fingerprint.
    pub(crate) fn resume(&self) -> PathBuf {
        self.join("resume")
    }

    /// Records of what stages have done in the world, by the stage's kind.
    pub(crate) fn effects(&self) -> PathBuf {
        self.join("effects")
    }

    /// Logs of units, by fingerprint.
    pub(crate) fn logs(&self) -> PathBuf {
        self.join("logs")
    }

    pub(crate) fn log(&self, fingerprint: &Digest) -> PathBuf {
        self.logs().join(format!("{}.log", fingerprint.to_hex()))
    }

    /// Marks of what is to be sent to the depot.
    pub(crate) fn outbox(&self) -> PathBuf {
        self.join("outbox")
    }

    /// Marks of blobs that are in the depot and not here.
    pub(crate) fn unfetched(&self) -> PathBuf {
        self.join("unfetched")
    }

    pub(crate) fn blobs(&self) -> PathBuf {
        self.join("blobs")
    }

    /// Records of units.
    pub(crate) fn units(&self) -> PathBuf {
        self.join("units")
    }

    pub(crate) fn recipes(&self) -> PathBuf {
        self.join("recipes")
    }

    pub(crate) fn runs(&self) -> PathBuf {
        self.join("runs")
    }

    /// Lists of units.
    pub(crate) fn manifests(&self) -> PathBuf {
        self.join("manifests")
    }

    pub(crate) fn tags(&self) -> PathBuf {
        self.join("tags")
    }

    /// The repeated runs.
    pub(crate) fn repeated_run(&self) -> PathBuf {
        self.join("again.json")
    }

    pub(crate) fn views(&self) -> PathBuf {
        self.join("views.sql")
    }

    /// Digests of files outside the lake.
    pub(crate) fn sources(&self) -> PathBuf {
        self.join("sources.cache")
    }

    /// Stamps of the watched files at the last full check.
    pub(crate) fn snapshot(&self) -> PathBuf {
        self.join("seen.cache")
    }

    /// Newest states of pipelines.
    pub(crate) fn newest(&self) -> PathBuf {
        self.join("newest")
    }

    /// Marks of pipelines whose tables and files are being changed.
    pub(crate) fn changing(&self) -> PathBuf {
        self.join("changing")
    }

    pub(crate) fn tables(&self) -> PathBuf {
        self.join(TABLES)
    }

    pub(crate) fn versions(&self) -> PathBuf {
        self.join(VERSIONS)
    }

    /// Lists the published tables of artifacts, by name.
    pub(crate) fn artifact_tables(&self) -> Result<Vec<ArtifactName>, LakeError> {
        let names = names_in(&self.tables())?.into_iter();
        let names = names.filter(|name| !HISTORY.contains(&name.as_str()));
        // No stage could have published a folder of another name.
        Ok(names.filter_map(|name| name.try_into().ok()).collect())
    }

    /// Returns the folder of a table's newest partitions in a pipeline.
    pub(crate) fn table_of(&self, table: &ArtifactName, pipeline: &str) -> PathBuf {
        self.join(published_table(table, pipeline))
    }

    /// Returns the path of a table of a run.
    pub(crate) fn run_table(&self, name: &str, run: u64) -> PathBuf {
        let folder = self.tables().join(name).join(format!("{RUN}{run}"));
        folder.join(table::FILE)
    }

    /// Lists the existing tables of runs.
    pub(crate) fn run_tables(&self) -> Result<Vec<PathBuf>, LakeError> {
        let mut tables = Vec::new();
        for name in HISTORY {
            tables.extend(files_below(&self.tables().join(name))?);
        }
        Ok(tables)
    }

    /// Returns the path of a unit's table below [`VERSIONS`].
    pub(crate) fn version_table(
        &self,
        artifact: &ArtifactName,
        column: &str,
        partition: &PartitionKey,
        fingerprint: &Digest,
    ) -> PathBuf {
        self.versions()
            .join(artifact.as_str())
            .join(format!("{column}={partition}"))
            .join(format!("{FINGERPRINT}{fingerprint}"))
            .join(table::FILE)
    }

    /// Returns the path of a file's backup copy.
    pub(crate) fn copy_of(&self, path: &Path) -> PathBuf {
        self.join(COPIES).join(self.below(path))
    }

    /// Writes a file, whole or not at all.
    pub(crate) fn write(&self, path: &Path, bytes: &[u8]) -> Result<(), LakeError> {
        atomic::write(&self.staging(), path, bytes)
    }
}

/// The folders, below the lake, in which a node's artifacts are published.
pub(crate) struct PublishedFolders {
    tables: PathBuf,
    files: PathBuf,
    charts: PathBuf,
}

impl PublishedFolders {
    pub(crate) fn of(pipeline: &str, node: &NodeName) -> Self {
        let of = |folder| {
            Path::new(folder)
                .join(pipeline)
                .join(node.stage.as_str())
                .join(node.artifact.as_str())
        };
        Self {
            tables: published_table(&node.artifact, pipeline).join(format!("stage={}", node.stage)),
            files: of(FILES),
            charts: of(REPORTS),
        }
    }

    /// Path at which a file of a partition is published.
    pub(crate) fn path(&self, column: &str, partition: &PartitionKey, name: &str) -> String {
        let folder = if name == table::FILE {
            self.tables.join(format!("{column}={partition}"))
        } else if is_published(name) {
            self.charts.join(partition.as_str())
        } else {
            self.files.join(partition.as_str())
        };
        folder.join(name).to_string_lossy().into_owned()
    }

    pub(crate) fn all(self) -> [PathBuf; 3] {
        [self.tables, self.files, self.charts]
    }
}

/// Whether a file of an artifact is what people look at: a table, a chart or a page.
pub(crate) fn is_published(name: &str) -> bool {
    name == table::FILE || SHOWN.iter().any(|ending| name.ends_with(ending))
}

fn published_table(table: &ArtifactName, pipeline: &str) -> PathBuf {
    Path::new(TABLES)
        .join(table.as_str())
        .join(format!("pipeline={pipeline}"))
}

/// Returns the number of the run to which this table belongs.
pub(crate) fn run_of(path: &Path) -> Option<u64> {
    let folder = path.parent()?.file_name()?.to_str()?;
    folder.strip_prefix(RUN)?.parse().ok()
}

/// Returns the partition and the unit to which this table belongs.
pub(crate) fn unit_of(path: &Path) -> Option<(PartitionKey, Digest)> {
    let mut folders = path.parent()?.iter().rev();
    let unit = folders.next()?.to_str()?.strip_prefix(FINGERPRINT)?;
    let (_, partition) = folders.next()?.to_str()?.split_once('=')?;
    Some((partition.parse().ok()?, unit.parse().ok()?))
}

/// Returns the digest in a file's name, without its extension.
pub(crate) fn digest_named(path: &Path) -> Option<Digest> {
    path.file_stem()?.to_str()?.parse().ok()
}

/// Lists the names in a folder, ordered; none if the folder does not exist.
pub(crate) fn names_in(folder: &Path) -> Result<Vec<String>, LakeError> {
    let entries = entries(folder)?.into_iter();
    let names = entries.filter_map(|(path, _)| {
        let name = path.file_name()?.to_string_lossy();
        Some(name.into_owned())
    });
    let mut names: Vec<String> = names.collect();
    names.sort();
    Ok(names)
}

/// Lists every file below a folder, ordered by path.
pub(crate) fn files_below(folder: &Path) -> Result<Vec<PathBuf>, LakeError> {
    let mut files = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for (path, is_folder) in entries(&folder)? {
            let list = if is_folder { &mut folders } else { &mut files };
            list.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// Lists the entries of a folder, and whether each is a folder; none if it does not exist.
pub(crate) fn entries(folder: &Path) -> Result<Vec<(PathBuf, bool)>, LakeError> {
    let entries = match fs::read_dir(folder) {
        Err(err) if err.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.map_err(io_error("read", folder))?,
    };
    let listed = entries.map(|entry| {
        let entry = entry?;
        let is_folder = entry.file_type().is_ok_and(|kind| kind.is_dir());
        Ok((entry.path(), is_folder))
    });
    listed
        .collect::<io::Result<_>>()
        .map_err(io_error("read", folder))
}
