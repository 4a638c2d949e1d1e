//! READMEs, their tables, and the markers above those that a query makes.

use std::{
    fs, io,
    ops::Range,
    path::{Path, PathBuf},
};

use lake::LakeError;

/// Start and end of a marker; the query's path below the README's folder stands between.
const MARKER: [&str; 2] = ["<!-- measured: ", " -->"];

/// A README by lines.
pub(crate) struct Readme {
    pub(crate) path: PathBuf,
    pub(crate) lines: Vec<String>,
}

/// A table of a README.
pub(crate) struct Table {
    /// Its lines, from the header on.
    pub(crate) lines: Range<usize>,
    /// The query in the marker right above it.
    pub(crate) query: Option<PathBuf>,
}

/// Adds the READMEs of a folder and of those below it, in order.
fn below(folder: &Path, found: &mut Vec<PathBuf>) -> io::Result<()> {
    let readme = folder.join("README.md");
    found.extend(readme.is_file().then_some(readme));
    let entries: io::Result<Vec<PathBuf>> = fs::read_dir(folder)?
        .map(|entry| Ok(entry?.path()))
        .collect();
    let mut folders = entries?;
    folders.retain(|path| path.is_dir());
    folders.sort();
    folders.iter().try_for_each(|folder| below(folder, found))
}

impl Readme {
    /// Lists the READMEs of the repository, that of the top level first.
    ///
    /// # Errors
    ///
    /// Fails if a folder or file cannot be read.
    pub(crate) fn all() -> io::Result<Vec<Self>> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let mut paths = vec![root.join("README.md")];
        for name in ["crates", "data", "pipelines", "schemas", "stages", "tests"] {
            below(&root.join(name), &mut paths)?;
        }
        paths.into_iter().map(Self::read).collect()
    }

    pub(crate) fn read(path: PathBuf) -> io::Result<Self> {
        let text = fs::read_to_string(&path)?;
        Ok(Self {
            path,
            lines: text.lines().map(str::to_owned).collect(),
        })
    }

    /// Returns the path below the repository's folder.
    pub(crate) fn name(&self) -> &Path {
        let root = env!("CARGO_MANIFEST_DIR");
        self.path.strip_prefix(root).unwrap_or(&self.path)
    }

    /// Lists the tables, from the first on.
    pub(crate) fn tables(&self) -> Vec<Table> {
        let mut tables: Vec<Table> = Vec::new();
        for (idx, line) in self.lines.iter().enumerate() {
            match tables.last_mut() {
                _ if !line.starts_with('|') => {}
                Some(table) if table.lines.end == idx => table.lines.end += 1,
                _ => tables.push(Table {
                    lines: idx..idx + 1,
                    query: idx.checked_sub(1).and_then(|above| self.query(above)),
                }),
            }
        }
        tables
    }

    fn query(&self, idx: usize) -> Option<PathBuf> {
        let [begin, end] = MARKER;
        let name = self
            .lines
            .get(idx)?
            .strip_prefix(begin)?
            .strip_suffix(end)?;
        Some(self.path.parent()?.join(name))
    }

    /// Replaces lines, and writes the file.
    ///
    /// # Errors
    ///
    /// Fails if the file cannot be written.
    pub(crate) fn replace(
        &mut self,
        lines: Range<usize>,
        by: Vec<String>,
    ) -> Result<(), LakeError> {
        self.lines.splice(lines, by);
        lake::write_atomic(&self.path, (self.lines.join("\n") + "\n").as_bytes())
    }
}
