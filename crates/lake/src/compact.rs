//! Large caches in few bytes, after a line with the digest of those bytes, so that damage is always
//! noticed.
//!
//! ```text
//! blake3 64 digits
//! numbers, texts and digests one after the other
//! ```

use std::path::Path;

use dataflow::Digest;

use crate::{LakeError, atomic, stamp::Stamp};

const BEFORE: &[u8] = b"blake3 ";
const DIGITS: usize = 64;
const DIGEST: usize = 32;

/// What is written.
#[derive(Default)]
pub(crate) struct Writer(Vec<u8>);

/// What is left to be read. Everything read is `None` where the bytes do not say it, as those of
/// another version of the program may not.
pub(crate) struct Reader<'a>(&'a [u8]);

impl Writer {
    /// Seven bits to a byte, the lowest first.
    pub(crate) fn number(&mut self, mut number: u64) {
        while number > 0x7f {
            self.0.push(number.to_le_bytes()[0] | 0x80);
            number >>= 7;
        }
        self.0.push(number.to_le_bytes()[0]);
    }

    pub(crate) fn text(&mut self, text: &str) {
        self.number(text.len() as u64);
        self.0.extend_from_slice(text.as_bytes());
    }

    pub(crate) fn digest(&mut self, digest: &Digest) {
        self.0.extend_from_slice(digest.as_bytes());
    }

    pub(crate) fn stamp(&mut self, stamp: Stamp) {
        for number in <[i64; 6]>::from(stamp) {
            self.number(number.cast_unsigned());
        }
    }

    /// Writes the file, whole or not at all.
    pub(crate) fn write(self, staging: &Path, path: &Path) -> Result<(), LakeError> {
        atomic::write(staging, path, &self.sealed())
    }

    fn sealed(self) -> Vec<u8> {
        let digits = Digest::of_bytes(&self.0).to_hex();
        [BEFORE, digits.as_bytes(), b"\n", &self.0].concat()
    }
}

impl<'a> Reader<'a> {
    /// Begins to read a file, if no byte of it is other than it was written.
    pub(crate) fn of(bytes: &'a [u8]) -> Option<Self> {
        let rest = bytes.strip_prefix(BEFORE)?;
        let (digits, rest) = rest.split_at_checked(DIGITS)?;
        let body = rest.strip_prefix(b"\n")?;
        (digits == Digest::of_bytes(body).to_hex().as_bytes()).then_some(Self(body))
    }

    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, left) = self.0.split_at_checked(count)?;
        self.0 = left;
        Some(taken)
    }

    pub(crate) fn number(&mut self) -> Option<u64> {
        let mut number = 0;
        for place in 0..10 {
            let byte = *self.take(1)?.first()?;
            number |= u64::from(byte & 0x7f) << (7 * place);
            if byte & 0x80 == 0 {
                return Some(number);
            }
        }
        None
    }

    pub(crate) fn text(&mut self) -> Option<&'a str> {
        let length = usize::try_from(self.number()?).ok()?;
        std::str::from_utf8(self.take(length)?).ok()
    }

    pub(crate) fn digest(&mut self) -> Option<Digest> {
        let bytes: [u8; DIGEST] = self.take(DIGEST)?.try_into().ok()?;
        Some(Digest::from(bytes))
    }

    pub(crate) fn stamp(&mut self) -> Option<Stamp> {
        let mut numbers = [0; 6];
        for number in &mut numbers {
            *number = self.number()?.cast_signed();
        }
        Some(Stamp::from(numbers))
    }

    /// Reads a number of things and then each of them.
    pub(crate) fn each<T, C: FromIterator<T>>(
        &mut self,
        mut one: impl FnMut(&mut Self) -> Option<T>,
    ) -> Option<C> {
        let count = self.number()?;
        (0..count).map(|_| one(self)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written() -> Vec<u8> {
        let mut writer = Writer::default();
        for number in [0, 127, 128, u64::MAX] {
            writer.number(number);
        }
        writer.text("a name");
        writer.digest(&Digest::of_bytes(b"bytes"));
        writer.sealed()
    }

    #[test]
    fn what_was_written_is_read() {
        let bytes = written();
        let mut reader = Reader::of(&bytes).unwrap();
        for number in [0, 127, 128, u64::MAX] {
            assert_eq!(reader.number(), Some(number));
        }
        assert_eq!(reader.text(), Some("a name"));
        assert_eq!(reader.digest(), Some(Digest::of_bytes(b"bytes")));
        assert_eq!(reader.number(), None);
    }

    #[test]
    fn every_flipped_byte_and_every_cut_is_noticed() {
        let bytes = written();
        for position in 0..bytes.len() {
            for flip in [1, 0x20, 0x80] {
                let mut damaged = bytes.clone();
                damaged[position] ^= flip;
                let is_noticed = Reader::of(&damaged).is_none();
                assert!(is_noticed, "byte {position} flipped by {flip}");
            }
            assert!(
                Reader::of(&bytes[..position]).is_none(),
                "cut at {position}"
            );
        }
    }
}
