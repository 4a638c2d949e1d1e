//! numpy's arrays: read with their shapes checked, and made.
//!
//! They are read and made by numpy itself, whose memory `CPython`'s stable interface does not reach before 3.11; a call
//! costs less than a microsecond.

use std::sync::OnceLock;

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion};
use pyo3::{
    exceptions::{PyException, PyMemoryError},
    prelude::*,
    types::{PyAny, PyByteArray, PyBytes, PyString, PyTuple},
};
use spatial::Pose;

use crate::error::wrong;

/// An array of numbers of double precision.
pub(crate) type Array<'py> = Bound<'py, PyAny>;

/// Largest entry by which a matrix may miss being a rotation: single precision is enough.
const ROTATION_TOLERANCE: f64 = 1e-4;
const NUMBERS: &str = "pass a numpy array or nested lists of numbers";

/// Bytes of a number.
const BYTES: usize = size_of::<f64>();

/// What is used of numpy, imported at the first array.
struct Numpy {
    asarray: Py<PyAny>,
    ndarray: Py<PyAny>,
    float64: Py<PyAny>,
    dtype: Py<PyString>,
    shape: Py<PyString>,
    tobytes: Py<PyString>,
}

impl Numpy {
    fn get(py: Python<'_>) -> PyResult<&Self> {
        // Python's own cells wait for the interpreter within their lock: a process that another thread forks then would
        // wait for it forever.
        static NUMPY: OnceLock<Numpy> = OnceLock::new();
        if let Some(numpy) = NUMPY.get() {
            return Ok(numpy);
        }
        let numpy = py.import("numpy")?;
        let name = |name| PyString::intern(py, name).unbind();
        let made = Self {
            asarray: numpy.getattr("asarray")?.unbind(),
            ndarray: numpy.getattr("ndarray")?.unbind(),
            float64: numpy.call_method1("dtype", ("float64",))?.unbind(),
            dtype: name("dtype"),
            shape: name("shape"),
            tobytes: name("tobytes"),
        };
        Ok(NUMPY.get_or_init(|| made))
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
            let remedy = format!("pass an array of the shape {}, or a batch", shown(row));
            return Err(wrong_shape(name, &shape, row, &remedy));
        }
        Self::finite(name, &shape, numbers, is_batch)
    }

    /// Reads an argument called `name` of shape `row`, every number finite.
    ///
    /// # Errors
    ///
    /// Fails with an exception if it is no array or sequence of numbers of that shape.
    pub(crate) fn one(
        name: &str,
        argument: &Bound<'_, PyAny>,
        row: &[usize],
    ) -> PyResult<Vec<f64>> {
        let (shape, numbers) = read(name, argument)?;
        if shape != row {
            let remedy = format!("pass an array of the shape {}", shown(row));
            return Err(wrong_shape(name, &shape, row, &remedy));
        }
        Ok(Self::finite(name, &shape, numbers, false)?.numbers)
    }

    fn finite(name: &str, shape: &[usize], numbers: Vec<f64>, is_batch: bool) -> PyResult<Self> {
        if let Some(at) = numbers.iter().position(|number| !number.is_finite()) {
            let number = numbers[at];
            // From the last axis, which is the fastest.
            let mut index = Vec::new();
            let mut rest = at;
            for length in shape.iter().rev() {
                index.insert(0, (rest % length).to_string());
                rest /= length;
            }
            return Err(wrong(
                format!("`{name}` has {number} at [{}]", index.join(", ")),
                "pass finite numbers; leave out the rows that were not measured",
            ));
        }
        let (len, row) = match shape.split_first() {
            Some((&len, row)) if is_batch => (len, row),
            _ => (1, shape),
        };
        Ok(Self {
            numbers,
            len,
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

fn wrong_shape(name: &str, shape: &[usize], row: &[usize], remedy: &str) -> PyErr {
    let what = format!(
        "`{name}` has the shape {}, not {}",
        shown(shape),
        shown(row)
    );
    wrong(what, remedy)
}

/// Reads the shape and the numbers of an argument, last axis fastest, whatever its type of number and its strides.
fn read(name: &str, argument: &Bound<'_, PyAny>) -> PyResult<(Vec<usize>, Vec<f64>)> {
    let py = argument.py();
    let numpy = Numpy::get(py)?;
    let float64 = numpy.float64.bind(py);
    let mut array = argument.clone();
    if !argument.is_exact_instance(numpy.ndarray.bind(py)) {
        if argument.hasattr("mask")? {
            return Err(wrong(
                format!("`{name}` is a masked array, and its masked numbers would count"),
                "leave out the rows that were not measured, and pass `array.data`",
            ));
        }
        let converted = numpy.asarray.bind(py).call1((argument,));
        array = converted.map_err(|err| no_numbers(name, argument, err))?;
    }
    let kind = array.getattr(&numpy.dtype)?;
    if !kind.is(float64) {
        let letter: String = kind.getattr("kind")?.extract()?;
        match letter.as_str() {
            "f" | "i" | "u" => {}
            "O" => {
                let kind = argument.get_type().name()?;
                return Err(wrong(
                    format!("`{name}` is no array of numbers but a `{kind}`"),
                    NUMBERS,
                ));
            }
            _ => {
                return Err(wrong(
                    format!("`{name}` is an array of `{kind}`"),
                    "pass real numbers; convert with `array.astype(float)`",
                ));
            }
        }
        let converted = array.call_method1("astype", (float64,));
        array = converted.map_err(|err| no_numbers(name, argument, err))?;
    }
    let shape = array.getattr(&numpy.shape)?.extract()?;
    let bytes = array.call_method0(&numpy.tobytes)?;
    let (numbers, _rest) = bytes.cast::<PyBytes>()?.as_bytes().as_chunks::<BYTES>();
    let mut read = reserved(numbers.len())?;
    read.extend(numbers.iter().copied().map(f64::from_ne_bytes));
    Ok((shape, read))
}

/// Returns the exception for an argument that numpy refuses. One that no program is to catch, such as that of Ctrl-C,
/// is passed on.
fn no_numbers(name: &str, argument: &Bound<'_, PyAny>, err: PyErr) -> PyErr {
    let py = argument.py();
    if !err.is_instance_of::<PyException>(py) || err.is_instance_of::<PyMemoryError>(py) {
        return err;
    }
    let refused = wrong(
        format!("`{name}` is no array of numbers: {}", err.value(py)),
        NUMBERS,
    );
    refused.set_cause(py, Some(err));
    refused
}

/// Returns memory for as many numbers.
///
/// # Errors
///
/// Fails with `MemoryError` if there is not as much.
pub(crate) fn reserved(len: usize) -> PyResult<Vec<f64>> {
    let mut numbers = Vec::new();
    let made = numbers.try_reserve_exact(len);
    made.map_err(|err| PyMemoryError::new_err(format!("{len} numbers: {err}")))?;
    Ok(numbers)
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

/// Reads a count or a place, an argument called `name`: a number of Python's from 0 on.
///
/// # Errors
///
/// Fails with an exception if it is below 0.
pub(crate) fn count(name: &str, number: i64) -> PyResult<usize> {
    usize::try_from(number)
        .map_err(|_below_0| wrong(format!("`{name}` is {number}"), "pass a number from 0 on"))
}

/// Makes an array of vectors of three numbers.
///
/// # Errors
///
/// Fails with an exception if there is no memory for it.
pub(crate) fn vectors<'py>(py: Python<'py>, vectors: &[[f64; 3]]) -> PyResult<Array<'py>> {
    array(py, vectors.as_flattened(), Some(vectors.len()), &[3])
}

/// Makes an array of whole numbers, the vertices of each triangle.
///
/// # Errors
///
/// Fails with an exception if there is no memory for it.
pub(crate) fn corners<'py>(py: Python<'py>, triangles: &[[u32; 3]]) -> PyResult<Array<'py>> {
    let numbers = triangles.iter().map(|corners| corners.map(f64::from));
    vectors(py, &numbers.collect::<Vec<_>>())?.call_method1("astype", ("int64",))
}

/// Makes an array of poses.
///
/// # Errors
///
/// Fails with an exception if there is no memory for it.
pub(crate) fn poses<A, B>(
    py: Python<'_>,
    poses: impl ExactSizeIterator<Item = Pose<A, B>>,
) -> PyResult<Array<'_>> {
    let n = poses.len();
    let numbers: Vec<f64> = poses.flat_map(|pose| pose_matrix(&pose)).collect();
    array(py, &numbers, Some(n), &[4, 4])
}

/// Reads a pose, a matrix of 4 × 4 numbers row by row, of an argument called `name`.
///
/// # Errors
///
/// Fails with an exception if the matrix is not one of a rigid motion.
pub(crate) fn pose<A, B>(name: &str, m: &[f64]) -> PyResult<Pose<A, B>> {
    let rotation = Matrix3::new(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]);
    let off = (rotation.transpose() * rotation - Matrix3::identity()).amax();
    if m[12..] != [0.0, 0.0, 0.0, 1.0] {
        return Err(wrong(
            format!("the last row of `{name}` is not 0, 0, 0, 1"),
            "pass a rotation matrix and a column in meters above that row",
        ));
    }
    if off > ROTATION_TOLERANCE || rotation.determinant() < 0.0 {
        return Err(wrong(
            format!(
                "the rotation of `{name}` is none: its transpose times it differs from the identity by {off:.1e}, \
                 and its determinant is {:.3}",
                rotation.determinant()
            ),
            "pass orthonormal columns of a right-handed frame, to 1e-4",
        ));
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&rotation));
    let translation = Translation3::new(m[3], m[7], m[11]);
    Ok(Pose::new(Isometry3::from_parts(translation, rotation)))
}

/// Returns a pose as a matrix of 4 × 4 numbers, row by row.
pub(crate) fn pose_matrix<A, B>(pose: &Pose<A, B>) -> [f64; 16] {
    let matrix = pose.to_homogeneous();
    std::array::from_fn(|idx| matrix[(idx / 4, idx % 4)])
}
