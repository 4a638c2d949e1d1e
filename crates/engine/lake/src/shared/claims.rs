//! Claims of units that move a robot: of machines that share a depot, one makes each, once and for all.

use std::{
    fs,
    io::{self, ErrorKind},
    os::unix::fs::MetadataExt,
    path::Path,
};

use dataflow::{Digest, UnitName};
use depot::DepotError;

use super::{Shared, keys};
use crate::{
    LakeError,
    atomic::{io_error, remove_if_there, temporary_name, write_atomic},
    clock::{host, nanoseconds},
};

impl Shared {
    /// Claims a unit for this lake; a claim that this lake made before holds.
    pub(crate) fn claim(&self, fingerprint: &Digest, unit: &UnitName) -> Result<(), LakeError> {
        let unknown = |source: DepotError| LakeError::Unclaimed {
            unit: unit.to_string(),
            source: Box::new(source),
        };
        self.check_creates().map_err(unknown)?;
        let host = host();
        let claim = format!("{host}\n{}", self.identity()?);
        let key = keys::claim(fingerprint);
        let claimed = self.remote.create(&key, claim.as_bytes());
        let Some(other) = claimed.map_err(unknown)? else {
            return Ok(());
        };
        let other = String::from_utf8_lossy(&other);
        Err(LakeError::Claimed {
            unit: unit.to_string(),
            host: other.lines().next().unwrap_or_default().to_owned(),
            key,
        })
    }

    /// Returns the identity of this lake, which distinguishes it from all others, on this machine
    /// too, and from its own copies.
    fn identity(&self) -> Result<String, LakeError> {
        let path = self.folder.join("identity");
        let root = self.folder.root();
        let place = place(root).map_err(io_error("read", root))?;
        for _ in 0..TRIES {
            match fs::read_to_string(&path) {
                Ok(identity) if identity.lines().nth(1) == Some(&place) => return Ok(identity),
                // It came with a copy.
                Ok(_) => fs::remove_file(&path).map_err(io_error("remove", &path))?,
                Err(err) if err.kind() == ErrorKind::NotFound => self.identify(&path, &place)?,
                Err(err) => return Err(io_error("read", &path)(err)),
            }
        }
        let changing = io::Error::other("another process changes it");
        Err(io_error("read", &path)(changing))
    }

    /// Gives the lake an identity, unless another process has just done so.
    fn identify(&self, path: &Path, place: &str) -> Result<(), LakeError> {
        let random = "/proc/sys/kernel/random/uuid";
        let random = fs::read_to_string(random).map_err(io_error("read", random.as_ref()))?;
        let beside = temporary_name(&self.folder.staging());
        write_atomic(&beside, format!("{random}{place}\n").as_bytes())?;
        let linked = fs::hard_link(&beside, path);
        remove_if_there(&beside)?;
        match linked {
            Err(err) if err.kind() == ErrorKind::AlreadyExists => Ok(()),
            linked => linked.map_err(io_error("write", path)),
        }
    }
}

/// Times that an identity is looked for, while other processes do the same.
const TRIES: usize = 8;

/// Returns properties of a folder that a move keeps and a copy does not: its inode number, and its creation time,
/// where that is known.
fn place(folder: &Path) -> io::Result<String> {
    let found = fs::metadata(folder)?;
    let made = found.created().map_or(0, nanoseconds);
    Ok(format!("{} {made}", found.ino()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moved_folder_is_the_same_place_and_a_copy_is_another() {
        let parent = tempfile::tempdir().unwrap();
        let [first, moved, copy] = ["first", "moved", "copy"].map(|name| parent.path().join(name));
        fs::create_dir(&first).unwrap();
        let before = place(&first).unwrap();
        fs::create_dir(&copy).unwrap();
        fs::rename(&first, &moved).unwrap();
        assert_eq!(place(&moved).unwrap(), before);
        assert_ne!(place(&copy).unwrap(), before);
    }
}
