//! Checks of the lake's folder and the file system under it.

use std::{
    fs::{self, File, TryLockError},
    io,
    path::{Path, PathBuf},
};

use lake::Lake;

use super::{Check, State};
use crate::sharing;

/// Tries a run's file operations in the lake; its probe files are removed.
pub(super) fn check(lake: &Path) -> Vec<Check> {
    let probe = match Probe::new(lake) {
        Ok(probe) => probe,
        Err(err) => {
            let finding = format!("`{}` cannot be written: {err}", lake.display());
            let hint = "choose a lake that can be written with `--lake DIR`".to_owned();
            return vec![Check::new(State::Missing, "lake", finding).with_hint(hint)];
        }
    };
    let mut found = vec![written(lake, &probe)];
    found.push(match probe.link() {
        Ok(()) => Check::new(
            State::Ok,
            "hard links",
            "tables share the bytes of artifacts",
        ),
        Err(err) => Check::new(
            State::Unset,
            "hard links",
            format!("{err}; tables are copies and take their space again"),
        ),
    });
    let lake = Lake::open(lake);
    found.push(match (probe.lock(), lake.file_system_without_locks()) {
        (Ok(()), None) => Check::new(State::Ok, "locks", "several runs can share the lake"),
        (Ok(()), Some(kind)) => {
            let finding =
                format!("`{kind}` keeps them on this machine: no other may write to the lake");
            Check::new(State::Unset, "locks", finding).with_hint(sharing::local_lake_advice())
        }
        (Err(err), _) => Check::new(State::Missing, "locks", err.to_string())
            .with_hint("choose a lake on a file system with locks with `--lake DIR`".to_owned()),
    });
    found
}

fn written(lake: &Path, probe: &Probe) -> Check {
    match probe.rename() {
        Ok(()) => Check::new(
            State::Ok,
            "lake",
            format!("`{}` can be written, and files renamed", lake.display()),
        ),
        Err(err) => Check::new(
            State::Missing,
            "lake",
            format!("`{}`: {err}", lake.display()),
        )
        .with_hint("choose a lake that can be written with `--lake DIR`".to_owned()),
    }
}

/// A temporary folder of this check in the lake.
struct Probe {
    folder: PathBuf,
    /// Folders that this check created, the outermost first.
    made: Vec<PathBuf>,
}

impl Probe {
    fn new(lake: &Path) -> io::Result<Self> {
        let folder = lake
            .join("staging")
            .join(format!("doctor-{}", std::process::id()));
        let mut missing: Vec<PathBuf> = folder
            .ancestors()
            .filter(|path| !path.as_os_str().is_empty())
            .take_while(|path| !path.exists())
            .map(Path::to_owned)
            .collect();
        missing.reverse();
        // Made before anything can fail, so that it is removed in any case.
        let probe = Self {
            folder,
            made: missing,
        };
        fs::create_dir_all(&probe.folder)?;
        File::create(probe.path("first"))?;
        Ok(probe)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    fn rename(&self) -> io::Result<()> {
        File::create(self.path("before"))?.sync_all()?;
        fs::rename(self.path("before"), self.path("first"))
    }

    fn link(&self) -> io::Result<()> {
        fs::hard_link(self.path("first"), self.path("second"))
    }

    /// Takes a lock, and checks that it cannot be taken twice.
    fn lock(&self) -> io::Result<()> {
        let holder = File::create(self.path("lock"))?;
        match holder.try_lock() {
            Ok(()) => {}
            Err(TryLockError::Error(err)) => return Err(err),
            Err(TryLockError::WouldBlock) => return Err(io::Error::other("held by nobody known")),
        }
        match File::open(self.path("lock"))?.try_lock() {
            Err(TryLockError::WouldBlock) => Ok(()),
            Err(TryLockError::Error(err)) => Err(err),
            Ok(()) => Err(io::Error::other("two holders can have one lock")),
        }
    }
}

impl Drop for Probe {
    fn drop(&mut self) {
        // A leftover is at worst an empty folder.
        let _removed = fs::remove_dir_all(&self.folder);
        for folder in self.made.iter().rev() {
            let _removed = fs::remove_dir(folder);
        }
    }
}
