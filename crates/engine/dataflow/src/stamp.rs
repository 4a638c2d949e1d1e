//! Stamps of files: metadata that is read without the content.

use std::{
    fs::{self, Metadata},
    io,
    os::unix::fs::MetadataExt,
    path::Path,
    time::{Duration, SystemTime},
};

use serde::{Deserialize, Serialize};

/// Size, times and inode of a file. While they are unchanged, nothing has written to it through
/// this file system: `ctime` moves even when `mtime` is set back.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(from = "[i64; 6]", into = "[i64; 6]")]
pub struct Stamp([i64; 6]);

/// Tick of the file system's clock: two writes within one leave the same times.
const TICK: Duration = Duration::from_millis(20);

/// The same, for file systems with whole seconds.
const COARSE_TICK: Duration = Duration::from_secs(2);

impl Stamp {
    /// Returns the stamp that a file's metadata holds.
    pub fn of(metadata: &Metadata) -> Self {
        #[expect(
            clippy::cast_possible_wrap,
            reason = "only compared, never computed with"
        )]
        let (size, inode) = (metadata.size() as i64, metadata.ino() as i64);
        Self([
            size,
            inode,
            metadata.mtime(),
            metadata.mtime_nsec(),
            metadata.ctime(),
            metadata.ctime_nsec(),
        ])
    }

    /// Reads the stamp of a file; of a link, that of its target.
    ///
    /// # Errors
    ///
    /// Fails if there is no such file or its folder may not be looked into.
    pub fn read(path: &Path) -> io::Result<Self> {
        fs::metadata(path).map(|metadata| Self::of(&metadata))
    }

    /// Size of the file in bytes.
    pub fn size(self) -> u64 {
        self.0[0].cast_unsigned()
    }

    /// Whether only `ctime` differs, as after the file was linked or unlinked.
    pub fn differs_by_links_alone(self, other: Self) -> bool {
        self.0[..4] == other.0[..4]
    }

    /// Whether a later write would change the stamp: the last one is longer ago than a tick.
    pub fn is_settled(self, now: SystemTime) -> bool {
        let [_, _, modified, modified_ns, changed, changed_ns] = self.0;
        let is_fine = modified_ns != 0 || changed_ns != 0;
        let tick = if is_fine { TICK } else { COARSE_TICK };
        [(modified, modified_ns), (changed, changed_ns)]
            .into_iter()
            .all(|(seconds, nanoseconds)| {
                let since_epoch = Duration::new(
                    u64::try_from(seconds).unwrap_or(0),
                    u32::try_from(nanoseconds).unwrap_or(0),
                );
                let time = SystemTime::UNIX_EPOCH + since_epoch;
                now.duration_since(time).is_ok_and(|age| age > tick)
            })
    }
}

impl From<[i64; 6]> for Stamp {
    fn from(numbers: [i64; 6]) -> Self {
        Self(numbers)
    }
}

impl From<Stamp> for [i64; 6] {
    fn from(stamp: Stamp) -> Self {
        stamp.0
    }
}
