//! Stamps of all watched files and folders at the last full check (sizes, times and inodes), so
//! that a finishing run need not read or list anything unchanged.

use std::{
    collections::{BTreeMap, BTreeSet},
    io,
    path::{Path, PathBuf},
    time::SystemTime,
};

use crate::{
    LakeError, atomic, clock,
    compact::{Reader, Writer},
    folder::{Folder, HISTORY, entries},
    stamp::Stamp,
};

/// Format version of the file.
const VERSION: u64 = 2;

/// The stamps of the last full check: a cache.
#[derive(Default, PartialEq, Eq)]
pub(crate) struct Seen {
    files: BTreeMap<String, SeenFile>,
    /// Folders that hold only these files while their stamps are unchanged; empty if a folder had
    /// changed too shortly before it was listed.
    folders: BTreeMap<String, Option<Stamp>>,
}

/// A checked file.
#[derive(Clone, Copy, PartialEq, Eq)]
struct SeenFile {
    stamp: Stamp,
    /// Whether its bytes were verified.
    is_right: bool,
}

/// The watched files and folders, without the blobs of runs' tables.
pub(crate) struct Watched {
    /// In order.
    files: Vec<PathBuf>,
    /// Every listed folder, with its stamp before the listing; `None` if it does not exist.
    folders: BTreeMap<String, Option<Stamp>>,
    /// Time before the first stamp was read.
    began: SystemTime,
}

impl Watched {
    pub(crate) fn list(folder: &Folder) -> Result<Self, LakeError> {
        let began = clock::now();
        let mut left = vec![
            folder.every(),
            folder.copy_of(folder.root()),
            folder.runs(),
            folder.manifests(),
            folder.recipes(),
            folder.tags(),
        ];
        left.extend(HISTORY.map(|name| folder.tables().join(name)));
        let mut files = Vec::from(single_files(folder));
        let mut folders = BTreeMap::new();
        while let Some(listed) = left.pop() {
            let stamp = Stamp::read(&listed).ok();
            folders.insert(folder.name_of(&listed).into_owned(), stamp);
            for (path, is_folder) in entries(&listed)? {
                let list = if is_folder { &mut left } else { &mut files };
                list.push(path);
            }
        }
        files.sort();
        Ok(Self {
            files,
            folders,
            began,
        })
    }

    /// The folders, if any file added or removed from now on changes their stamps; else none.
    fn settled_folders(self) -> BTreeMap<String, Option<Stamp>> {
        let mut stamps = self.folders.values().flatten();
        if stamps.all(|stamp| stamp.is_settled(self.began)) {
            self.folders
        } else {
            BTreeMap::new()
        }
    }
}

/// Individually watched files.
fn single_files(folder: &Folder) -> [PathBuf; 2] {
    [folder.views(), folder.again()]
}

impl Seen {
    /// Records the stamps of all watched files and these blobs; `wrong` files count as unverified.
    pub(crate) fn look(
        folder: &Folder,
        blobs: &BTreeSet<PathBuf>,
        wrong: &BTreeSet<PathBuf>,
    ) -> Result<Self, LakeError> {
        let mut files = BTreeMap::new();
        let watched = Watched::list(folder)?;
        for path in watched.files.iter().chain(blobs) {
            if let Ok(stamp) = Stamp::read(path) {
                let is_right = !wrong.contains(path);
                let file = SeenFile { stamp, is_right };
                files.insert(folder.name_of(path).into_owned(), file);
            }
        }
        Ok(Self {
            files,
            folders: watched.settled_folders(),
        })
    }

    pub(crate) fn read(folder: &Folder) -> Result<Self, LakeError> {
        let bytes = atomic::read_if_there(&folder.seen())?.unwrap_or_default();
        Ok(parse(&bytes).unwrap_or_default())
    }

    pub(crate) fn write(&self, folder: &Folder) -> Result<(), LakeError> {
        let mut writer = Writer::new(VERSION);
        writer.number(self.files.len() as u64);
        for (name, file) in &self.files {
            writer.text(name);
            writer.stamp(file.stamp);
            writer.number(u64::from(file.is_right));
        }
        writer.number(self.folders.len() as u64);
        for (name, stamp) in &self.folders {
            writer.text(name);
            writer.number(u64::from(stamp.is_some()));
            if let Some(stamp) = stamp {
                writer.stamp(*stamp);
            }
        }
        writer.write(folder, &folder.seen())
    }

    /// The same files with the stamps of these folders, which need not be listed while unchanged;
    /// `None` if some changed too recently.
    pub(crate) fn in_folders_of(self, watched: Watched) -> Option<Self> {
        let folders = watched.settled_folders();
        let files = self.files;
        (!folders.is_empty()).then_some(Self { files, folders })
    }

    /// Whether a file's stamp is unchanged since its bytes were last verified.
    pub(crate) fn is_right(&self, folder: &Folder, path: &Path) -> bool {
        let seen = self.files.get(&*folder.name_of(path));
        seen.is_some_and(|seen| {
            seen.is_right && Stamp::read(path).is_ok_and(|stamp| stamp == seen.stamp)
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
        let mut unseen = singles
            .iter()
            .filter(|&name| !self.files.contains_key(name));
        let mut folders = self.folders.iter();
        let mut files = self.files.iter();
        !self.folders.is_empty()
            && folders.all(|(name, stamp)| is_same(name, *stamp))
            && unseen.all(|name| is_same(name, None))
            && files.all(|(name, file)| is_same(name, Some(file.stamp)))
    }

    /// Whether every file is unchanged, and the watched files are exactly these.
    pub(crate) fn is_all_there_is(&self, folder: &Folder, watched: &Watched) -> bool {
        let mut n_seen = 0;
        for path in &watched.files {
            match (self.files.get(&*folder.name_of(path)), Stamp::read(path)) {
                (Some(seen), Ok(stamp)) if seen.stamp == stamp => n_seen += 1,
                (None, Err(err)) if err.kind() == io::ErrorKind::NotFound => {}
                _ => return false,
            }
        }
        let blobs = self.files.iter().filter(|(name, _)| is_blob(name));
        for (name, seen) in blobs {
            if Stamp::read(&folder.join(name)).ok() != Some(seen.stamp) {
                return false;
            }
            n_seen += 1;
        }
        n_seen == self.files.len()
    }
}

/// Whether bytes are an intact file of this format.
pub(crate) fn is_whole(bytes: &[u8]) -> bool {
    parse(bytes).is_some()
}

fn parse(bytes: &[u8]) -> Option<Seen> {
    let mut reader = Reader::of(bytes, VERSION)?;
    let files = reader.each(|reader| {
        let name = reader.text()?.to_owned();
        let file = SeenFile {
            stamp: reader.stamp()?,
            is_right: reader.number()? == 1,
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
    Some(Seen { files, folders })
}

fn is_blob(name: &str) -> bool {
    Path::new(name).starts_with("blobs")
}
