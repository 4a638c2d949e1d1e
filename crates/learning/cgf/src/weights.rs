//! The network's numbers by name: made at random, written, read, and put on candle's tape.

use std::collections::{BTreeMap, HashMap};

use candle_core::{Device, Tensor, Var};
use safetensors::{Dtype, SafeTensors, tensor::TensorView};

use crate::{CgfError, precision::narrow, random::Random};

/// A named array of numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Array {
    /// Its extent in each dimension.
    pub shape: Vec<usize>,
    /// Its numbers, the last dimension fastest.
    pub values: Vec<f32>,
}

/// All numbers of a network by name, in the order of their names.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Weights {
    arrays: BTreeMap<String, Array>,
}

/// The weights as tensors: variables of one gradient tape, or constants.
pub(crate) type WeightTensors = BTreeMap<String, Tensor>;

/// Names that end so are measured, not learned.
const MEASURED: [&str; 3] = [".mean", ".variance", ".points"];

impl Weights {
    /// Returns an array.
    ///
    /// # Errors
    ///
    /// Fails if there is none of this name.
    pub fn array(&self, name: &str) -> Result<&Array, CgfError> {
        self.arrays.get(name).ok_or_else(|| missing(name))
    }

    /// Iterates over the arrays in the order of their names.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Array)> {
        self.arrays
            .iter()
            .map(|(name, array)| (name.as_str(), array))
    }

    /// Returns the arrays whose names begin so, without that beginning.
    pub(crate) fn part(&self, prefix: &str) -> Self {
        let arrays = self.arrays.iter();
        let part = arrays.filter_map(|(name, array)| {
            let name = name.strip_prefix(prefix)?;
            Some((name.to_owned(), array.clone()))
        });
        Self {
            arrays: part.collect(),
        }
    }

    /// Adds all arrays of others, each under its name after `prefix`.
    pub(crate) fn add_part(&mut self, prefix: &str, part: Self) {
        let arrays = part.arrays.into_iter();
        self.arrays
            .extend(arrays.map(|(name, array)| (format!("{prefix}{name}"), array)));
    }

    pub(crate) fn learned_mut(&mut self) -> impl Iterator<Item = (&str, &mut Array)> {
        self.arrays
            .iter_mut()
            .filter(|(name, _)| !is_measured(name))
            .map(|(name, array)| (name.as_str(), array))
    }

    pub(crate) fn set(&mut self, name: &str, shape: &[usize], values: Vec<f32>) {
        assert_eq!(
            shape.iter().product::<usize>(),
            values.len(),
            "shape of `{name}`"
        );
        let shape = shape.to_vec();
        self.arrays.insert(name.to_owned(), Array { shape, values });
    }

    /// Adds an array with entries uniform between `−bound` and `bound`.
    pub(crate) fn set_random(
        &mut self,
        name: &str,
        shape: &[usize],
        bound: f64,
        random: &mut Random,
    ) {
        let values = (0..shape.iter().product::<usize>())
            .map(|_| narrow(bound * (2.0 * random.uniform() - 1.0)))
            .collect();
        self.set(name, shape, values);
    }

    pub(crate) fn set_constant(&mut self, name: &str, length: usize, value: f32) {
        self.set(name, &[length], vec![value; length]);
    }

    pub(crate) fn scale(&mut self, name: &str, factor: f32) {
        for value in self
            .arrays
            .get_mut(name)
            .into_iter()
            .flat_map(|array| &mut array.values)
        {
            *value *= factor;
        }
    }

    /// Returns all arrays on a device: the learned ones as variables of a new tape, the measured ones
    /// as constants.
    pub(crate) fn variables(&self, device: &Device) -> Result<WeightTensors, CgfError> {
        self.leaves(device, |name, tensor| {
            Ok(if is_measured(name) {
                tensor
            } else {
                Var::from_tensor(&tensor)?.into_inner()
            })
        })
    }

    /// Returns all arrays as constants on the CPU.
    pub(crate) fn constants(&self) -> Result<WeightTensors, CgfError> {
        self.constants_on(&Device::Cpu)
    }

    /// Returns all arrays as constants on a device.
    pub(crate) fn constants_on(&self, device: &Device) -> Result<WeightTensors, CgfError> {
        self.leaves(device, |_, tensor| Ok(tensor))
    }

    fn leaves(
        &self,
        device: &Device,
        put: impl Fn(&str, Tensor) -> Result<Tensor, CgfError>,
    ) -> Result<WeightTensors, CgfError> {
        self.arrays
            .iter()
            .map(|(name, array)| {
                let shape = array.shape.as_slice();
                let tensor = Tensor::from_slice(&array.values, shape, device)?;
                Ok((name.clone(), put(name, tensor)?))
            })
            .collect()
    }

    /// Returns the bytes of a safetensors file.
    ///
    /// # Errors
    ///
    /// Fails if an array is too large for the format.
    pub fn to_bytes(&self) -> Result<Vec<u8>, CgfError> {
        self.to_bytes_about(None)
    }

    /// Returns the same with a text header.
    pub(crate) fn to_bytes_about(
        &self,
        about: Option<HashMap<String, String>>,
    ) -> Result<Vec<u8>, CgfError> {
        let bytes: Vec<(&String, &Array, Vec<u8>)> = self
            .arrays
            .iter()
            .map(|(name, array)| {
                let bytes = array.values.iter().flat_map(|x| x.to_le_bytes()).collect();
                (name, array, bytes)
            })
            .collect();
        let views = bytes
            .iter()
            .map(|(name, array, bytes)| {
                let view = TensorView::new(Dtype::F32, array.shape.clone(), bytes)?;
                Ok((name.as_str(), view))
            })
            .collect::<Result<Vec<_>, safetensors::SafeTensorError>>()?;
        Ok(safetensors::serialize(views, about)?)
    }

    /// Reads the bytes of a safetensors file.
    ///
    /// # Errors
    ///
    /// Fails if the bytes are not a safetensors file or hold anything but `f32`.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, CgfError> {
        let mut weights = Self::default();
        for (name, view) in SafeTensors::deserialize(bytes)?.iter() {
            if view.dtype() != Dtype::F32 {
                return Err(CgfError::Tensor {
                    name: name.to_owned(),
                    found: format!("{:?}", view.dtype()),
                    expected: "F32".to_owned(),
                });
            }
            let values = view
                .data()
                .chunks_exact(4)
                .map(|chunk| {
                    let mut number = [0; 4];
                    number.copy_from_slice(chunk);
                    f32::from_le_bytes(number)
                })
                .collect();
            weights.set(name, view.shape(), values);
        }
        Ok(weights)
    }

    /// Checks that these are the arrays of `other`, by name and shape.
    pub(crate) fn check_like(&self, other: &Self) -> Result<(), CgfError> {
        for (name, expected) in &other.arrays {
            let found = self.arrays.get(name).ok_or_else(|| missing(name))?;
            if found.shape != expected.shape {
                return Err(CgfError::Tensor {
                    name: name.clone(),
                    found: format!("{:?}", found.shape),
                    expected: format!("{:?}", expected.shape),
                });
            }
            if found.values.iter().any(|x| !x.is_finite()) {
                return Err(CgfError::NotFinite {
                    name: name.clone(),
                    what: "a weight",
                });
            }
        }
        Ok(())
    }
}

fn is_measured(name: &str) -> bool {
    MEASURED.iter().any(|end| name.ends_with(end))
}

/// Returns one leaf.
pub(crate) fn leaf<'a>(leaves: &'a WeightTensors, name: &str) -> Result<&'a Tensor, CgfError> {
    leaves.get(name).ok_or_else(|| missing(name))
}

fn missing(name: &str) -> CgfError {
    CgfError::Tensor {
        name: name.to_owned(),
        found: "missing".to_owned(),
        expected: "present".to_owned(),
    }
}
