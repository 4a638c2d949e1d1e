//! Arrays of numbers in a pickle, however `numpy`, `scipy` and `chumpy` wrote them.
//!
//! | Object | Written as |
//! |---|---|
//! | `ndarray` | `_reconstruct` with state (version, shape, dtype, is Fortran, bytes), or `_frombuffer` with (bytes, dtype, shape, order) from protocol 5 on |
//! | `dtype` | its name, e.g. `f8`, with state (version, byte order, …) |
//! | `bytes` | themselves, or for protocol 2 by Python 3 `encode` of a text in Latin-1 |
//! | `Ch` of `chumpy` | a dictionary with the array `x` |
//! | `Select` of `chumpy` | a dictionary with the object `a` and the places `idxs` taken from it |
//! | `csc_matrix` | a dictionary with `data`, `indices`, `indptr` |
//!
//! Memory is reserved for numbers only once their bytes are known to be there.

use std::borrow::Cow;

use super::{
    ManoError,
    pickle::{Pickle, Ref, Value},
};

/// Maximum number of accepted dimensions of an array; those of a hand model have three.
const MAX_DIMENSIONS: usize = 4;

/// Readers of one pickle's dictionary.
pub(super) struct Arrays<'p, 'a> {
    pub(super) pickle: &'p Pickle<'a>,
}

/// An array whose bytes are as many as its shape and type need.
struct Raw<'a> {
    /// Dimensions, none of them zero.
    shape: Vec<usize>,
    kind: Kind,
    is_big_endian: bool,
    is_fortran: bool,
    bytes: Cow<'a, [u8]>,
}

/// A type of numbers.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    F4,
    F8,
    I4,
    I8,
    U4,
    U8,
}

impl Kind {
    fn parse(name: &[u8]) -> Option<Self> {
        match name {
            b"f4" => Some(Self::F4),
            b"f8" => Some(Self::F8),
            b"i4" => Some(Self::I4),
            b"i8" => Some(Self::I8),
            b"u4" => Some(Self::U4),
            b"u8" => Some(Self::U8),
            _ => None,
        }
    }

    fn size(self) -> usize {
        match self {
            Self::F4 | Self::I4 | Self::U4 => 4,
            Self::F8 | Self::I8 | Self::U8 => 8,
        }
    }
}

impl Arrays<'_, '_> {
    /// Returns the numbers of an array of exactly this shape, last axis fastest.
    pub(super) fn numbers(
        &self,
        key: &'static str,
        shape: &[usize],
    ) -> Result<Vec<f64>, ManoError> {
        let raw = self.raw(key, self.entry(key)?)?;
        raw.expect(key, shape)?;
        raw.numbers(key)
    }

    /// Returns the whole numbers of an array of exactly this shape, last axis fastest.
    pub(super) fn integers(
        &self,
        key: &'static str,
        shape: &[usize],
    ) -> Result<Vec<u64>, ManoError> {
        let raw = self.raw(key, self.entry(key)?)?;
        raw.expect(key, shape)?;
        raw.integers(key)
    }

    /// Returns the first `n` shape directions `(vertex, axis, direction)`, whether they are an
    /// array or chosen by `chumpy` from a longer one.
    pub(super) fn directions(
        &self,
        key: &'static str,
        [vertices, axes, n]: [usize; 3],
    ) -> Result<Vec<f64>, ManoError> {
        let entry = self.entry(key)?;
        let selected = self.pickle.object(entry).and_then(|(name, _, state)| {
            let state = state.filter(|_| name == b"Select")?;
            Some((
                self.pickle.entry(state, "a")?,
                self.pickle.entry(state, "idxs")?,
            ))
        });
        if let Some((from, places)) = selected {
            let from = self.raw(key, from)?.numbers(key)?;
            let places = self.raw(key, places)?;
            places.expect(key, &[vertices * axes * n])?;
            let places = places.integers(key)?.into_iter();
            return places
                .map(|place| {
                    let place = usize::try_from(place).ok();
                    place.and_then(|place| from.get(place).copied())
                })
                .collect::<Option<_>>()
                .ok_or(ManoError::Array {
                    key,
                    what: "takes numbers from where there are none",
                });
        }
        let raw = self.raw(key, entry)?;
        match *raw.shape {
            [v, a, all] if (v, a) == (vertices, axes) && all >= n => {
                let numbers = raw.numbers(key)?;
                let rows = numbers.chunks_exact(all);
                Ok(rows.flat_map(|row| &row[..n]).copied().collect())
            }
            _ => Err(raw.other_shape(key, &[vertices, axes, n])),
        }
    }

    /// Returns a matrix `(row, column)`, whether it is an array or sparse by columns.
    pub(super) fn matrix(
        &self,
        key: &'static str,
        [rows, columns]: [usize; 2],
    ) -> Result<Vec<f64>, ManoError> {
        let entry = self.entry(key)?;
        let Some((b"csc_matrix" | b"csc_array", _, Some(state))) = self.pickle.object(entry) else {
            return self.numbers(key, &[rows, columns]);
        };
        let part = |name: &str| {
            let part = self.pickle.entry(state, name).ok_or(ManoError::Array {
                key,
                what: "lacks a part of a sparse matrix",
            })?;
            self.raw(key, part)
        };
        let (data, indices, starts) = (part("data")?, part("indices")?, part("indptr")?);
        starts.expect(key, &[columns + 1])?;
        indices.expect(key, &data.shape)?;
        let (data, indices) = (data.numbers(key)?, indices.integers(key)?);
        let starts = starts.integers(key)?;
        let damaged = || ManoError::Array {
            key,
            what: "is not a sparse matrix: its parts do not fit each other",
        };
        let mut matrix = vec![0.0; rows * columns];
        for (column, ends) in starts.windows(2).enumerate() {
            let [from, to] = [ends[0], ends[1]].map(|end| usize::try_from(end).ok());
            let (Some(from), Some(to)) = (from, to) else {
                return Err(damaged());
            };
            let values = data.get(from..to).ok_or_else(damaged)?;
            for (&value, &row) in values.iter().zip(&indices[from..to]) {
                let row = usize::try_from(row).ok().filter(|row| *row < rows);
                matrix[row.ok_or_else(damaged)? * columns + column] += value;
            }
        }
        Ok(matrix)
    }

    /// Returns the place of a part of the model.
    fn entry(&self, key: &'static str) -> Result<Ref, ManoError> {
        let found = self.pickle.entry(self.pickle.root(), key);
        found.ok_or(ManoError::Missing(key))
    }

    /// Returns an array, or the array inside of a `chumpy` object.
    fn raw(&self, key: &'static str, at: Ref) -> Result<Raw<'_>, ManoError> {
        let inner = self.pickle.object(at).and_then(|(name, _, state)| {
            let state = state.filter(|_| name == b"Ch")?;
            self.pickle.entry(state, "x")
        });
        let at = inner.unwrap_or(at);
        let parts = self.ndarray(at).ok_or(ManoError::Array {
            key,
            what: "is not an array of numbers of 4 or 8 bytes",
        })?;
        let n_bytes = parts
            .shape
            .iter()
            .try_fold(parts.kind.size(), |n, &len| n.checked_mul(len))
            .filter(|&n| n > 0);
        if n_bytes == Some(parts.bytes.len()) {
            Ok(parts)
        } else {
            Err(ManoError::Array {
                key,
                what: "has not as many bytes as its shape and type need",
            })
        }
    }

    /// Returns the parts of an array, which may not fit each other.
    fn ndarray(&self, at: Ref) -> Option<Raw<'_>> {
        let (name, args, state) = self.pickle.object(at)?;
        let (shape, dtype, is_fortran, bytes) = match (name, args) {
            (b"_reconstruct", _) => {
                let &[_, shape, dtype, order, bytes] = self.pickle.items(state?)? else {
                    return None;
                };
                let Value::Bool(is_fortran) = *self.pickle.value(order) else {
                    return None;
                };
                (shape, dtype, is_fortran, bytes)
            }
            (b"_frombuffer", &[bytes, dtype, shape, order, ..]) => {
                let is_fortran = match self.pickle.name(order)? {
                    b"C" => false,
                    b"F" => true,
                    _ => return None,
                };
                (shape, dtype, is_fortran, bytes)
            }
            _ => return None,
        };
        let (kind, is_big_endian) = self.dtype(dtype)?;
        let dimensions = self.pickle.items(shape)?;
        if dimensions.len() > MAX_DIMENSIONS {
            return None;
        }
        Some(Raw {
            shape: dimensions
                .iter()
                .map(|&len| match *self.pickle.value(len) {
                    Value::Int(len) => usize::try_from(len).ok(),
                    _ => None,
                })
                .collect::<Option<_>>()?,
            kind,
            is_big_endian,
            is_fortran,
            bytes: self.bytes(bytes)?,
        })
    }

    /// Returns a type and whether its highest byte is first.
    fn dtype(&self, at: Ref) -> Option<(Kind, bool)> {
        let (b"dtype", args, state) = self.pickle.object(at)? else {
            return None;
        };
        let kind = Kind::parse(self.pickle.name(*args.first()?)?)?;
        let order = *self.pickle.items(state?)?.get(1)?;
        match self.pickle.name(order)? {
            b"<" => Some((kind, false)),
            b">" => Some((kind, true)),
            _ => None,
        }
    }

    /// Returns bytes, themselves or as a text in Latin-1.
    fn bytes(&self, at: Ref) -> Option<Cow<'_, [u8]>> {
        if let Value::Bytes(bytes) = self.pickle.value(at) {
            return Some(Cow::Borrowed(bytes));
        }
        let (b"encode", &[text, ..], _) = self.pickle.object(at)? else {
            return None;
        };
        let Value::Text(text) = self.pickle.value(text) else {
            return None;
        };
        let bytes = text.chars().map(|letter| u8::try_from(letter).ok());
        bytes.collect::<Option<_>>().map(Cow::Owned)
    }
}

impl Raw<'_> {
    fn expect(&self, key: &'static str, shape: &[usize]) -> Result<(), ManoError> {
        if self.shape == shape {
            Ok(())
        } else {
            Err(self.other_shape(key, shape))
        }
    }

    fn other_shape(&self, key: &'static str, expected: &[usize]) -> ManoError {
        ManoError::Shape {
            key,
            found: self.shape.clone(),
            expected: expected.to_vec(),
        }
    }

    /// Returns the finite numbers, last axis fastest.
    fn numbers(&self, key: &'static str) -> Result<Vec<f64>, ManoError> {
        let numbers: Vec<f64> = match self.kind {
            Kind::F4 => self.decode(|bytes| f32::from_le_bytes(bytes).into()),
            Kind::F8 => self.decode(f64::from_le_bytes),
            _ => {
                return Err(ManoError::Array {
                    key,
                    what: "holds whole numbers, expected f4 or f8",
                });
            }
        };
        if numbers.iter().all(|number| number.is_finite()) {
            Ok(numbers)
        } else {
            Err(ManoError::Array {
                key,
                what: "holds a number that is not finite",
            })
        }
    }

    /// Returns the whole numbers, last axis fastest; negative ones as their two's complement in as
    /// many bits as they are stored in.
    fn integers(&self, key: &'static str) -> Result<Vec<u64>, ManoError> {
        match self.kind {
            Kind::I4 | Kind::U4 => Ok(self.decode(|bytes| u32::from_le_bytes(bytes).into())),
            Kind::I8 | Kind::U8 => Ok(self.decode(u64::from_le_bytes)),
            _ => Err(ManoError::Array {
                key,
                what: "holds fractions, expected whole numbers",
            }),
        }
    }

    fn decode<const N: usize, T: Copy>(&self, number: impl Fn([u8; N]) -> T) -> Vec<T> {
        let (items, _) = self.bytes.as_chunks::<N>();
        let stored: Vec<T> = items
            .iter()
            .map(|item| {
                let mut item = *item;
                if self.is_big_endian {
                    item.reverse();
                }
                number(item)
            })
            .collect();
        if self.is_fortran {
            last_axis_fastest(&stored, &self.shape)
        } else {
            stored
        }
    }
}

/// Returns the items in C order of an array stored with the first axis fastest.
fn last_axis_fastest<T: Copy>(stored: &[T], shape: &[usize]) -> Vec<T> {
    (0..stored.len())
        .map(|place| {
            let mut rest = place;
            let mut source = 0;
            for (axis, &len) in shape.iter().enumerate().rev() {
                let stride: usize = shape[..axis].iter().product();
                source += rest % len * stride;
                rest /= len;
            }
            stored[source]
        })
        .collect()
}
