//! The crates of a workspace that a crate links.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use blake3::Hasher;
use toml_edit::{DocumentMut, Item, TableLike};

use crate::{
    Result,
    locked::Lock,
    member::{Member, short, values},
    read_toml,
    source::add,
};

/// The digest of one part of the code.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Part {
    /// The workspace crate's name, `report-STAGE` for the reports of the crate `stage-STAGE`, or
    /// `dependencies` for everything locked.
    pub name: String,
    /// 16 hexadecimal digits of BLAKE3.
    pub digest: String,
}

/// The code of a crate: its parts, ordered by name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Code {
    /// The name of the crate, or of its reports.
    pub name: String,
    /// The digests of what it depends on, itself included.
    pub parts: Vec<Part>,
}

/// A workspace, of which each crate is read once.
#[derive(Debug)]
pub struct Workspace {
    manifest: DocumentMut,
    lock: Lock,
    /// Folders of its crates, by the name of the dependency.
    folders: BTreeMap<String, PathBuf>,
    members: BTreeMap<PathBuf, Member>,
    watched: BTreeSet<PathBuf>,
}

impl Workspace {
    /// Reads the workspace of the crate in `folder`.
    ///
    /// # Errors
    ///
    /// Fails if the crate is in no workspace, or one of its files cannot be read.
    pub fn of(folder: &Path) -> Result<Self> {
        let (root, manifest) = root_of(folder)?;
        let lock_path = root.join("Cargo.lock");
        let shared = manifest.get("workspace");
        let shared = shared.and_then(|workspace| workspace.get("dependencies")?.as_table_like());
        let folders = shared.into_iter().flat_map(TableLike::iter);
        let folders = folders.filter_map(|(name, item)| {
            let path = item.get("path")?.as_str()?;
            Some((name.to_owned(), root.join(path)))
        });
        Ok(Self {
            folders: folders.collect(),
            lock: Lock::parse(&read_toml(&lock_path)?),
            watched: [lock_path, root.join("Cargo.toml")].into(),
            members: BTreeMap::new(),
            manifest,
        })
    }

    /// The files and folders that were read until now.
    pub fn watched(&self) -> impl Iterator<Item = &Path> {
        let of_members = self.members.values().flat_map(|member| &member.watched);
        self.watched.iter().chain(of_members).map(PathBuf::as_path)
    }

    /// Returns the code of the crate in `folder`, and that of its reports if it has any.
    ///
    /// # Errors
    ///
    /// Fails if a manifest or a source cannot be read, or a result could depend on a report.
    pub fn code(&mut self, folder: &Path) -> Result<Vec<Code>> {
        let folder = real(folder);
        let member = self.member(&folder)?;
        let name = member.name.clone();
        let reports = member.reports.is_some().then(|| {
            let stage = name.strip_prefix("stage-").unwrap_or(&name);
            format!("report-{stage}")
        });
        let parts = self.parts(&folder, None)?;
        let mut codes = vec![Code { name, parts }];
        if let Some(name) = reports {
            let parts = self.parts(&folder, Some(&name))?;
            codes.push(Code { name, parts });
        }
        Ok(codes)
    }

    /// Returns the code of every crate of this workspace that the crate in `folder` links itself.
    ///
    /// # Errors
    ///
    /// Fails as [`Self::code`] does.
    pub fn linked(&mut self, folder: &Path) -> Result<Vec<Code>> {
        let manifest = read_toml(&folder.join("Cargo.toml"))?;
        let table = manifest.get("dependencies").and_then(Item::as_table_like);
        let entries = table.into_iter().flat_map(TableLike::iter);
        let folders = entries.filter_map(|(name, item)| self.folder(folder, name, item));
        let folders: Vec<PathBuf> = folders.collect();
        let mut codes = Vec::new();
        for folder in folders {
            codes.extend(self.code(&folder)?);
        }
        Ok(codes)
    }

    /// Digests the crate in `start`, with its reports if they have a name, and what these name.
    fn parts(&mut self, start: &Path, reports: Option<&str>) -> Result<Vec<Part>> {
        let mut open = vec![start.to_owned()];
        let mut seen = BTreeSet::new();
        let mut external = BTreeSet::new();
        let mut parts = Vec::new();
        while let Some(folder) = open.pop() {
            if !seen.insert(folder.clone()) {
                continue;
            }
            self.member(&folder)?;
            let member = &self.members[&folder];
            let of_reports = member.reports.as_ref().filter(|_| folder == start);
            let of_reports = reports.zip(of_reports);
            let part = |name: &str, digest: &str| Part {
                name: name.to_owned(),
                digest: digest.to_owned(),
            };
            parts.push(part(&member.name, &member.results.digest));
            parts.extend(of_reports.map(|(name, code)| part(name, &code.digest)));
            let is_named = |name: &str| {
                let name = name.replace('-', "_");
                let in_reports = of_reports.is_some_and(|(_, code)| code.words.contains(&name));
                in_reports || member.results.words.contains(&name)
            };
            for (name, item) in member.dependencies() {
                if let Some(linked) = self.folder(&folder, name, item) {
                    open.extend(is_named(name).then_some(linked));
                } else {
                    let package = item.get("package").and_then(Item::as_str);
                    external.insert(package.unwrap_or(name).to_owned());
                }
            }
        }
        let mut linking = Hasher::new();
        for text in [self.lock.digest(&external), self.settings(&external)] {
            add(&mut linking, 's', &text);
        }
        parts.push(Part {
            name: "dependencies".to_owned(),
            digest: short(&linking),
        });
        parts.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(parts)
    }

    fn member(&mut self, folder: &Path) -> Result<&Member> {
        if !self.members.contains_key(folder) {
            let member = Member::read(folder)?;
            self.members.insert(folder.to_owned(), member);
        }
        Ok(&self.members[folder])
    }

    /// Returns the build settings: the edition, the features of these dependencies, and the release
    /// profile.
    fn settings(&self, names: &BTreeSet<String>) -> String {
        let workspace = self.manifest.get("workspace");
        let shared = workspace.and_then(|workspace| workspace.get("dependencies"));
        let chosen = names.iter().filter_map(|name| {
            let entry = shared?.get(name)?;
            Some(format!("{name} = {}\n", values(Some(entry))))
        });
        let package = workspace.and_then(|workspace| workspace.get("package"));
        let profile = self.manifest.get("profile");
        let others = [
            package.and_then(|package| package.get("edition")),
            profile.and_then(|profile| profile.get("release")),
        ];
        chosen.chain(others.map(values)).collect()
    }

    /// The folder of a dependency of the crate in `dependent`, if it is a crate of the workspace.
    fn folder(&self, dependent: &Path, name: &str, item: &Item) -> Option<PathBuf> {
        match item.get("path").and_then(Item::as_str) {
            Some(path) => Some(real(&dependent.join(path))),
            None if item.get("workspace").and_then(Item::as_bool) == Some(true) => {
                self.folders.get(name).map(|folder| real(folder))
            }
            None => None,
        }
    }
}

/// One crate is one part, however its path is written.
fn real(folder: &Path) -> PathBuf {
    folder.canonicalize().unwrap_or_else(|_| folder.to_owned())
}

fn root_of(folder: &Path) -> Result<(PathBuf, DocumentMut)> {
    for candidate in folder.ancestors() {
        let path = candidate.join("Cargo.toml");
        if path.is_file() {
            let manifest = read_toml(&path)?;
            if manifest.contains_key("workspace") {
                return Ok((candidate.to_owned(), manifest));
            }
        }
    }
    Err(format!(
        "no workspace above the crate `{}`",
        folder.display()
    ))
}
