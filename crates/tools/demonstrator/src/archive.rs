//! Archives of arrays, `.npz`, with equal bytes for equal numbers.

use std::io::{self, Cursor};

use npyz::{WriterBuilder, npz::NpzWriter};
use zip::{DateTime, ZipArchive, write::FileOptions};

/// An `.npz` archive in the making, in memory.
pub(crate) struct Archive {
    writer: NpzWriter<Cursor<Vec<u8>>>,
}

impl Archive {
    /// Starts an empty archive.
    pub(crate) fn new() -> Self {
        Self {
            writer: NpzWriter::new(Cursor::new(Vec::new())),
        }
    }

    /// Adds an array of single precision, row by row.
    pub(crate) fn f32(
        &mut self,
        name: &str,
        shape: &[u64],
        numbers: impl IntoIterator<Item = f32>,
    ) -> io::Result<()> {
        let mut array = self
            .writer
            .array::<f32>(name, options())?
            .default_dtype()
            .shape(shape)
            .begin_nd()?;
        array.extend(numbers)?;
        array.finish()
    }

    /// Adds the arrays of another archive without compressing them again.
    pub(crate) fn copy(&mut self, archive: &[u8]) -> io::Result<()> {
        let mut source = ZipArchive::new(Cursor::new(archive))?;
        for idx in 0..source.len() {
            self.writer
                .zip_writer()
                .raw_copy_file(source.by_index_raw(idx)?)?;
        }
        Ok(())
    }

    /// Returns the archive's bytes.
    pub(crate) fn finish(mut self) -> io::Result<Vec<u8>> {
        Ok(self.writer.zip_writer().finish()?.into_inner())
    }
}

/// Returns an archive with one array of zeros of one byte each.
pub(crate) fn zeros(name: &str, shape: &[u64]) -> io::Result<Vec<u8>> {
    let mut archive = Archive::new();
    let mut array = archive
        .writer
        .array::<u8>(name, options())?
        .default_dtype()
        .shape(shape)
        .begin_nd()?;
    array.extend(std::iter::repeat_n(
        0_u8,
        usize::try_from(shape.iter().product::<u64>()).unwrap_or(0),
    ))?;
    array.finish()?;
    archive.finish()
}

/// Compressed, and made at no time.
fn options() -> FileOptions {
    FileOptions::default().last_modified_time(DateTime::default())
}
