//! Putting back what people see and what nothing could make again, whatever happened to it: records
//! of runs and their tables, every table that runs refer to, and the views.
//!
//! A run that ends looks at sizes, times and inodes alone, and lists no folder that has not changed.
//! Only if a file has come, gone or changed since somebody last looked at all of them, records are
//! read, and files that are new or other.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs, io,
    path::{Path, PathBuf},
    time::SystemTime,
};

use dataflow::{Digest, FileRef, RunStatus};

use crate::{
    LakeError, again, atomic,
    blobs::digest_file,
    clock,
    compact::{Reader, Writer},
    folder::Lake,
    history,
    lock::{self, Lock},
    published::{self, EVERY, FINGERPRINT, TABLES},
    recorded::{column_of, files_of, shown_by},
    records, runs,
    stamp::Stamp,
    store::COLLECTING,
    table, tags, twice,
    verify::{entries, files_below},
    views,
};

/// Name of the file with what was seen, below the lake.
pub(crate) const SEEN: &str = "seen.cache";

/// Changes with the form of that file.
const VERSION: u64 = 2;

/// What was seen when somebody last looked at everything: a cache.
#[derive(Default, PartialEq, Eq)]
struct Seen {
    files: BTreeMap<String, SeenFile>,
    /// Folders that hold these files and nothing else as long as their stamps stay; empty if they had
    /// changed too shortly before they were listed.
    folders: BTreeMap<String, Option<Stamp>>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
struct SeenFile {
    stamp: Stamp,
    /// Whether its bytes were right.
    is_right: bool,
}

/// Puts back what is lost, damaged or exchanged, and removes what nobody made.
pub(crate) fn mend(lake: &Lake) -> Result<(), LakeError> {
    let seen = Seen::read(lake)?;
    if seen.is_unchanged(lake) {
        return Ok(());
    }
    let watched = Watched::list(lake.root())?;
    if seen.is_all_there_is(lake, &watched.files) {
        let (files, folders) = (seen.files, watched.settled_folders());
        if !folders.is_empty() && lake.prepare().is_ok() {
            // Where it cannot be kept, as in a lake that is only read, they are listed each time.
            let _kept = Seen { files, folders }.write(lake);
        }
        return Ok(());
    }
    lake.prepare()?;
    let _turn = turn(lake)?;
    // Nobody collects what is about to be shown.
    let _shared = lock::share(&lake.locks(), COLLECTING)?;
    let mut mender = Mender {
        lake,
        seen,
        wrong: BTreeSet::new(),
        watched: BTreeSet::new(),
    };
    mender.twice()?;
    mender.history()?;
    mender.every()?;
    views::write(lake)?;
    mender.look_again()
}

/// Lets one process at a time mend, and change what is mended.
pub(crate) fn turn(lake: &Lake) -> Result<Lock, LakeError> {
    lock::wait_for(&lake.locks(), "mending", "what was lost anew", &|_| {})
}

/// What is kept in view, beside blobs of tables of runs.
struct Watched {
    /// In order.
    files: Vec<PathBuf>,
    /// Every folder that was listed, with its stamp before that; `None` if it is not there.
    folders: BTreeMap<String, Option<Stamp>>,
    /// When the first stamp was about to be read.
    began: SystemTime,
}

impl Watched {
    fn list(root: &Path) -> Result<Self, LakeError> {
        let began = clock::now();
        let mut left = vec![
            root.join(EVERY),
            twice::copy_of(root, root),
            runs::folder(root),
            runs::manifests(root),
            records::recipes(root),
            root.join(tags::TAGS),
        ];
        left.extend(history::TABLES.map(|name| root.join(TABLES).join(name)));
        let mut files = Vec::from(single_files(root));
        let mut folders = BTreeMap::new();
        while let Some(folder) = left.pop() {
            let stamp = Stamp::read(&folder).ok();
            folders.insert(name_of(root, &folder).into_owned(), stamp);
            for (path, is_folder) in entries(&folder)? {
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

    /// The folders, if a file that comes or goes from now on leaves another stamp of each; else none.
    fn settled_folders(self) -> BTreeMap<String, Option<Stamp>> {
        let mut stamps = self.folders.values().flatten();
        if stamps.all(|stamp| stamp.is_settled(self.began)) {
            self.folders
        } else {
            BTreeMap::new()
        }
    }
}

/// Files that are kept in view by themselves.
fn single_files(root: &Path) -> [PathBuf; 2] {
    [views::path(root), again::path(root)]
}

impl Seen {
    fn read(lake: &Lake) -> Result<Self, LakeError> {
        let bytes = atomic::read_if_there(&lake.root().join(SEEN))?.unwrap_or_default();
        Ok(Reader::of(&bytes).and_then(parse).unwrap_or_default())
    }

    fn write(&self, lake: &Lake) -> Result<(), LakeError> {
        let mut writer = Writer::default();
        writer.number(VERSION);
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
        writer.write(&lake.staging(), &lake.root().join(SEEN))
    }

    /// Whether every folder and every file that was seen is there as it was, so that no other is.
    fn is_unchanged(&self, lake: &Lake) -> bool {
        let root = lake.root();
        let is_same =
            |name: &String, stamp: Option<Stamp>| match (Stamp::read(&root.join(name)), stamp) {
                (Ok(now), Some(stamp)) => now == stamp,
                (Err(err), None) => err.kind() == io::ErrorKind::NotFound,
                _ => false,
            };
        let singles = single_files(root).map(|path| name_of(root, &path).into_owned());
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

    /// Whether every file that was seen is there as it was, and no other of those that are watched.
    fn is_all_there_is(&self, lake: &Lake, watched: &[PathBuf]) -> bool {
        let root = lake.root();
        let mut n_seen = 0;
        for path in watched {
            match (self.files.get(&*name_of(root, path)), Stamp::read(path)) {
                (Some(seen), Ok(stamp)) if seen.stamp == stamp => n_seen += 1,
                (None, Err(err)) if err.kind() == io::ErrorKind::NotFound => {}
                _ => return false,
            }
        }
        let blobs = self.files.iter().filter(|(name, _)| is_blob(name));
        for (name, seen) in blobs {
            if Stamp::read(&root.join(name)).ok() != Some(seen.stamp) {
                return false;
            }
            n_seen += 1;
        }
        n_seen == self.files.len()
    }
}

fn parse(mut reader: Reader) -> Option<Seen> {
    if reader.number()? != VERSION {
        return None;
    }
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

fn name_of<'p>(root: &Path, path: &'p Path) -> std::borrow::Cow<'p, str> {
    path.strip_prefix(root).unwrap_or(path).to_string_lossy()
}

fn is_blob(name: &str) -> bool {
    Path::new(name).starts_with("blobs")
}

struct Mender<'a> {
    lake: &'a Lake,
    seen: Seen,
    /// Files that are not right and cannot be put back.
    wrong: BTreeSet<PathBuf>,
    /// Blobs whose stamps are kept.
    watched: BTreeSet<PathBuf>,
}

impl Mender<'_> {
    /// Whether a file looks as it did when its bytes were last seen to be right.
    fn is_known(&self, path: &Path) -> bool {
        let seen = self.seen.files.get(&*name_of(self.lake.root(), path));
        seen.is_some_and(|seen| {
            seen.is_right && Stamp::read(path).is_ok_and(|stamp| stamp == seen.stamp)
        })
    }

    /// Whether a file holds these bytes; it is read if it does not look as it did.
    fn holds(&self, path: &Path, digest: &Digest) -> bool {
        self.is_known(path) || digest_file(path).is_ok_and(|there| there == *digest)
    }

    /// Files that are kept twice.
    fn twice(&mut self) -> Result<(), LakeError> {
        let root = self.lake.root();
        let again = again::path(root);
        if (again.exists() || twice::copy_of(root, &again).exists())
            && !twice::mend(self.lake, &again, |path, bytes| {
                again::parse(path, bytes).is_ok()
            })?
        {
            self.wrong.insert(again);
        }
        self.twice_in(&runs::folder(root), |path, bytes| {
            runs::parse(root, path, bytes).is_ok()
        })?;
        self.twice_in(&runs::manifests(root), |path, bytes| {
            runs::is_manifest(path, bytes)
        })?;
        self.twice_in(&records::recipes(root), |path, bytes| {
            records::parse_recipe(path, bytes).is_ok()
        })?;
        self.twice_in(&root.join(tags::TAGS), |path, bytes| {
            tags::parse(path, bytes).is_ok()
        })
    }

    fn twice_in(
        &mut self,
        folder: &Path,
        is_right: impl Fn(&Path, &[u8]) -> bool,
    ) -> Result<(), LakeError> {
        let root = self.lake.root();
        for name in twice::names(root, folder)? {
            let path = folder.join(name);
            let copy = twice::copy_of(root, &path);
            if self.is_known(&path) && self.is_known(&copy) {
                continue;
            }
            if !twice::mend(self.lake, &path, &is_right)? {
                self.wrong.extend([path, copy]);
            }
        }
        Ok(())
    }

    /// Tables of runs: each run's are there as a blob and as a copy, and made again where both are
    /// lost.
    fn history(&mut self) -> Result<(), LakeError> {
        let root = self.lake.root();
        let mut there = Vec::new();
        for name in history::TABLES {
            there.extend(files_below(&root.join(TABLES).join(name))?);
        }
        let mut shown = BTreeSet::new();
        let mut running = BTreeSet::new();
        for number in runs::numbers(root)? {
            // A damaged record of a run hides no table of another.
            let Ok(run) = self.lake.run_without_units(number) else {
                running.insert(number);
                continue;
            };
            if run.record.status == RunStatus::Running {
                running.insert(number);
            }
            let mut is_lost = false;
            for (name, file) in &run.history {
                let path = root.join(history::shown(name, number));
                is_lost |= !self.of_run(&path, file)?;
                self.watched.insert(self.lake.file(file));
                shown.insert(path);
            }
            if is_lost {
                let run = history::make_again(self.lake, run)?;
                let blobs = run.history.values().map(|file| self.lake.file(file));
                self.watched.extend(blobs);
            }
        }
        for path in there {
            if !shown.contains(&path) && !run_of(&path).is_some_and(|run| running.contains(&run)) {
                self.remove(&path)?;
            }
        }
        Ok(())
    }

    /// Puts back the table of a run from its blob, or the blob from the table. Returns whether one of
    /// them was there.
    fn of_run(&mut self, path: &Path, file: &FileRef) -> Result<bool, LakeError> {
        let blob = self.lake.file(file);
        match (
            self.holds(path, &file.digest),
            self.holds(&blob, &file.digest),
        ) {
            (true, true) => {}
            (true, false) => published::show_copy(self.lake, path, &blob)?,
            (false, true) => published::show_copy(self.lake, &blob, path)?,
            (false, false) => return Ok(false),
        }
        Ok(true)
    }

    /// Tables of all units that runs refer to.
    fn every(&mut self) -> Result<(), LakeError> {
        let there = files_below(&self.lake.root().join(EVERY))?;
        let promised = every_promised(self.lake)?;
        for (path, unit) in &promised {
            if !self.is_known(path) {
                self.of_unit(path, unit)?;
            }
        }
        for path in there {
            if !promised.contains_key(&path) && !self.may_be_shown(&path)? {
                self.remove(&path)?;
            }
        }
        Ok(())
    }

    /// Shows the table of a unit where it should be, if the unit was not collected.
    fn of_unit(&mut self, path: &Path, unit: &Digest) -> Result<(), LakeError> {
        let Some(stored) = self.lake.records().read(unit)? else {
            return Ok(());
        };
        let made = files_of(&stored.outcome);
        let Some(file) = made.and_then(|files| files.get(table::FILE)) else {
            return Ok(());
        };
        if self.lake.blobs().is_unchanged(file)? {
            return published::show(self.lake, &file.digest, path);
        }
        if digest_file(path).is_ok_and(|there| there == file.digest) {
            return self.lake.blobs().put_back(path, file, &self.lake.staging());
        }
        self.wrong.insert(path.to_owned());
        Ok(())
    }

    /// Whether a table among all is that of a unit, though no run that ended refers to it.
    fn may_be_shown(&self, path: &Path) -> Result<bool, LakeError> {
        let Some((partition, fingerprint)) = unit_of(path) else {
            return Ok(false);
        };
        let stored = self.lake.records().read(&fingerprint)?;
        Ok(stored.is_some_and(|stored| stored.partition == partition))
    }

    fn remove(&self, path: &Path) -> Result<(), LakeError> {
        atomic::remove_if_there(path)?;
        let tables = [self.lake.root().join(TABLES), self.lake.root().join(EVERY)];
        let folders = path.ancestors().skip(1);
        for folder in folders.take_while(|folder| !tables.iter().any(|table| table == folder)) {
            // Fails, as it should, if something is left in it.
            if fs::remove_dir(folder).is_err() {
                break;
            }
        }
        Ok(())
    }

    /// Keeps what everything looks like now.
    fn look_again(self) -> Result<(), LakeError> {
        let root = self.lake.root();
        let mut files = BTreeMap::new();
        let watched = Watched::list(root)?;
        for path in watched.files.iter().chain(&self.watched) {
            if let Ok(stamp) = Stamp::read(path) {
                let is_right = !self.wrong.contains(path);
                let file = SeenFile { stamp, is_right };
                files.insert(name_of(root, path).into_owned(), file);
            }
        }
        let folders = watched.settled_folders();
        let seen = Seen { files, folders };
        if seen == self.seen {
            return Ok(());
        }
        seen.write(self.lake)
    }
}

/// The number of the run whose table lies here.
pub(crate) fn run_of(path: &Path) -> Option<u64> {
    let folder = path.parent()?.file_name()?.to_str()?;
    folder.strip_prefix(history::RUN)?.parse().ok()
}

/// The partition and the unit whose table lies here.
pub(crate) fn unit_of(path: &Path) -> Option<(&str, Digest)> {
    let mut folders = path.parent()?.iter().rev();
    let unit = folders.next()?.to_str()?.strip_prefix(FINGERPRINT)?;
    let (_, partition) = folders.next()?.to_str()?.split_once('=')?;
    Some((partition, unit.parse().ok()?))
}

/// Where the tables of units are that runs have shown, by unit; some of the units made none.
pub(crate) fn every_promised(lake: &Lake) -> Result<BTreeMap<PathBuf, Digest>, LakeError> {
    let mut promised = BTreeMap::new();
    let mut lists = BTreeSet::new();
    for number in runs::numbers(lake.root())? {
        let Ok(run) = runs::read(lake.root(), number) else {
            continue;
        };
        let nodes: Vec<_> = shown_by(&run).cloned().collect();
        // Runs that had the same units share their list.
        if !lists.insert((run.manifest, nodes.clone())) {
            continue;
        }
        let units = runs::units(lake.root(), &run).unwrap_or_default();
        for unit in units.iter().filter(|unit| nodes.contains(&unit.node)) {
            if let Some(column) = column_of(&run, &unit.node) {
                promised.insert(lake.every_path(column, unit), unit.fingerprint);
            }
        }
    }
    Ok(promised)
}

/// Whether bytes are those of what was seen.
pub(crate) fn is_whole(bytes: &[u8]) -> bool {
    Reader::of(bytes).is_some_and(|reader| parse(reader).is_some())
}
