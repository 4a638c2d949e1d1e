//! Files that carry the digest of their own bytes, so that damage is always noticed.
//!
//! ```text
//! {"blake3":"64 digits","body":{…}}     records: JSON
//! blake3 64 digits                      caches: what `codec` writes follows
//! ```

use std::path::Path;

use dataflow::Digest;
use serde::{Serialize, de::DeserializeOwned};

use crate::{LakeError, atomic};

/// The framing of a body and its digest.
pub(crate) struct Seal {
    before: &'static [u8],
    between: &'static [u8],
    after: &'static [u8],
}

/// JSON with its digest as a field.
const JSON: Seal = Seal {
    before: b"{\"blake3\":\"",
    between: b"\",\"body\":",
    after: b"}\n",
};

/// Any bytes after a line with their digest.
pub(crate) const LINE: Seal = Seal {
    before: b"blake3 ",
    between: b"\n",
    after: b"",
};

const DIGITS: usize = 64;

impl Seal {
    /// Returns the header; the caller appends the body in place, without a copy: such a file may
    /// have 100 MB.
    pub(crate) fn begin(&self) -> Vec<u8> {
        [self.before, &[b'0'; DIGITS], self.between].concat()
    }

    /// Completes the file with the digest of the body.
    pub(crate) fn end(&self, mut bytes: Vec<u8>) -> Vec<u8> {
        let digits = self.before.len()..self.before.len() + DIGITS;
        let body = digits.end + self.between.len();
        let digest = Digest::of_bytes(&bytes[body..]).to_hex();
        bytes[digits].copy_from_slice(digest.as_bytes());
        bytes.extend_from_slice(self.after);
        bytes
    }

    /// Returns the body, or `None` if the file is damaged.
    pub(crate) fn body<'b>(&self, bytes: &'b [u8]) -> Option<&'b [u8]> {
        let rest = bytes.strip_prefix(self.before)?;
        let (digits, rest) = rest.split_at_checked(DIGITS)?;
        let body = rest.strip_prefix(self.between)?.strip_suffix(self.after)?;
        (digits == Digest::of_bytes(body).to_hex().as_bytes()).then_some(body)
    }
}

/// Returns the bytes of a sealed file.
pub(crate) fn seal<T: Serialize>(path: &Path, value: &T) -> Result<Vec<u8>, LakeError> {
    let mut bytes = JSON.begin();
    serde_json::to_writer(&mut bytes, value).map_err(LakeError::json(path))?;
    Ok(JSON.end(bytes))
}

/// Writes a sealed file, whole or not at all.
pub(crate) fn write<T: Serialize>(staging: &Path, path: &Path, value: &T) -> Result<(), LakeError> {
    atomic::write(staging, path, &seal(path, value)?)
}

/// Reads a sealed file, if it exists.
///
/// # Errors
///
/// Fails with [`LakeError::Damaged`] if its bytes do not match its digest.
pub(crate) fn read<T: DeserializeOwned>(path: &Path) -> Result<Option<T>, LakeError> {
    match atomic::read_if_there(path)? {
        Some(bytes) => parse(path, &bytes).map(Some),
        None => Ok(None),
    }
}

/// Parses the bytes of a sealed file.
///
/// # Errors
///
/// Fails with [`LakeError::Damaged`] if they do not match their digest.
pub(crate) fn parse<T: DeserializeOwned>(path: &Path, bytes: &[u8]) -> Result<T, LakeError> {
    let damaged = || LakeError::damaged(path);
    let body = JSON.body(bytes).ok_or_else(damaged)?;
    // Undamaged bytes that do not parse come from another version of the program.
    serde_json::from_slice(body).map_err(LakeError::json(path))
}

/// Parses the bytes of a sealed file from elsewhere, which must be those that this program writes for
/// the value: nothing in them is passed over, such as an unknown field or a second one of the same name.
///
/// # Errors
///
/// Fails with [`LakeError::Damaged`] if they are not.
pub(crate) fn parse_exact<T: Serialize + DeserializeOwned>(
    path: &Path,
    bytes: &[u8],
) -> Result<T, LakeError> {
    let value = parse(path, bytes)?;
    if seal(path, &value)? == bytes {
        Ok(value)
    } else {
        Err(LakeError::damaged(path))
    }
}

/// Reads a dispensable sealed file; an unusable one counts as missing.
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
        let json = seal(Path::new("x"), &serde_json::json!({"a": [1, 2], "b": " "})).unwrap();
        let mut line = LINE.begin();
        line.extend([0, 1, 0x80, b'\n', 0xff]);
        for (seal, bytes) in [(JSON, json), (LINE, LINE.end(line))] {
            assert!(seal.body(&bytes).is_some());
            for position in 0..bytes.len() {
                for flip in [1, 0x20, 0x80, 0x2a] {
                    let mut damaged = bytes.clone();
                    damaged[position] ^= flip;
                    let is_noticed = seal.body(&damaged).is_none();
                    assert!(is_noticed, "byte {position} flipped by {flip}");
                }
                let is_noticed = seal.body(&bytes[..position]).is_none();
                assert!(is_noticed, "cut at {position}");
            }
        }
    }
}
