//! numpy's arrays: read with their shapes checked, and made.
//!
//! They are read and made by numpy itself, whose memory `CPython`'s stable interface does not reach before 3.11; a call
//! costs less than a microsecond.

use pyo3::{
    intern,
    prelude::*,
    sync::PyOnceLock,
    types::{PyAny, PyByteArray, PyBytes, PyTuple},
};
use spatial::Pose;

use crate::error::wrong;

/// An array of numbers of double precision.
pub(crate) type Array<'py> = Bound<'py, PyAny>;

/// Bytes of a number.
const BYTES: usize = size_of::<f64>();

/// What is used of numpy, imported at the first array.
struct Numpy {
    asarray: Py<PyAny>,
    ndarray: Py<PyAny>,
    float64: Py<PyAny>,
}

impl Numpy {
    fn get(py: Python<'_>) -> PyResult<&Self> {
        static NUMPY: PyOnceLock<Numpy> = PyOnceLock::new();
        NUMPY.get_or_try_init(py, || {
            let numpy = py.import("numpy")?;
            Ok(Self {
                asarray: numpy.getattr("asarray")?.unbind(),
                ndarray: numpy.getattr("ndarray")?.unbind(),
                float64: numpy.call_method1("dtype", ("float64",))?.unbind(),
            })
        })
    }
}

/// Rows of numbers: an argument with the axes of a row is one row, with one more a batch of rows.
pub(crate) struct Rows {
    /// The numbers, row after row.
    numbers: Vec<f64>,
    /// Number of rows.
    len: usize,
    /// Numbers of a row.
    width: usize,
    /// Whether the argument had the axis of a batch.
    pub(crate) is_batch: bool,
}

impl Rows {
    /// Reads an argument called `name` of shape `row` or `(n, …row)`, every number finite.
    ///
    /// # Errors
    ///
    /// Fails with an exception if it is no array or sequence of numbers of such a shape.
    pub(crate) fn read(name: &str, argument: &Bound<'_, PyAny>, row: &[usize]) -> PyResult<Self> {
        let (shape, numbers) = read(name, argument)?;
        let is_batch = shape.len() == row.len() + 1;
        if shape[usize::from(is_batch)..] != *row {
            return Err(wrong(
                format!(
                    "`{name}` has the shape {}, not {}",
                    shown(&shape),
                    shown(row)
                ),
                &format!(
                    "pass an array of the shape {}, or a batch of them",
                    shown(row)
                ),
            ));
        }
        if let Some(at) = numbers.iter().position(|number| !number.is_finite()) {
            let number = numbers[at];
            return Err(wrong(
                format!("`{name}` has {number} at the flat index {at}"),
                "pass finite numbers; leave out the rows that were not measured",
            ));
        }
        Ok(Self {
            numbers,
            len: if is_batch { shape[0] } else { 1 },
            width: row.iter().product(),
            is_batch,
        })
    }

    /// Returns the number of rows.
    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// Returns a row.
    pub(crate) fn row(&self, idx: usize) -> &[f64] {
        &self.numbers[idx * self.width..(idx + 1) * self.width]
    }

    /// Checks that another argument is of as many rows.
    ///
    /// # Errors
    ///
    /// Fails with an exception that names both.
    pub(crate) fn check_as_many(&self, name: &str, other: &Self, its_name: &str) -> PyResult<()> {
        if self.len == other.len && self.is_batch == other.is_batch {
            return Ok(());
        }
        let rows = |rows: &Self| {
            if rows.is_batch {
                format!("a batch of {}", rows.len)
            } else {
                "one row".to_owned()
            }
        };
        Err(wrong(
            format!(
                "`{name}` is {} and `{its_name}` {}",
                rows(self),
                rows(other)
            ),
            "pass batches of the same length, or one row each",
        ))
    }
}

/// Reads the shape and the numbers of an argument, last axis fastest, whatever its type of number and its strides.
fn read(name: &str, argument: &Bound<'_, PyAny>) -> PyResult<(Vec<usize>, Vec<f64>)> {
    let py = argument.py();
    let numpy = Numpy::get(py)?;
    let float64 = numpy.float64.bind(py);
    let refused = |_: PyErr| {
        wrong(
            format!(
                "`{name}` is no array of numbers but a `{}`",
                argument.get_type()
            ),
            "pass a numpy array or nested lists of numbers",
        )
    };
    let is_array = argument.is_exact_instance(numpy.ndarray.bind(py));
    let mut array = if is_array {
        argument.clone()
    } else {
        numpy.asarray.bind(py).call1((argument,)).map_err(refused)?
    };
    let kind = array.getattr(intern!(py, "dtype"))?;
    if !kind.is(float64) {
        let letter: String = kind.getattr("kind")?.extract()?;
        if !matches!(letter.as_str(), "f" | "i" | "u") {
            return Err(wrong(
                format!("`{name}` is an array of `{kind}`"),
                "pass real numbers; convert with `array.astype(float)`",
            ));
        }
        array = array.call_method1("astype", (float64,)).map_err(refused)?;
    }
    let shape = array.getattr(intern!(py, "shape"))?.extract()?;
    let bytes = array.call_method0(intern!(py, "tobytes"))?;
    let (numbers, _rest) = bytes.cast::<PyBytes>()?.as_bytes().as_chunks::<BYTES>();
    Ok((
        shape,
        numbers.iter().copied().map(f64::from_ne_bytes).collect(),
    ))
}

/// Makes an array of this shape, the last axis fastest; with the axis of a batch before, if there is one.
///
/// # Errors
///
/// Fails with an exception if the numbers are not as many as the shape says.
pub(crate) fn array<'py>(
    py: Python<'py>,
    numbers: &[f64],
    batch: Option<usize>,
    row: &[usize],
) -> PyResult<Array<'py>> {
    let numpy = Numpy::get(py)?;
    let bytes = PyByteArray::new_with(py, numbers.len() * BYTES, |bytes| {
        for (place, number) in bytes.as_chunks_mut::<BYTES>().0.iter_mut().zip(numbers) {
            *place = number.to_ne_bytes();
        }
        Ok(())
    })?;
    let shape: Vec<usize> = batch.into_iter().chain(row.iter().copied()).collect();
    let shape = PyTuple::new(py, shape)?;
    let ndarray = numpy.ndarray.bind(py);
    ndarray.call1((shape, numpy.float64.bind(py), bytes))
}

/// Makes an array of one axis.
///
/// # Errors
///
/// Fails with an exception if there is no memory for it.
pub(crate) fn vector<'py>(py: Python<'py>, numbers: &[f64]) -> PyResult<Array<'py>> {
    array(py, numbers, None, &[numbers.len()])
}

/// Returns a shape as Python writes it.
fn shown(shape: &[usize]) -> String {
    let lengths: Vec<String> = shape.iter().map(usize::to_string).collect();
    match lengths.as_slice() {
        [one] => format!("({one},)"),
        several => format!("({})", several.join(", ")),
    }
}

/// Returns a pose as a matrix of 4 × 4 numbers, row by row.
pub(crate) fn pose_matrix<A, B>(pose: &Pose<A, B>) -> [f64; 16] {
    let matrix = pose.to_homogeneous();
    std::array::from_fn(|idx| matrix[(idx / 4, idx % 4)])
}
