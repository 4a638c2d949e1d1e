//! File systems under a lake whose locks hold on one machine only.

use std::{
    fs,
    path::{Path, PathBuf},
};

/// The mounted file systems of this process.
const MOUNTS: &str = "/proc/self/mountinfo";

/// Returns the type of the file system under a path, if its locks do not exclude processes on other
/// machines.
pub(crate) fn without_shared_locks(path: &Path) -> Option<String> {
    let mounts = fs::read_to_string(MOUNTS).ok()?;
    // A folder that does not exist yet will be on the file system of the nearest one that does.
    let there = path.ancestors().find_map(|path| {
        let path = if path.as_os_str().is_empty() {
            Path::new(".")
        } else {
            path
        };
        fs::canonicalize(path).ok()
    })?;
    let (kind, options) = mounted_at(&mounts, &there)?;
    locks_are_local(kind, options).then(|| kind.to_owned())
}

/// Returns the type and the options of the file system at a path, in the format of `proc(5)`.
fn mounted_at<'m>(mounts: &'m str, path: &Path) -> Option<(&'m str, &'m str)> {
    let parsed = mounts.lines().filter_map(|line| {
        let (mount, system) = line.split_once(" - ")?;
        let at = PathBuf::from(unescaped(mount.split(' ').nth(4)?));
        let mut words = system.split(' ');
        let (kind, options) = (words.next()?, words.nth(1)?);
        path.starts_with(&at).then_some((at, kind, options))
    });
    // Of several mounts at one place the last one is seen.
    let (_, kind, options) = parsed.max_by_key(|(at, ..)| at.components().count())?;
    Some((kind, options))
}

/// A path in which spaces and the like are written as octal numbers.
fn unescaped(path: &str) -> String {
    let known = [
        ("\\040", " "),
        ("\\011", "\t"),
        ("\\012", "\n"),
        ("\\134", "\\"),
    ];
    known
        .into_iter()
        .fold(path.to_owned(), |path, (code, letter)| {
            path.replace(code, letter)
        })
}

/// Whether locks on a file system hold on this machine only: what its documentation says of the type
/// with these options. NFS asks its server, unless it is told not to (nfs(5)); so do Lustre with
/// `flock` (mount.lustre(8)) and CIFS without `nobrl` (mount.cifs(8)). A file system of FUSE asks its
/// program only if that supports it, which those of network folders and object stores do not.
fn locks_are_local(kind: &str, options: &str) -> bool {
    let has = |wanted: &[&str]| options.split(',').any(|option| wanted.contains(&option));
    match kind {
        "nfs" | "nfs4" => has(&["nolock", "local_lock=flock", "local_lock=all"]),
        "lustre" => !has(&["flock"]),
        "cifs" | "smb3" => has(&["nobrl"]),
        "beegfs" => true,
        kind => kind.starts_with("fuse.") && !LOCAL_FUSE.contains(&kind),
    }
}

/// File systems of FUSE that are on a disk of this machine, or of the one that runs this as a guest.
const LOCAL_FUSE: [&str; 6] = [
    "fuse.grpcfuse",
    "fuse.fuse-overlayfs",
    "fuse.bindfs",
    "fuse.mergerfs",
    "fuse.gocryptfs",
    "fuse.ntfs-3g",
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn network_folders_are_told_from_disks() {
        for (kind, options, is_local) in [
            ("ext4", "rw", false),
            ("overlay", "rw,lowerdir=/a", false),
            ("tmpfs", "rw", false),
            ("fuse.sshfs", "rw,user_id=0", true),
            ("fuse.s3fs", "rw", true),
            ("fuse.gocryptfs", "rw", false),
            ("nfs4", "rw,vers=4.2,local_lock=none", false),
            ("nfs", "rw,vers=3,nolock", true),
            ("nfs", "rw,vers=3,local_lock=all", true),
            ("lustre", "rw,localflock", true),
            ("lustre", "rw,flock", false),
            ("cifs", "rw,nobrl", true),
            ("cifs", "rw", false),
        ] {
            assert_eq!(locks_are_local(kind, options), is_local, "{kind} {options}");
        }
    }

    #[test]
    fn the_innermost_mount_counts() {
        let mounts = "\
22 1 0:20 / / rw,relatime shared:1 - ext4 /dev/sda1 rw\n\
23 22 0:21 / /mnt/lab rw - nfs4 server:/lab rw,local_lock=none\n\
24 23 0:22 / /mnt/lab/a\\040b rw master:2 - fuse.sshfs host:/b rw,user_id=0\n";
        for (path, kind) in [
            ("/home/me/lake", "ext4"),
            ("/mnt/lab/lake", "nfs4"),
            ("/mnt/laboratory", "ext4"),
            ("/mnt/lab/a b/lake", "fuse.sshfs"),
        ] {
            assert_eq!(
                mounted_at(mounts, Path::new(path)).unwrap().0,
                kind,
                "{path}"
            );
        }
    }
}
