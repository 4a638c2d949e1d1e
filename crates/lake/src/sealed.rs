//! Small JSON files that carry the digest of their own bytes, so that damage is always noticed.
//!
//! ```text
//! {"blake3":"64 digits","body":{…}}
//! ```

use std::path::Path;

use dataflow::Digest;
use serde::{Serialize, de::DeserializeOwned};

use crate::{LakeError, atomic};

const BEFORE: &[u8] = b"{\"blake3\":\"";
const BETWEEN: &[u8] = b"\",\"body\":";
const AFTER: &[u8] = b"}\n";
const DIGITS: usize = 64;

/// Returns the bytes of a sealed file.
pub(crate) fn seal<T: Serialize>(path: &Path, value: &T) -> Result<Vec<u8>, LakeError> {
    // The body is written in its place and never copied: one such file may have 100 MB.
    let mut bytes = [BEFORE, &[b'0'; DIGITS], BETWEEN].concat();
    let start = bytes.len();
    serde_json::to_writer(&mut bytes, value).map_err(|source| LakeError::Json {
        path: path.to_owned(),
        source,
    })?;
    let digest = Digest::of_bytes(&bytes[start..]).to_hex();
    bytes[BEFORE.len()..][..DIGITS].copy_from_slice(digest.as_bytes());
    bytes.extend_from_slice(AFTER);
    Ok(bytes)
}

/// Returns the body of a sealed file, or `None` if a byte of it is not as it was written.
pub(crate) fn body(bytes: &[u8]) -> Option<&[u8]> {
    let rest = bytes.strip_prefix(BEFORE)?;
    let (digits, rest) = rest.split_at_checked(DIGITS)?;
    let body = rest.strip_prefix(BETWEEN)?.strip_suffix(AFTER)?;
    (digits == Digest::of_bytes(body).to_hex().as_bytes()).then_some(body)
}

/// Writes a sealed file, whole or not at all.
pub(crate) fn write<T: Serialize>(staging: &Path, path: &Path, value: &T) -> Result<(), LakeError> {
    atomic::write(staging, path, &seal(path, value)?)
}

/// Reads a sealed file that may not be there.
///
/// # Errors
///
/// Fails with [`LakeError::Damaged`] if its bytes are not as they were written.
pub(crate) fn read<T: DeserializeOwned>(path: &Path) -> Result<Option<T>, LakeError> {
    match atomic::read_if_there(path)? {
        Some(bytes) => parse(path, &bytes).map(Some),
        None => Ok(None),
    }
}

/// Returns what the bytes of a sealed file say.
///
/// # Errors
///
/// Fails with [`LakeError::Damaged`] if they are not as they were written.
pub(crate) fn parse<T: DeserializeOwned>(path: &Path, bytes: &[u8]) -> Result<T, LakeError> {
    let damaged = || LakeError::Damaged {
        path: path.to_owned(),
    };
    let body = body(bytes).ok_or_else(damaged)?;
    // Whole bytes that do not parse were written by another version of the program.
    serde_json::from_slice(body).map_err(|source| LakeError::Json {
        path: path.to_owned(),
        source,
    })
}

/// Reads a sealed file of which nothing depends; one that cannot be used is as good as none.
pub(crate) fn read_if_whole<T: DeserializeOwned>(path: &Path) -> Result<Option<T>, LakeError> {
    match read(path) {
        Err(LakeError::Damaged { .. } | LakeError::Json { .. }) => Ok(None),
        read => read,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_flipped_byte_and_every_cut_is_noticed() {
        let bytes = seal(Path::new("x"), &serde_json::json!({"a": [1, 2], "b": " "})).unwrap();
        assert!(body(&bytes).is_some());
        for position in 0..bytes.len() {
            for flip in [1, 0x20, 0x80, 0x2a] {
                let mut damaged = bytes.clone();
                damaged[position] ^= flip;
                assert!(
                    body(&damaged).is_none(),
                    "byte {position} flipped by {flip}"
                );
            }
            assert!(body(&bytes[..position]).is_none(), "cut at {position}");
        }
    }
}
