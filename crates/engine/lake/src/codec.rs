//! A compact encoding of large caches: a sequence of numbers, texts and digests, sealed.

use std::path::Path;

use dataflow::{Digest, Stamp};

use crate::{LakeError, folder::Folder, sealed::LINE};

const DIGEST: usize = 32;

/// The bytes written so far.
pub(crate) struct Writer(Vec<u8>);

/// The bytes left to read. A read returns `None` if the bytes do not encode the value, as in a file
/// of another version.
pub(crate) struct Reader<'a>(&'a [u8]);

impl Writer {
    /// Begins a file of this format version.
    pub(crate) fn new(version: u64) -> Self {
        let mut writer = Self(LINE.begin());
        writer.number(version);
        writer
    }

    /// Seven bits per byte, lowest first (LEB128).
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
    pub(crate) fn write(self, folder: &Folder, path: &Path) -> Result<(), LakeError> {
        folder.write(path, &LINE.end(self.0))
    }
}

impl<'a> Reader<'a> {
    /// Begins to read a file, if it is undamaged and of this version.
    pub(crate) fn of(bytes: &'a [u8], version: u64) -> Option<Self> {
        let mut reader = Self(LINE.body(bytes)?);
        (reader.number()? == version).then_some(reader)
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

    /// Reads a count and then that many items.
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

    #[test]
    fn what_was_written_is_read_by_the_same_version() {
        let numbers = [0, 127, 128, u64::MAX];
        let mut writer = Writer::new(2);
        for number in numbers {
            writer.number(number);
        }
        writer.text("a name");
        writer.digest(&Digest::of_bytes(b"bytes"));
        let bytes = LINE.end(writer.0);
        let mut reader = Reader::of(&bytes, 2).unwrap();
        for number in numbers {
            assert_eq!(reader.number(), Some(number));
        }
        assert_eq!(reader.text(), Some("a name"));
        assert_eq!(reader.digest(), Some(Digest::of_bytes(b"bytes")));
        assert_eq!(reader.number(), None);
        assert!(Reader::of(&bytes, 3).is_none());
    }
}
