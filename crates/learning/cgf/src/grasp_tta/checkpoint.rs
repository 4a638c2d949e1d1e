//! The networks' two files.

use std::path::Path;

use options::Options;
use schemas::grasp_networks::VERSION;
use serde::{Deserialize, Serialize};

use super::{GraspEpoch, GraspNetworkConfig, GraspNetworks, GraspTrainingConfig, networks};
use crate::{
    CgfError, Normalization,
    files::{self, read},
    hand_numbers::PALM_WIDTH,
    weights::Weights,
};

/// Everything about the networks but their weights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GraspDescription {
    /// Version of the form, [`schemas::grasp_networks::VERSION`].
    pub version: String,
    /// Names of the hand's joints, in the order of the outputs after the first nine.
    pub joints: Vec<String>,
    /// Shapes of the networks.
    pub network: GraspNetworkConfig,
    /// Training options.
    pub training: GraspTrainingConfig,
    /// Seed of weights and noise.
    pub seed: u64,
    /// Units of the outputs: translation (m), two columns of the rotation, joint positions (rad).
    pub normalization: Normalization,
    /// Names of the objects whose grasps were learned from, each once.
    pub objects: Vec<String>,
    /// Number of grasps that were learned from.
    pub grasps: usize,
    /// The epochs of the generator.
    pub generator_curve: Vec<GraspEpoch>,
    /// Mean squared error of the predicted contact maps in each epoch of the contact network.
    pub contact_curve: Vec<f64>,
}

impl GraspNetworks {
    /// Writes the two files.
    ///
    /// # Errors
    ///
    /// Fails if they cannot be written.
    pub fn save(&self, weights: &Path, description: &Path) -> Result<(), CgfError> {
        files::save(&self.weights, weights, &self.description, description)
    }

    /// Reads the two files, for a hand with these joints.
    ///
    /// # Errors
    ///
    /// Fails if they cannot be read, are damaged, do not fit together, or are of another hand.
    pub fn load(weights: &Path, description: &Path, joints: &[String]) -> Result<Self, CgfError> {
        let description: GraspDescription = serde_json::from_slice(&read(description)?)?;
        if description.version != VERSION {
            return Err(CgfError::Version {
                expected: VERSION,
                found: description.version,
            });
        }
        if description.joints != joints {
            return Err(CgfError::AnotherHand {
                expected: joints.to_vec(),
                found: description.joints,
            });
        }
        description.network.check()?;
        let outputs = PALM_WIDTH + joints.len();
        description.normalization.check(outputs)?;
        let weights = Weights::from_bytes(&read(weights)?)?;
        weights.check_like(&networks::initialize(&description.network, outputs, 0))?;
        Self::new(description, weights)
    }
}
