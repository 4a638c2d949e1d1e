//! Files of bounded size.

use std::{
    fs::{self, File},
    io::{self, ErrorKind, Read},
    path::Path,
};

use crate::error::Fault;

/// Largest accepted image: 4096 by 4096 pixels of 16 bits, not compressed.
pub(crate) const MAX_IMAGE_BYTES: u64 = 40 << 20;
/// Largest accepted list of images: a thousand images with twenty objects have 10 MB.
pub(crate) const MAX_LIST_BYTES: u64 = 256 << 20;
/// Largest accepted cloud: twenty million points.
pub(crate) const MAX_CLOUD_BYTES: u64 = 512 << 20;

/// How a pointer of Git LFS begins (<https://github.com/git-lfs/git-lfs/blob/main/docs/spec.md>).
pub(crate) const LFS_POINTER: &[u8] = b"version https://git-lfs.github.com/spec/";

/// Looks whether a file can be read, without opening it: opening a pipe would wait for somebody to write into it.
pub(crate) fn look(path: &Path, most: u64) -> Result<(), Fault> {
    let metadata = fs::metadata(path).map_err(|err| unreadable(&err))?;
    let replace = "put the right file in its place";
    if !metadata.is_file() {
        return Err(Fault::new("is not a file", replace));
    }
    let found = metadata.len();
    if found > most {
        let problem = format!("has {found} bytes, at most {most} are read");
        return Err(Fault::new(problem, replace));
    }
    Ok(())
}

/// Reads a file of at most `most` bytes.
pub(crate) fn read(path: &Path, most: u64) -> Result<Vec<u8>, Fault> {
    look(path, most)?;
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(|err| unreadable(&err))?;
    let read = file.take(most).read_to_end(&mut bytes);
    read.map_err(|err| unreadable(&err))?;
    if bytes.starts_with(LFS_POINTER) {
        let problem = "is a pointer of Git LFS";
        return Err(Fault::new(problem, "fetch it with `git lfs pull`"));
    }
    Ok(bytes)
}

fn unreadable(err: &io::Error) -> Fault {
    match err.kind() {
        ErrorKind::NotFound => Fault::new(
            "is missing",
            "images are named by their number in six digits, as `depth/000003.png`",
        ),
        _ => Fault::new(format!("cannot be read ({err})"), "make it readable"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn says_why_a_file_cannot_be_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cloud.npy");
        let said = |most| read(&path, most).unwrap_err().to_string();
        assert_eq!(said(9), "is missing");
        fs::write(&path, b"0123456789").unwrap();
        assert_eq!(said(9), "has 10 bytes, at most 9 are read");
        assert_eq!(read(&path, 10).unwrap(), b"0123456789");
        fs::write(&path, [LFS_POINTER, b"v1\n"].concat()).unwrap();
        assert_eq!(said(99), "is a pointer of Git LFS");
        let said = read(folder.path(), 99).unwrap_err().to_string();
        assert_eq!(said, "is not a file");
    }
}
