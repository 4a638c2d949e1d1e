//! The artifact `parts`: bytes, and a table of one row about them.

use std::{
    fs::File,
    io::{BufReader, Read, Write},
    path::Path,
    sync::Arc,
};

use arrow_array::{ArrayRef, RecordBatch, StringArray, UInt64Array};
use dataflow::{Artifact, Sum};
use lake::ReadArtifact;

use super::OwnError;

/// Name of the file with the bytes.
pub(crate) const DATA: &str = "data.bin";

/// Bytes held in memory at a time, however long a file is.
const CHUNK: usize = 64 * 1024;

/// Change of each byte.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Change {
    /// Added to it, beyond 255 from 0 again.
    pub(crate) add: u8,
    /// Then it is divided by this and the remainder is kept; 0 keeps it whole.
    pub(crate) modulo: u8,
}

/// Name, number and sum of the bytes of one partition.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Tally {
    pub(crate) name: String,
    pub(crate) bytes: u64,
    pub(crate) sum: u64,
}

dataflow::metrics! {
    /// Metrics of the bytes of a partition.
    pub(crate) struct Bytes {
        /// Number of bytes.
        bytes: Sum,
    }
}

impl Tally {
    /// The figures of the partition.
    pub(crate) fn metrics(&self) -> Bytes {
        Bytes {
            bytes: self.bytes as f64,
        }
    }
}

impl Change {
    fn of(self, byte: u8) -> u8 {
        let byte = byte.wrapping_add(self.add);
        byte.checked_rem(self.modulo).unwrap_or(byte)
    }
}

/// Counts the bytes of a file and adds them up; `each` sees them on the way and may change them.
fn go_through(
    name: &str,
    path: &Path,
    mut each: impl FnMut(&mut [u8]) -> Result<(), OwnError>,
) -> Result<Tally, OwnError> {
    let mut file = File::open(path).map_err(OwnError::at(path))?;
    let mut chunk = vec![0; CHUNK];
    let (mut bytes, mut sum) = (0, 0_u64);
    loop {
        let n_read = file.read(&mut chunk).map_err(OwnError::at(path))?;
        let Some(read) = chunk.get_mut(..n_read).filter(|read| !read.is_empty()) else {
            break;
        };
        each(read)?;
        bytes += read.len() as u64;
        sum += read.iter().map(|&byte| u64::from(byte)).sum::<u64>();
    }
    Ok(Tally {
        name: name.to_owned(),
        bytes,
        sum,
    })
}

/// Writes the changed bytes of a file as the data of the artifact in `folder`.
pub(crate) fn write_changed(
    name: &str,
    from: &Path,
    change: Change,
    folder: &Path,
) -> Result<Tally, OwnError> {
    let to = folder.join(DATA);
    let mut file = File::create(&to).map_err(OwnError::at(&to))?;
    go_through(name, from, |chunk| {
        for byte in chunk.iter_mut() {
            *byte = change.of(*byte);
        }
        file.write_all(chunk).map_err(OwnError::at(&to))
    })
}

/// Counts and adds up the bytes of an artifact.
pub(crate) fn tally(artifact: &Artifact) -> Result<Tally, OwnError> {
    go_through(artifact.key.as_str(), data(artifact)?, |_| Ok(()))
}

/// Returns the path of the bytes of an artifact.
pub(crate) fn data(artifact: &Artifact) -> Result<&Path, OwnError> {
    Ok(artifact.path(DATA)?)
}

/// Reads the first bytes of a file, at most `count`.
pub(crate) fn beginning(path: &Path, count: u64) -> Result<Vec<u8>, OwnError> {
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(OwnError::at(path))?;
    let mut beginning = BufReader::new(file).take(count);
    beginning
        .read_to_end(&mut bytes)
        .map_err(OwnError::at(path))?;
    Ok(bytes)
}

/// Writes the table of the artifact in `folder`, one row per tally.
pub(crate) fn write_table(folder: &Path, tallies: &[Tally]) -> Result<(), OwnError> {
    let names: StringArray = tallies.iter().map(|tally| Some(&*tally.name)).collect();
    let bytes: UInt64Array = tallies.iter().map(|tally| Some(tally.bytes)).collect();
    let sums: UInt64Array = tallies.iter().map(|tally| Some(tally.sum)).collect();
    let columns: [(&str, ArrayRef); 3] = [
        ("name", Arc::new(names)),
        ("bytes", Arc::new(bytes)),
        ("sum", Arc::new(sums)),
    ];
    lake::table::write_batch(folder, &RecordBatch::try_from_iter(columns)?)?;
    Ok(())
}
