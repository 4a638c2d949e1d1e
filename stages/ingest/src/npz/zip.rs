//! The directory of a ZIP archive in memory.
//!
//! After PKWARE, *.ZIP File Format Specification*, version 6.3.10, sections 4.3.7, 4.3.12 and
//! 4.3.16. What `numpy` and every common program write is read; what they never write (archives of
//! several disks, bytes before, between or after the parts that do not belong to them in a way that
//! makes parts overlap, ZIP64's directory) is refused.

use std::ops::Range;

use super::NpzError;

/// Maximum number of accepted arrays of one file; `DexYCB`'s have five.
const MAX_ENTRIES: usize = 256;

const END_BYTES: usize = 22;
const CENTRAL_BYTES: usize = 46;
const LOCAL_BYTES: usize = 30;

const CENTRAL_SIGNATURE: &[u8] = b"PK\x01\x02";
const LOCAL_SIGNATURE: &[u8] = b"PK\x03\x04";
const END_SIGNATURE: &[u8] = b"PK\x05\x06";

/// Flags that change how an entry's bytes are read: encrypted, patched, strongly encrypted, masked.
const REFUSED_FLAGS: u16 = 1 << 0 | 1 << 5 | 1 << 6 | 1 << 13;
/// The flag that says that lengths and checksum follow the data, and are 0 before it.
const FOLLOWED_BY_LENGTHS: u16 = 1 << 3;
/// Stands for a length that ZIP64's extra field holds; `numpy` writes it before every array.
const IN_EXTRA_FIELD: u32 = u32::MAX;

/// Compression method of an entry.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Method {
    /// As it is.
    Stored,
    /// Deflated, without zlib's frame.
    Deflated,
}

/// One file in an archive.
#[derive(Debug, Clone)]
pub(super) struct Entry {
    /// Range of its name in the archive's directory.
    name: Range<usize>,
    flags: u16,
    method: u16,
    /// Checksum of its content.
    pub(super) crc32: u32,
    /// Length of its data in bytes; it lies within the archive.
    pub(super) stored_len: usize,
    /// Length of its content in bytes, as announced.
    pub(super) len: usize,
    /// Offset of its local header.
    start: usize,
    /// Offset of its data.
    data: usize,
}

/// The files in an archive, ordered by where they begin.
#[derive(Debug, Default)]
pub(super) struct Directory {
    entries: Vec<Entry>,
}

impl Directory {
    /// Lists an archive's files; nothing remains of the archive listed before.
    ///
    /// # Errors
    ///
    /// Fails if a part of the archive lies outside of it or overlaps another.
    pub(super) fn list(&mut self, archive: &[u8]) -> Result<(), NpzError> {
        self.entries.clear();
        let end = End::find(archive).ok_or_else(|| damaged("no directory at its end"))?;
        if end.n_entries > MAX_ENTRIES {
            return Err(damaged("more than 256 arrays"));
        }
        let directory = archive.get(..end.start).unwrap_or_default();
        let mut position = end.directory;
        for _ in 0..end.n_entries {
            let (entry, next) = Entry::parse(directory, position)
                .ok_or_else(|| damaged("its directory ends early or is none"))?;
            self.entries.push(entry);
            position = next;
        }
        if position != end.start {
            return Err(damaged("its directory has another length than announced"));
        }
        // Entries are nearly always in order already.
        self.entries.sort_unstable_by_key(|entry| entry.start);
        let mut free_from = 0;
        for entry in &self.entries {
            let data_end = entry.data.checked_add(entry.stored_len);
            match data_end {
                Some(data_end) if entry.start >= free_from && data_end <= end.directory => {
                    free_from = data_end;
                }
                _ => return Err(damaged("its parts overlap or lie outside")),
            }
        }
        Ok(())
    }

    /// Returns for how many files memory is reserved.
    #[cfg(test)]
    pub(super) fn capacity(&self) -> usize {
        self.entries.capacity()
    }

    /// Returns the file that holds an array.
    ///
    /// # Errors
    ///
    /// Fails if there is none, or more than one.
    pub(super) fn entry(&self, archive: &[u8], array: &str) -> Result<&Entry, NpzError> {
        let is_named = |entry: &&Entry| {
            archive
                .get(entry.name.clone())
                .and_then(|name| name.strip_suffix(b".npy"))
                == Some(array.as_bytes())
        };
        let mut found = self.entries.iter().filter(is_named);
        let entry = found
            .next()
            .ok_or_else(|| NpzError::Missing(array.to_owned()))?;
        if found.next().is_some() {
            return Err(entry_damaged(array, "it is there twice"));
        }
        Ok(entry)
    }
}

impl Entry {
    /// Reads the directory's record at `position`, and the local header that it points to only as
    /// far as to know where the data begins; returns where the next record is.
    fn parse(directory: &[u8], position: usize) -> Option<(Self, usize)> {
        let record = Record::at(directory, position, CENTRAL_SIGNATURE, CENTRAL_BYTES)?;
        let name = position + CENTRAL_BYTES;
        let name = name..name + record.length(28)?;
        let next = name.end + record.length(30)? + record.length(32)?;
        let is_on_this_disk = record.u16(34)? == 0;
        let stored_len = record.u32(20)?;
        let len = record.u32(24)?;
        let start = record.u32(42)?;
        let is_zip64 = [stored_len, len, start].contains(&IN_EXTRA_FIELD);
        if next > directory.len() || !is_on_this_disk || is_zip64 {
            return None;
        }
        let start = usize::try_from(start).ok()?;
        let local = Record::at(directory, start, LOCAL_SIGNATURE, LOCAL_BYTES)?;
        let entry = Self {
            name,
            flags: record.u16(8)?,
            method: record.u16(10)?,
            crc32: record.u32(16)?,
            stored_len: usize::try_from(stored_len).ok()?,
            len: usize::try_from(len).ok()?,
            start,
            data: start + LOCAL_BYTES + local.length(26)? + local.length(28)?,
        };
        Some((entry, next))
    }

    /// Returns how the entry is stored, `None` for every method that `numpy` does not use.
    pub(super) fn method(&self) -> Option<Method> {
        match self.method {
            0 => Some(Method::Stored),
            8 => Some(Method::Deflated),
            _ => None,
        }
    }

    /// Returns the archive from the entry's data to its end.
    ///
    /// # Errors
    ///
    /// Fails if the data is encrypted, or if the header before it tells another story than the
    /// directory.
    pub(super) fn data_and_after<'a>(
        &self,
        archive: &'a [u8],
        array: &str,
    ) -> Result<&'a [u8], NpzError> {
        if self.flags & REFUSED_FLAGS != 0 {
            return Err(entry_damaged(array, "encrypted or patched"));
        }
        if self.is_told_alike(archive) != Some(true) {
            let reason = "its header differs from the archive's directory";
            return Err(entry_damaged(array, reason));
        }
        archive
            .get(self.data..)
            .ok_or_else(|| entry_damaged(array, "it ends early"))
    }

    /// Returns whether the local header agrees with the directory.
    fn is_told_alike(&self, archive: &[u8]) -> Option<bool> {
        let local = Record::at(archive, self.start, LOCAL_SIGNATURE, LOCAL_BYTES)?;
        let name = self.start + LOCAL_BYTES;
        let name = archive.get(name..name + local.length(26)?)?;
        let is_length =
            |found: u32, len: usize| found == IN_EXTRA_FIELD || usize::try_from(found) == Ok(len);
        let lengths = self.flags & FOLLOWED_BY_LENGTHS != 0
            || local.u32(14)? == self.crc32
                && is_length(local.u32(18)?, self.stored_len)
                && is_length(local.u32(22)?, self.len);
        Some(
            lengths
                && local.u16(6)? == self.flags
                && local.u16(8)? == self.method
                && archive.get(self.name.clone())? == name,
        )
    }
}

/// Returns whether an archive's end, one without a comment, is where these bytes end.
pub(super) fn ends_without_comment(bytes: &[u8]) -> bool {
    let end = bytes.last_chunk::<END_BYTES>();
    end.is_some_and(|end| end.starts_with(END_SIGNATURE) && end.ends_with(&[0, 0]))
}

/// The record that ends an archive.
struct End {
    /// Offset of its start.
    start: usize,
    n_entries: usize,
    /// Offset of the directory.
    directory: usize,
}

impl End {
    /// Finds the record: the last one whose comment reaches exactly to the archive's end.
    fn find(archive: &[u8]) -> Option<Self> {
        let last = archive.len().checked_sub(END_BYTES)?;
        let first = last.saturating_sub(usize::from(u16::MAX));
        (first..=last)
            .rev()
            .find_map(|start| Self::parse(archive, start))
    }

    fn parse(archive: &[u8], start: usize) -> Option<Self> {
        let record = Record::at(archive, start, END_SIGNATURE, END_BYTES)?;
        let is_at_the_end = start + END_BYTES + record.length(20)? == archive.len();
        let n_entries = record.length(10)?;
        let is_one_disk =
            record.u16(4)? == 0 && record.u16(6)? == 0 && record.length(8)? == n_entries;
        let directory = usize::try_from(record.u32(16)?).ok()?;
        let len = usize::try_from(record.u32(12)?).ok()?;
        let is_before = directory.checked_add(len) == Some(start);
        (is_at_the_end && is_one_disk && is_before).then_some(Self {
            start,
            n_entries,
            directory,
        })
    }
}

/// A record of fixed length that begins with a signature; numbers are little-endian.
struct Record<'a>(&'a [u8]);

impl<'a> Record<'a> {
    fn at(bytes: &'a [u8], start: usize, signature: &[u8], len: usize) -> Option<Self> {
        let record = bytes.get(start..start.checked_add(len)?)?;
        record.starts_with(signature).then_some(Self(record))
    }

    fn u16(&self, at: usize) -> Option<u16> {
        let bytes = self.0.get(at..at + 2)?;
        bytes.try_into().ok().map(u16::from_le_bytes)
    }

    fn u32(&self, at: usize) -> Option<u32> {
        let bytes = self.0.get(at..at + 4)?;
        bytes.try_into().ok().map(u32::from_le_bytes)
    }

    /// Returns a length of two bytes.
    fn length(&self, at: usize) -> Option<usize> {
        self.u16(at).map(usize::from)
    }
}

fn damaged(reason: &str) -> NpzError {
    NpzError::Archive(reason.to_owned())
}

fn entry_damaged(array: &str, reason: &str) -> NpzError {
    NpzError::Damaged {
        array: array.to_owned(),
        reason: reason.to_owned(),
    }
}
