//! numpy's arrays: read with their shapes checked, and made.

use numpy::{
    IntoPyArray, PyArray, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyUntypedArray,
    PyUntypedArrayMethods,
};
use pyo3::{prelude::*, types::PyAny};

use spatial::Pose;

use crate::error::wrong;

/// An array of any number of axes.
pub(crate) type Array<'py> = Bound<'py, PyArrayDyn<f64>>;

/// Rows of numbers: an argument with one axis is one row, with two a batch of rows.
pub(crate) struct Rows {
    /// The numbers, row after row.
    numbers: Vec<f64>,
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
        let width = row.iter().product();
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
            width,
            is_batch,
        })
    }

    /// Returns the number of rows.
    pub(crate) fn len(&self) -> usize {
        self.numbers.len().checked_div(self.width).unwrap_or(1)
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
        if self.len() == other.len() && self.is_batch == other.is_batch {
            return Ok(());
        }
        Err(wrong(
            format!(
                "`{name}` has {} rows and `{its_name}` {}",
                self.len(),
                other.len()
            ),
            "pass batches of the same length, or one row each",
        ))
    }
}

/// Reads the shape and the numbers of an argument, whatever its type of number and its strides.
fn read(name: &str, argument: &Bound<'_, PyAny>) -> PyResult<(Vec<usize>, Vec<f64>)> {
    // The fast way: nothing is converted.
    if let Ok(array) = argument.cast::<PyArrayDyn<f64>>() {
        return Ok((array.shape().to_vec(), numbers_of(array)?));
    }
    let refused = |_: PyErr| {
        let kind = argument.get_type();
        wrong(
            format!("`{name}` is no array of numbers but a `{kind}`"),
            "pass a numpy array or nested lists of numbers",
        )
    };
    let numpy = argument.py().import("numpy")?;
    let array = numpy
        .call_method1("asarray", (argument,))
        .map_err(refused)?;
    let kind = array.cast::<PyUntypedArray>()?.dtype().kind();
    if !matches!(kind, b'f' | b'i' | b'u') {
        return Err(wrong(
            format!("`{name}` is an array of `{}`", array.getattr("dtype")?),
            "pass real numbers; convert with `array.astype(float)`",
        ));
    }
    let array = array
        .call_method1("astype", ("float64",))
        .map_err(refused)?;
    let array = array.cast::<PyArrayDyn<f64>>()?;
    Ok((array.shape().to_vec(), numbers_of(array)?))
}

/// Copies the numbers of an array, last axis fastest.
fn numbers_of(array: &Bound<'_, PyArrayDyn<f64>>) -> PyResult<Vec<f64>> {
    let readonly = array.try_readonly()?;
    Ok(match readonly.as_slice() {
        Ok(numbers) => numbers.to_vec(),
        Err(_not_contiguous) => readonly.as_array().iter().copied().collect(),
    })
}

/// Makes an array of this shape, the last axis fastest; with the axis of a batch before, if there is one.
///
/// # Errors
///
/// Fails with an exception if the numbers are not as many as the shape says.
pub(crate) fn array<'py>(
    py: Python<'py>,
    numbers: Vec<f64>,
    batch: Option<usize>,
    row: &[usize],
) -> PyResult<Array<'py>> {
    let shape: Vec<usize> = batch.into_iter().chain(row.iter().copied()).collect();
    numbers.into_pyarray(py).reshape(shape)
}

/// Makes an array of one axis.
pub(crate) fn vector(py: Python<'_>, numbers: Vec<f64>) -> Bound<'_, PyArray<f64, numpy::Ix1>> {
    numbers.into_pyarray(py)
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
