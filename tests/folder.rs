//! Where tests write.

use std::{env, path::Path, sync::OnceLock};

use rustix::fs::{StatVfsMountFlags, statvfs};
use tempfile::TempDir;

const MEMORY: &str = "/dev/shm";
/// Free space at which tests write there: several times what all of them have at once.
const ENOUGH_BYTES: u64 = 4 << 30;

/// Makes an empty folder in memory: of small runs on a disk, most of the time is waiting until that has what was
/// written. It is on the disk where memory has little room or starts no programs, or where `TMPDIR` says so.
pub(crate) fn in_memory() -> TempDir {
    static IS_FIT: OnceLock<bool> = OnceLock::new();
    let is_fit = *IS_FIT.get_or_init(|| env::var_os("TMPDIR").is_none() && is_fit(MEMORY.as_ref()));
    if is_fit {
        TempDir::new_in(MEMORY).unwrap()
    } else {
        TempDir::new().unwrap()
    }
}

fn is_fit(folder: &Path) -> bool {
    let is_writable = TempDir::new_in(folder).is_ok();
    let has_room = statvfs(folder).is_ok_and(|system| {
        let free_bytes = system.f_bavail.saturating_mul(system.f_frsize);
        free_bytes >= ENOUGH_BYTES && !system.f_flag.contains(StatVfsMountFlags::NOEXEC)
    });
    is_writable && has_room
}
