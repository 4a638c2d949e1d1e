//! Stamps of all watched files and folders at the last full check (sizes, times and inodes), so
//! that a finishing run need not read or list anything unchanged.

use std::{
    collections::{BTreeMap, BTreeSet},
    io,
    path::{Path, PathBuf},
};

use dataflow::Stamp;

use crate::{
    LakeError, atomic, clock,
    codec::{Reader, Writer},
    folder::{Folder, HISTORY, entries},
};

/// Format version of the file.
const VERSION: u64 = 2;

/// The stamps of the last full check: a cache.
#[derive(Default, PartialEq, Eq)]
pub(crate) struct Snapshot {
    files: BTreeMap<String, CheckedFile>,
    /// Folders that hold only these files while their stamps are unchanged; empty if a folder had
    /// changed too shortly before it was listed.
    folders: BTreeMap<String, Option<Stamp>>,
}

/// A checked file.
#[derive(Clone, Copy, PartialEq, Eq)]
struct CheckedFile {
    stamp: Stamp,
    /// Whether its bytes were verified.
    is_verified: bool,
}

/// Individually watched files.
fn single_files(folder: &Folder) -> [PathBuf; 2] {
    [folder.views(), folder.repeated_run()]
}

impl Snapshot {
    /// Records the stamps of all watched files and these blobs; `unrepaired` files count as
    /// unverified.
    pub(crate) fn take(
        folder: &Folder,
        blobs: &BTreeSet<PathBuf>,
        unrepaired: &BTreeSet<PathBuf>,
    ) -> Result<Self, LakeError> {
        let began = clock::now();
        let mut left = vec![
            folder.versions(),
            folder.copy_of(folder.root()),
            folder.runs(),
            folder.manifests(),
            folder.recipes(),
            folder.tags(),
        ];
        left.extend(HISTORY.map(|name| folder.tables().join(name)));
        let mut paths = Vec::from(single_files(folder));
        let mut folders = BTreeMap::new();
        while let Some(listed) = left.pop() {
            let stamp = Stamp::read(&listed).ok();
            folders.insert(folder.name_of(&listed).into_owned(), stamp);
            for (path, is_folder) in entries(&listed)? {
                let list = if is_folder { &mut left } else { &mut paths };
                list.push(path);
            }
        }
        // A file added or removed a moment after the listing may leave a folder's stamp as it is.
        if !folders
            .values()
            .flatten()
            .all(|stamp| stamp.is_settled(began))
        {
            folders.clear();
        }
        let files = paths.iter().chain(blobs).filter_map(|path| {
            let file = CheckedFile {
                stamp: Stamp::read(path).ok()?,
                is_verified: !unrepaired.contains(path),
            };
            Some((folder.name_of(path).into_owned(), file))
        });
        Ok(Self {
            files: files.collect(),
            folders,
        })
    }

    /// Records the current stamps of all watched files and of the same blobs, where the same files
    /// count as unverified.
    pub(crate) fn retake(&self, folder: &Folder) -> Result<Self, LakeError> {
        let files = self.files.iter();
        let blobs = files.clone().filter(|(name, _)| is_blob(name));
        let unverified = files.filter(|(_, file)| !file.is_verified);
        let path = |(name, _): (&String, _)| folder.join(name);
        Self::take(
            folder,
            &blobs.map(path).collect(),
            &unverified.map(path).collect(),
        )
    }

    /// Whether both list exactly the same files with the same stamps.
    pub(crate) fn has_files_of(&self, other: &Self) -> bool {
        self.files == other.files
    }

    /// Whether any file added or removed from now on changes the stamp of a folder.
    pub(crate) fn is_settled(&self) -> bool {
        !self.folders.is_empty()
    }

    pub(crate) fn read(folder: &Folder) -> Result<Self, LakeError> {
        let bytes = atomic::read_if_there(&folder.snapshot())?.unwrap_or_default();
        Ok(parse(&bytes).unwrap_or_default())
    }

    pub(crate) fn write(&self, folder: &Folder) -> Result<(), LakeError> {
        let mut writer = Writer::new(VERSION);
        writer.number(self.files.len() as u64);
        for (name, file) in &self.files {
            writer.text(name);
            writer.stamp(file.stamp);
            writer.number(u64::from(file.is_verified));
        }
        writer.number(self.folders.len() as u64);
        for (name, stamp) in &self.folders {
            writer.text(name);
            writer.number(u64::from(stamp.is_some()));
            if let Some(stamp) = stamp {
                writer.stamp(*stamp);
            }
        }
        writer.write(folder, &folder.snapshot())
    }

    /// Whether a file's stamp is unchanged since its bytes were last verified.
    pub(crate) fn is_verified(&self, folder: &Folder, path: &Path) -> bool {
        let checked = self.files.get(&*folder.name_of(path));
        checked.is_some_and(|checked| {
            checked.is_verified && Stamp::read(path).is_ok_and(|stamp| stamp == checked.stamp)
        })
    }

    /// Whether every folder and file is unchanged, so that there are no others.
    pub(crate) fn is_unchanged(&self, folder: &Folder) -> bool {
        let is_same =
            |name: &String, stamp: Option<Stamp>| match (Stamp::read(&folder.join(name)), stamp) {
                (Ok(now), Some(stamp)) => now == stamp,
                (Err(err), None) => err.kind() == io::ErrorKind::NotFound,
                _ => false,
            };
        let singles = single_files(folder).map(|path| folder.name_of(&path).into_owned());
        let mut absent = singles
            .iter()
            .filter(|&name| !self.files.contains_key(name));
        let mut folders = self.folders.iter();
        let mut files = self.files.iter();
        !self.folders.is_empty()
            && folders.all(|(name, stamp)| is_same(name, *stamp))
            && absent.all(|name| is_same(name, None))
            && files.all(|(name, file)| is_same(name, Some(file.stamp)))
    }
}

/// Whether bytes are an intact file of this format.
pub(crate) fn is_whole(bytes: &[u8]) -> bool {
    parse(bytes).is_some()
}

fn parse(bytes: &[u8]) -> Option<Snapshot> {
    let mut reader = Reader::of(bytes, VERSION)?;
    let files = reader.each(|reader| {
        let name = reader.text()?.to_owned();
        let file = CheckedFile {
            stamp: reader.stamp()?,
            is_verified: reader.number()? == 1,
        };
        Some((name, file))
    })?;
    let folders = reader.each(|reader| {
        let name = reader.text()?.to_owned();
        let stamp = match reader.number()? {
            0 => None,
            _ => Some(reader.stamp()?),
        };
        Some((name, stamp))
    })?;
    Some(Snapshot { files, folders })
}

fn is_blob(name: &str) -> bool {
    Path::new(name).starts_with("blobs")
}
