//! A hand as the numbers of the network, and their units.

use motion::HandState;
use serde::{Deserialize, Serialize};
use spatial::{Pose, rot6d, rotation_from_rot6d};

use crate::{CgfError, config::Outputs, precision::narrow};

/// Numbers before the joint positions: translation and two matrix columns.
pub(crate) const PALM_WIDTH: usize = 9;

/// Returns translation in meters, the rotation's first two columns, joint positions in radians.
pub(crate) fn of<F>(hand: &HandState<F>) -> Vec<f64> {
    let t = &hand.frame_from_palm.translation.vector;
    let mut numbers = vec![t.x, t.y, t.z];
    numbers.extend(rot6d(&hand.frame_from_palm.rotation));
    numbers.extend(&hand.q_rad);
    numbers
}

/// Returns translation in meters, rotation axis times angle in radians, joint positions in radians.
pub(crate) fn with_axis_angle<F>(hand: &HandState<F>) -> Vec<f64> {
    let pose = &hand.frame_from_palm;
    let turn = pose.rotation.scaled_axis();
    let root = pose.translation.vector.iter().chain(turn.iter());
    root.chain(&hand.q_rad).copied().collect()
}

/// Reads the numbers of [`of`], with any two columns that are not parallel; `None` otherwise.
pub(crate) fn to_hand<F>(numbers: &[f64]) -> Option<HandState<F>> {
    let (&[x, y, z, a, b, c, d, e, f], q) = numbers.split_first_chunk::<PALM_WIDTH>()?;
    let rotation = rotation_from_rot6d([a, b, c, d, e, f])?;
    Some(HandState {
        frame_from_palm: Pose::from_parts([x, y, z], rotation),
        q_rad: q.to_vec(),
    })
}

/// Takes numbers in meters, matrix entries and radians to the network's units and back.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Normalization {
    /// Mean that is subtracted, per output.
    pub mean: Vec<f64>,
    /// Scale that the difference is divided by, per output: one number for the translation, one for
    /// the rotation, one for the joints, so that errors of one kind keep their proportions.
    pub scale: Vec<f64>,
}

impl Normalization {
    /// Checks that there are numbers for so many outputs.
    pub(crate) fn check(&self, outputs: usize) -> Result<(), CgfError> {
        let Self { mean, scale } = self;
        if mean.len() != outputs || scale.len() != outputs {
            return Err(CgfError::Tensor {
                name: "normalization".to_owned(),
                found: format!("{} and {} numbers", mean.len(), scale.len()),
                expected: format!("{outputs} numbers each"),
            });
        }
        Ok(())
    }

    /// Measures the mean and spread of `samples`, each of equal length.
    pub(crate) fn measure(outputs: Outputs, samples: &[Vec<f64>]) -> Self {
        let width = samples.first().map_or(PALM_WIDTH, Vec::len);
        let (mut mean, mut scale) = (vec![0.0; width], vec![1.0; width]);
        if outputs == Outputs::Standardized {
            let n = samples.len() as f64;
            for sample in samples {
                for (mean, x) in mean.iter_mut().zip(sample) {
                    *mean += x / n;
                }
            }
            for group in [0..3, 3..PALM_WIDTH, PALM_WIDTH..width] {
                let count = n * group.len() as f64;
                let squares: f64 = samples
                    .iter()
                    .flat_map(|sample| group.clone().map(|k| (sample[k] - mean[k]).powi(2)))
                    .sum();
                // A group that hardly moves is not blown up.
                let deviation = (squares / count.max(1.0)).sqrt().max(1e-3);
                scale[group].fill(deviation);
            }
        }
        Self { mean, scale }
    }

    pub(crate) fn normalize(&self, numbers: &[f64]) -> Vec<f32> {
        numbers
            .iter()
            .zip(self.mean.iter().zip(&self.scale))
            .map(|(x, (mean, scale))| narrow((x - mean) / scale))
            .collect()
    }

    /// Converts the numbers of [`with_axis_angle`] to the network's units; the rotation stays in
    /// radians.
    pub(crate) fn normalize_axis_angle(&self, numbers: &[f64]) -> Vec<f32> {
        // The axis has three numbers where the columns have six.
        let (mean, scale) = (&self.mean, &self.scale);
        let unit = |k: usize| match k {
            0..3 => (mean[k], scale[k]),
            3..6 => (0.0, 1.0),
            _ => (mean[k + 3], scale[k + 3]),
        };
        let numbers = numbers.iter().enumerate();
        numbers
            .map(|(k, x)| {
                let (mean, scale) = unit(k);
                narrow((x - mean) / scale)
            })
            .collect()
    }
}
