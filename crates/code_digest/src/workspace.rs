//! The workspace crates that a crate links, and their sources.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs, io,
    path::{Path, PathBuf},
};

use blake3::Hasher;
use toml_edit::{DocumentMut, Item, TableLike};

use crate::locked::Lock;

/// Error in making the digests.
#[derive(Debug)]
pub enum CodeError {
    /// A source could not be read.
    Read(PathBuf, io::Error),
    /// A manifest or the lock file is not TOML.
    Parse(PathBuf, toml_edit::TomlError),
    /// No folder above the crate holds a workspace.
    NoWorkspace(PathBuf),
}

impl std::fmt::Display for CodeError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Read(path, err) => write!(f, "cannot read `{}`: {err}", path.display()),
            Self::Parse(path, err) => write!(f, "cannot parse `{}`: {err}", path.display()),
            Self::NoWorkspace(path) => {
                write!(f, "no workspace above the crate `{}`", path.display())
            }
        }
    }
}

impl std::error::Error for CodeError {}

/// The digest of one part of the code.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Part {
    /// The workspace crate's name, or `dependencies` for everything locked.
    pub name: String,
    /// 16 hexadecimal digits of BLAKE3.
    pub digest: String,
    /// Files and folders that it covers.
    pub watched: Vec<PathBuf>,
}

/// Returns the parts of the code of the crate in `folder`, ordered by name.
///
/// # Errors
///
/// Fails if a manifest or a source cannot be read, or the crate is in no workspace.
pub fn parts(folder: &Path) -> Result<Vec<Part>, CodeError> {
    let root = workspace_root(folder)?;
    let members = Members::read(&root)?;
    let mut open = vec![folder.to_owned()];
    let mut seen = BTreeSet::new();
    let mut external = BTreeSet::new();
    let mut parts = Vec::new();
    while let Some(folder) = open.pop() {
        if !seen.insert(folder.clone()) {
            continue;
        }
        let manifest = read_toml(&folder.join("Cargo.toml"))?;
        for table in dependency_tables(&manifest) {
            for (name, item) in table.iter() {
                match members.folder(&folder, name, item) {
                    Some(path) => open.push(path),
                    None => {
                        external.insert(package_name(name, item).to_owned());
                    }
                }
            }
        }
        parts.push(source_part(&folder, &manifest)?);
    }
    let lock_path = root.join("Cargo.lock");
    let lock = Lock::parse(&read_toml(&lock_path)?);
    let mut hasher = Hasher::new();
    hasher.update(lock.digest(&external).as_bytes());
    hasher.update(members.settings(&external).as_bytes());
    parts.push(Part {
        name: "dependencies".to_owned(),
        digest: short(&hasher),
        watched: vec![lock_path, root.join("Cargo.toml")],
    });
    parts.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(parts)
}

/// Folders of the workspace's crates, by dependency name.
struct Members {
    folders: BTreeMap<String, PathBuf>,
    root: DocumentMut,
}

impl Members {
    fn read(root: &Path) -> Result<Self, CodeError> {
        let manifest = read_toml(&root.join("Cargo.toml"))?;
        let shared = manifest
            .get("workspace")
            .and_then(|workspace| workspace.get("dependencies"))
            .and_then(Item::as_table_like);
        let folders = shared
            .into_iter()
            .flat_map(TableLike::iter)
            .filter_map(|(name, item)| {
                let path = item.get("path")?.as_str()?;
                Some((name.to_owned(), root.join(path)))
            })
            .collect();
        Ok(Self {
            folders,
            root: manifest,
        })
    }

    /// Returns the build settings of dependencies: the features of the named ones, and the release
    /// profile.
    fn settings(&self, names: &BTreeSet<String>) -> String {
        let workspace = self.root.get("workspace");
        let shared = workspace.and_then(|workspace| workspace.get("dependencies"));
        let chosen = names.iter().filter_map(|name| {
            let entry = shared?.get(name)?;
            Some(format!("{name} = {entry}\n"))
        });
        let profile = self.root.get("profile").and_then(|all| all.get("release"));
        let profile = profile.map(ToString::to_string).unwrap_or_default();
        chosen.chain([profile]).collect()
    }

    /// The folder of a dependency of the crate in `dependent`, if it is a path dependency.
    fn folder(&self, dependent: &Path, name: &str, item: &Item) -> Option<PathBuf> {
        let folder = match item.get("path").and_then(Item::as_str) {
            Some(path) => dependent.join(path),
            None if item.get("workspace").and_then(Item::as_bool) == Some(true) => {
                self.folders.get(name).cloned()?
            }
            None => return None,
        };
        // One crate is one part, however its path is written.
        Some(folder.canonicalize().unwrap_or(folder))
    }
}

fn workspace_root(folder: &Path) -> Result<PathBuf, CodeError> {
    for candidate in folder.ancestors() {
        let path = candidate.join("Cargo.toml");
        if path.is_file() && read_toml(&path)?.contains_key("workspace") {
            return Ok(candidate.to_owned());
        }
    }
    Err(CodeError::NoWorkspace(folder.to_owned()))
}

fn read_toml(path: &Path) -> Result<DocumentMut, CodeError> {
    let text = fs::read_to_string(path).map_err(|err| CodeError::Read(path.to_owned(), err))?;
    text.parse()
        .map_err(|err| CodeError::Parse(path.to_owned(), err))
}

/// The tables of dependencies that are linked into the program; `[target.….dependencies]` included.
fn dependency_tables(manifest: &DocumentMut) -> Vec<&dyn TableLike> {
    let own = manifest.get("dependencies");
    let per_target = manifest
        .get("target")
        .and_then(Item::as_table_like)
        .into_iter()
        .flat_map(TableLike::iter)
        .filter_map(|(_, target)| target.get("dependencies"));
    own.into_iter()
        .chain(per_target)
        .filter_map(Item::as_table_like)
        .collect()
}

fn package_name<'a>(name: &'a str, item: &'a Item) -> &'a str {
    item.get("package").and_then(Item::as_str).unwrap_or(name)
}

fn source_part(folder: &Path, manifest: &DocumentMut) -> Result<Part, CodeError> {
    let name = manifest
        .get("package")
        .and_then(|package| package.get("name"))
        .and_then(Item::as_str)
        .unwrap_or_default();
    let mut files = vec![folder.join("Cargo.toml")];
    match deciding_files(manifest) {
        None => list_files(&folder.join("src"), &mut files)?,
        Some(named) => files.extend(named.iter().map(|name| folder.join(name))),
    }
    files.sort();
    let mut hasher = Hasher::new();
    for path in &files {
        let bytes = fs::read(path).map_err(|err| CodeError::Read(path.clone(), err))?;
        let name = path.strip_prefix(folder).unwrap_or(path);
        hasher.update(name.to_string_lossy().replace('\\', "/").as_bytes());
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(&bytes);
    }
    Ok(Part {
        name: name.to_owned(),
        digest: short(&hasher),
        // The folder stands for files that are added or removed.
        watched: vec![folder.join("Cargo.toml"), folder.join("src")],
    })
}

/// The files of a crate that affect results, if its manifest names them in
/// `package.metadata.code.decides`; else every file below `src/`.
fn deciding_files(manifest: &DocumentMut) -> Option<Vec<&str>> {
    let mut table = manifest.as_item();
    for key in ["package", "metadata", "code", "decides"] {
        table = table.get(key)?;
    }
    Some(
        table
            .as_array()?
            .iter()
            .filter_map(|name| name.as_str())
            .collect(),
    )
}

fn list_files(folder: &Path, files: &mut Vec<PathBuf>) -> Result<(), CodeError> {
    let read = |err| CodeError::Read(folder.to_owned(), err);
    for entry in fs::read_dir(folder).map_err(read)? {
        let path = entry.map_err(read)?.path();
        if path.is_dir() {
            list_files(&path, files)?;
        } else {
            files.push(path);
        }
    }
    Ok(())
}

/// The first 16 hexadecimal digits of a digest: enough to distinguish versions.
pub(crate) fn short(hasher: &Hasher) -> String {
    hasher.finalize().to_hex()[..16].to_owned()
}
