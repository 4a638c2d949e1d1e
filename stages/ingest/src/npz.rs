//! Arrays of an `.npz` file, read fast and in bounded memory.
//!
//! Only the asked-for entries are inflated, into a buffer that is kept from file to file, never
//! further than the expected array is long, and only their bytes are trusted whose checksum is
//! right.
//!
//! `DexYCB` has 582,000 small files of this kind, so that what a file costs beside its bytes
//! decides. Measured on one core with label files of 2 kB in the page cache, in microseconds per
//! file: opening and reading 3.5; finding and inflating two arrays 5.4 with the crate `zip`, most of
//! it for setting up an inflater for each; parsing their two headers 38 with `npyz`. Hence the walk
//! of the archive and the parser of the header are this module's own, strict and small, and
//! `flate2` with `zlib-rs` below it, which inflates both arrays in 1.2, is set up once.

mod header;
#[cfg(test)]
mod hostile;
mod zip;

use flate2::{Decompress, FlushDecompress, Status};

use self::{
    header::{Element, Header},
    zip::{Directory, Entry, Method},
};

/// Longest accepted text header of an array, in bytes; those of this dataset have 118.
const MAX_HEADER_BYTES: usize = 4096;
/// Room beyond the last byte with which the inflater never has to look where the room ends: its
/// longest match, 258 bytes, and what it writes at once.
const INFLATER_ROOM_BYTES: usize = 384;

/// Why an array could not be read.
#[derive(Debug, thiserror::Error)]
pub enum NpzError {
    /// The file is not an archive of arrays, or it ends early.
    #[error("damaged archive ({0})")]
    Archive(String),
    /// The archive lacks an array.
    #[error("no array `{0}`")]
    Missing(String),
    /// An array's bytes are damaged or end early.
    #[error("damaged array `{array}` ({reason})")]
    Damaged {
        /// The array.
        array: String,
        /// The fault.
        reason: String,
    },
    /// An array has other dimensions.
    #[error("`{array}` has shape {found:?}, expected {expected:?}")]
    Shape {
        /// The array.
        array: String,
        /// Dimensions found.
        found: Vec<u64>,
        /// Dimensions expected.
        expected: Vec<u64>,
    },
    /// An array does not hold floating-point numbers of 4 or 8 bytes.
    #[error("`{array}` holds {found}, expected f4 or f8")]
    Type {
        /// The array.
        array: String,
        /// Its element type in `numpy`'s words.
        found: String,
    },
    /// An array holds NaN or infinity.
    #[error("`{array}` is {value} at {index:?}, expected a finite number")]
    NotFinite {
        /// The array.
        array: String,
        /// The first such number.
        value: f64,
        /// Its place along each axis, from 0.
        index: Vec<u64>,
    },
}

/// Inflater and buffers for reading archives; worth keeping from one file to the next.
#[derive(Debug)]
pub(crate) struct Unpacker {
    directory: Directory,
    inflater: Decompress,
    content: Vec<u8>,
}

impl Unpacker {
    /// Sets up an inflater.
    pub(crate) fn new() -> Self {
        Self {
            directory: Directory::default(),
            inflater: Decompress::new(false),
            content: Vec::new(),
        }
    }
}

/// The arrays of one `.npz` file held in memory.
#[derive(Debug)]
pub(crate) struct Arrays<'a> {
    bytes: &'a [u8],
    unpacker: UnpackerHandle<'a>,
}

/// An unpacker for this archive alone, or one that is used again.
#[derive(Debug)]
enum UnpackerHandle<'a> {
    Owned(Box<Unpacker>),
    Lent(&'a mut Unpacker),
}

impl<'a> Arrays<'a> {
    /// Opens the archive; inflates nothing.
    ///
    /// # Errors
    ///
    /// Fails if the bytes are not a complete archive, or one with parts that overlap.
    pub(crate) fn open(bytes: &'a [u8]) -> Result<Self, NpzError> {
        let mut unpacker = Box::new(Unpacker::new());
        unpacker.directory.list(bytes)?;
        let unpacker = UnpackerHandle::Owned(unpacker);
        Ok(Self { bytes, unpacker })
    }

    /// Opens the archive as [`Self::open`] does, without setting anything up.
    pub(crate) fn open_with(bytes: &'a [u8], unpacker: &'a mut Unpacker) -> Result<Self, NpzError> {
        unpacker.directory.list(bytes)?;
        let unpacker = UnpackerHandle::Lent(unpacker);
        Ok(Self { bytes, unpacker })
    }

    /// Returns the numbers of an array of exactly this shape, last axis fastest.
    ///
    /// # Errors
    ///
    /// Fails if the array is not there, is damaged, has another shape or other elements than `f4`
    /// and `f8`, or holds a number that is not finite.
    pub(crate) fn numbers(&mut self, array: &str, expected: &[u64]) -> Result<Vec<f64>, NpzError> {
        let mut numbers = Vec::new();
        self.numbers_into(array, expected, &mut numbers)?;
        Ok(numbers)
    }

    /// Replaces `numbers` by those of an array, as [`Self::numbers`] returns them.
    pub(crate) fn numbers_into(
        &mut self,
        array: &str,
        expected: &[u64],
        numbers: &mut Vec<f64>,
    ) -> Result<(), NpzError> {
        let damaged = |reason: &str| NpzError::Damaged {
            array: array.to_owned(),
            reason: reason.to_owned(),
        };
        let Unpacker {
            directory,
            inflater,
            content,
        } = match &mut self.unpacker {
            UnpackerHandle::Owned(unpacker) => unpacker.as_mut(),
            UnpackerHandle::Lent(unpacker) => unpacker,
        };
        let entry = directory.entry(self.bytes, array)?;
        let data_and_after = entry.data_and_after(self.bytes, array)?;
        let count = element_count(expected);
        let limit = count
            .saturating_mul(8)
            .saturating_add(header::PREFIX_BYTES + MAX_HEADER_BYTES);
        let bytes = match entry.method() {
            Some(Method::Stored) => data_and_after.get(..entry.stored_len).unwrap_or_default(),
            Some(Method::Deflated) => inflate(inflater, content, data_and_after, entry, limit),
            None => return Err(damaged("neither stored nor deflated")),
        };
        let too_long = entry.len > limit;
        if !too_long && bytes.len() != entry.len {
            return Err(damaged("its length is not the announced one"));
        }
        if !too_long && crc32fast::hash(bytes) != entry.crc32 {
            return Err(damaged("its checksum is wrong"));
        }
        if too_long {
            let (header, _) =
                Header::parse(bytes, MAX_HEADER_BYTES).ok_or_else(|| damaged("no array header"))?;
            header.check_shape(array, expected)?;
            header.check_type(array)?;
            return Err(damaged("its length does not fit its shape"));
        }
        widen(bytes, array, expected, numbers)
    }
}

/// Returns the numbers of an `.npy` file whose array has exactly this shape, last axis fastest; `array` is its
/// name in messages.
///
/// # Errors
///
/// Fails if the file is damaged, has another shape or other elements than `f4` and `f8`, or holds a number that
/// is not finite.
pub(crate) fn npy(file: &[u8], array: &str, expected: &[u64]) -> Result<Vec<f64>, NpzError> {
    let mut numbers = Vec::new();
    widen(file, array, expected, &mut numbers)?;
    Ok(numbers)
}

/// Replaces `numbers` by those of an array in `numpy`'s format.
fn widen(
    bytes: &[u8],
    array: &str,
    expected: &[u64],
    numbers: &mut Vec<f64>,
) -> Result<(), NpzError> {
    let damaged = |reason: &str| NpzError::Damaged {
        array: array.to_owned(),
        reason: reason.to_owned(),
    };
    let (header, data) =
        Header::parse(bytes, MAX_HEADER_BYTES).ok_or_else(|| damaged("no array header"))?;
    header.check_shape(array, expected)?;
    let element = header.check_type(array)?;
    if Some(data.len()) != element_count(expected).checked_mul(element.bytes()) {
        return Err(damaged("its length does not fit its shape"));
    }
    element.widen_into(data, numbers);
    let is_finite = numbers.iter().all(|number| number.is_finite());
    if header.fortran_order {
        *numbers = last_axis_fastest(numbers, expected);
    }
    if is_finite {
        return Ok(());
    }
    let mut places = numbers.iter().enumerate();
    let found = places.find(|(_, number)| !number.is_finite());
    let (place, value) = found.map_or((0, f64::NAN), |(place, value)| (place, *value));
    Err(NpzError::NotFinite {
        array: array.to_owned(),
        value,
        index: index(place as u64, expected),
    })
}

impl Header<'_> {
    fn check_shape(&self, array: &str, expected: &[u64]) -> Result<(), NpzError> {
        if self.shape() == expected {
            return Ok(());
        }
        Err(NpzError::Shape {
            array: array.to_owned(),
            found: self.shape().to_vec(),
            expected: expected.to_vec(),
        })
    }

    fn check_type(&self, array: &str) -> Result<Element, NpzError> {
        self.element().ok_or_else(|| NpzError::Type {
            array: array.to_owned(),
            found: self.descr.to_owned(),
        })
    }
}

/// Returns whether these bytes end as a whole archive does.
///
/// Bytes that do not may be a whole archive nevertheless, one with a comment.
pub(crate) fn ends_whole(bytes: &[u8]) -> bool {
    zip::ends_without_comment(bytes)
}

/// Returns how many elements an array of this shape has.
fn element_count(shape: &[u64]) -> usize {
    let count = shape.iter().copied().fold(1, u64::saturating_mul);
    usize::try_from(count).unwrap_or(usize::MAX)
}

/// Inflates an entry, at most `limit` bytes of it; a damaged one gives no bytes, or fewer than it
/// announces.
///
/// `data_and_after` is the archive from the entry's data to its end: the inflater is fastest while
/// more bytes lie ahead, to read as well as to write, than it needs. It says where it stopped.
fn inflate<'a>(
    inflater: &mut Decompress,
    content: &'a mut Vec<u8>,
    data_and_after: &[u8],
    entry: &Entry,
    limit: usize,
) -> &'a [u8] {
    let room = entry.len.min(limit) + INFLATER_ROOM_BYTES;
    if content.len() < room {
        content.resize(room, 0);
    }
    inflater.reset(false);
    let status = inflater.decompress(
        data_and_after,
        content.get_mut(..room).unwrap_or_default(),
        FlushDecompress::Finish,
    );
    let is_whole = matches!(status, Ok(Status::StreamEnd))
        && inflater.total_in() == entry.stored_len as u64
        && inflater.total_out() == entry.len as u64;
    if is_whole || entry.len > limit {
        let len = usize::try_from(inflater.total_out()).unwrap_or(0);
        content.get(..len.min(limit)).unwrap_or_default()
    } else {
        &[]
    }
}

/// Returns the place along each axis of the number at a position, last axis fastest.
fn index(position: u64, shape: &[u64]) -> Vec<u64> {
    let mut rest = position;
    let mut index: Vec<u64> = shape
        .iter()
        .rev()
        .map(|&len| {
            let place = rest % len.max(1);
            rest /= len.max(1);
            place
        })
        .collect();
    index.reverse();
    index
}

/// Returns numbers that are stored first axis fastest, last axis fastest.
fn last_axis_fastest(stored: &[f64], shape: &[u64]) -> Vec<f64> {
    (0..stored.len() as u64)
        .map(|position| {
            let mut rest = position;
            let mut stride = stored.len() as u64;
            let mut source = 0;
            for &len in shape.iter().rev() {
                stride /= len;
                source += rest % len * stride;
                rest /= len;
            }
            usize::try_from(source)
                .ok()
                .and_then(|source| stored.get(source).copied())
                .unwrap_or(f64::NAN)
        })
        .collect()
}
