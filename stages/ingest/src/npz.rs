//! Arrays of an `.npz` file, read in bounded memory.
//!
//! Only the asked-for entries are inflated, and never further than the expected array is long.

use std::io::{Cursor, Read};

use npyz::{DType, NpyFile, npz::NpzArchive};

/// Longest accepted text header of an array, in bytes; those of this dataset have 118.
const MAX_HEADER_BYTES: u64 = 4096;

/// Why an array could not be read.
#[derive(Debug, thiserror::Error)]
pub enum NpzError {
    /// The file is no archive of arrays, or it ends early.
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
        /// What is wrong.
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
    #[error("`{array}` holds a number that is not finite")]
    NotFinite {
        /// The array.
        array: String,
    },
}

/// The arrays of one `.npz` file held in memory.
pub(crate) struct Arrays<'a> {
    archive: NpzArchive<Cursor<&'a [u8]>>,
}

impl<'a> Arrays<'a> {
    /// Opens the archive; inflates nothing.
    pub(crate) fn open(bytes: &'a [u8]) -> Result<Self, NpzError> {
        let archive = NpzArchive::new(Cursor::new(bytes))
            .map_err(|err| NpzError::Archive(err.to_string()))?;
        Ok(Self { archive })
    }

    /// Returns the numbers of an array of exactly this shape, last axis fastest.
    pub(crate) fn numbers(&mut self, array: &str, expected: &[u64]) -> Result<Vec<f64>, NpzError> {
        let damaged = |reason: String| NpzError::Damaged {
            array: array.to_owned(),
            reason,
        };
        let count: u64 = expected.iter().product();
        let limit = count * 8 + MAX_HEADER_BYTES;
        let name = npyz::npz::file_name_from_array_name(array);
        let mut bytes = Vec::new();
        match self.archive.zip_archive().by_name(&name) {
            Ok(entry) => entry
                .take(limit)
                .read_to_end(&mut bytes)
                .map_err(|err| damaged(err.to_string()))?,
            Err(npyz::zip::result::ZipError::FileNotFound) => {
                return Err(NpzError::Missing(array.to_owned()));
            }
            Err(err) => return Err(NpzError::Archive(err.to_string())),
        };
        if header_len(&bytes).is_none_or(|len| len > MAX_HEADER_BYTES) {
            return Err(damaged("no array header".to_owned()));
        }
        let file = NpyFile::new(bytes.as_slice()).map_err(|err| damaged(err.to_string()))?;
        let header = file.header();
        if header.shape() != expected {
            return Err(NpzError::Shape {
                array: array.to_owned(),
                found: header.shape().to_vec(),
                expected: expected.to_vec(),
            });
        }
        let strides = header.strides().to_vec();
        let stored = match element_bytes(&header.dtype()) {
            Some(4) => file
                .into_vec::<f32>()
                .map(|numbers| numbers.into_iter().map(f64::from).collect()),
            Some(8) => file.into_vec::<f64>(),
            _ => {
                return Err(NpzError::Type {
                    array: array.to_owned(),
                    found: header.dtype().descr(),
                });
            }
        }
        .map_err(|err| damaged(err.to_string()))?;
        if !stored.iter().all(|number| number.is_finite()) {
            return Err(NpzError::NotFinite {
                array: array.to_owned(),
            });
        }
        Ok(last_axis_fastest(stored, expected, &strides))
    }
}

/// Returns the length of the text header that a `.npy` file announces, if it is one.
fn header_len(bytes: &[u8]) -> Option<u64> {
    match bytes {
        [0x93, b'N', b'U', b'M', b'P', b'Y', 1, _, a, b, ..] => {
            Some(u64::from(u16::from_le_bytes([*a, *b])))
        }
        [0x93, b'N', b'U', b'M', b'P', b'Y', 2 | 3, _, a, b, c, d, ..] => {
            Some(u64::from(u32::from_le_bytes([*a, *b, *c, *d])))
        }
        _ => None,
    }
}

/// Returns the size of a floating-point element, `None` for every other type.
fn element_bytes(dtype: &DType) -> Option<u64> {
    match dtype {
        DType::Plain(scalar) if scalar.type_char() == npyz::TypeChar::Float => {
            Some(scalar.size_field())
        }
        _ => None,
    }
}

/// Returns the numbers in C order, whatever order they were stored in.
fn last_axis_fastest(stored: Vec<f64>, shape: &[u64], strides: &[u64]) -> Vec<f64> {
    let mut expected_stride = 1;
    let is_c_order = shape.iter().zip(strides).rev().all(|(&len, &stride)| {
        let fits = len == 1 || stride == expected_stride;
        expected_stride *= len;
        fits
    });
    if is_c_order {
        return stored;
    }
    (0..stored.len() as u64)
        .map(|position| {
            let mut rest = position;
            let mut source = 0;
            for (&len, &stride) in shape.iter().zip(strides).rev() {
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

#[cfg(test)]
mod tests {
    use std::io::Write;

    use npyz::{WriterBuilder, npz::NpzWriter, zip::write::FileOptions};

    use super::*;

    fn npz(order: npyz::Order, shape: &[u64], numbers: &[f32]) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        {
            let mut npz = NpzWriter::new(&mut bytes);
            let mut array = npz
                .array("a", FileOptions::default())
                .unwrap()
                .default_dtype()
                .order(order)
                .shape(shape)
                .begin_nd()
                .unwrap();
            array.extend(numbers.iter().copied()).unwrap();
            array.finish().unwrap();
        }
        bytes.into_inner()
    }

    /// An archive whose array `a` has these raw bytes.
    fn raw(content: &[u8]) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        let mut zip = npyz::zip::ZipWriter::new(&mut bytes);
        zip.start_file("a.npy", FileOptions::default()).unwrap();
        zip.write_all(content).unwrap();
        zip.finish().unwrap();
        drop(zip);
        bytes.into_inner()
    }

    fn npy(header: &str, data: &[u8]) -> Vec<u8> {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend(u16::try_from(header.len() + 1).unwrap().to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.push(b'\n');
        bytes.extend(data);
        bytes
    }

    fn numbers(file: &[u8], shape: &[u64]) -> Result<Vec<f64>, NpzError> {
        Arrays::open(file)?.numbers("a", shape)
    }

    #[test]
    fn reads_both_orders_alike() {
        let c = npz(npyz::Order::C, &[2, 3], &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let fortran = npz(
            npyz::Order::Fortran,
            &[2, 3],
            &[1.0, 4.0, 2.0, 5.0, 3.0, 6.0],
        );
        let expected = vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        assert_eq!(numbers(&c, &[2, 3]).unwrap(), expected);
        assert_eq!(numbers(&fortran, &[2, 3]).unwrap(), expected);
    }

    #[test]
    fn reads_big_endian() {
        let header = "{'descr': '>f8', 'fortran_order': False, 'shape': (1,), }";
        let file = raw(&npy(header, &1.5_f64.to_be_bytes()));
        assert_eq!(numbers(&file, &[1]).unwrap(), vec![1.5]);
    }

    #[test]
    fn names_what_is_wrong() {
        let check = |file: &[u8], expected: &str| {
            let message = numbers(file, &[2]).unwrap_err().to_string();
            assert!(message.contains(expected), "`{message}` lacks `{expected}`");
        };
        let header = |descr: &str, shape: &str| {
            format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({shape}), }}")
        };
        let good = npz(npyz::Order::C, &[2], &[1.0, 2.0]);
        check(&[], "damaged archive");
        check(&good[..good.len() - 30], "damaged archive");
        check(
            &npz(npyz::Order::C, &[3], &[1.0; 3]),
            "shape [3], expected [2]",
        );
        check(&npz(npyz::Order::C, &[2], &[1.0, f32::NAN]), "not finite");
        check(
            &raw(&npy(&header("<i4", "2,"), &[0; 8])),
            "expected f4 or f8",
        );
        check(
            &raw(&npy(&header("|O", "2,"), &[0; 8])),
            "expected f4 or f8",
        );
        check(&raw(&npy(&header("<f4", "2,"), &[0; 4])), "damaged array");
        check(
            &raw(&npy(&header("<f8", "1250000000,"), &[0; 64])),
            "expected [2]",
        );
        check(
            &raw(b"\x93NUMPY\x02\x00\xff\xff\xff\xff{"),
            "no array header",
        );
        check(&raw(&vec![0; 1 << 24]), "no array header");
        let mut other = Arrays::open(&good).unwrap();
        assert!(matches!(
            other.numbers("b", &[2]),
            Err(NpzError::Missing(_))
        ));
    }
}
