//! Archives of arrays, `.npz`, with equal bytes for equal numbers.

use std::{
    io::{self, Cursor, Write},
    iter,
};

use zip::{DateTime, ZipArchive, ZipWriter, write::SimpleFileOptions};

/// Multiple of bytes at which an array's numbers begin, as `numpy` has it.
const ALIGNMENT: usize = 64;

/// An `.npz` archive in the making, in memory.
pub(crate) struct Archive {
    writer: ZipWriter<Cursor<Vec<u8>>>,
}

impl Archive {
    /// Starts an empty archive.
    pub(crate) fn new() -> Self {
        Self {
            writer: ZipWriter::new(Cursor::new(Vec::new())),
        }
    }

    /// Adds an array of single precision, row by row.
    pub(crate) fn f32(
        &mut self,
        name: &str,
        shape: &[u64],
        numbers: impl IntoIterator<Item = f32>,
    ) -> io::Result<()> {
        let bytes = numbers.into_iter().flat_map(f32::to_le_bytes);
        self.array(name, "<f4", shape, bytes)
    }

    /// Adds an array of elements of a type in `numpy`'s notation, in format 1.0 of `.npy` (`NumPy`, *numpy.lib.format*,
    /// 2024).
    fn array(
        &mut self,
        name: &str,
        element: &str,
        shape: &[u64],
        bytes: impl Iterator<Item = u8>,
    ) -> io::Result<()> {
        let lengths: Vec<String> = shape.iter().map(u64::to_string).collect();
        let lengths = lengths.join(", ");
        let mut header =
            format!("{{'descr': '{element}', 'fortran_order': False, 'shape': ({lengths}, ), }}");
        // Before it stand a magic number of 6 bytes, 2 of the version and 2 of its length.
        let len = (10 + header.len() + 1).next_multiple_of(ALIGNMENT) - 10;
        header.extend(iter::repeat_n(' ', len - 1 - header.len()));
        header.push('\n');
        let len = u16::try_from(len).map_err(io::Error::other)?;
        let mut file = b"\x93NUMPY\x01\x00".to_vec();
        file.extend(len.to_le_bytes());
        file.extend(header.as_bytes());
        file.extend(bytes);
        // Compressed, and made at no time.
        let options = SimpleFileOptions::default().last_modified_time(DateTime::default());
        self.writer.start_file(format!("{name}.npy"), options)?;
        self.writer.write_all(&file)
    }

    /// Adds the arrays of another archive without compressing them again.
    pub(crate) fn copy(&mut self, archive: &[u8]) -> io::Result<()> {
        let mut source = ZipArchive::new(Cursor::new(archive))?;
        for idx in 0..source.len() {
            self.writer.raw_copy_file(source.by_index_raw(idx)?)?;
        }
        Ok(())
    }

    /// Returns the archive's bytes.
    pub(crate) fn finish(self) -> io::Result<Vec<u8>> {
        Ok(self.writer.finish()?.into_inner())
    }
}

/// Returns an archive with one array of zeros of one byte each.
pub(crate) fn zeros(name: &str, shape: &[u64]) -> io::Result<Vec<u8>> {
    let n_zeros = usize::try_from(shape.iter().product::<u64>()).map_err(io::Error::other)?;
    let mut archive = Archive::new();
    archive.array(name, "|u1", shape, iter::repeat_n(0, n_zeros))?;
    archive.finish()
}
