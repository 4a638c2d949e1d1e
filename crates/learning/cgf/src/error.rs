//! Why a grasping function could not be trained, stored or used.

use std::{io, path::PathBuf};

use robot::spheres;

/// Why a grasping function could not be trained, stored or used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CgfError {
    /// A checkpoint has a second decoder without its units.
    #[error(
        "the checkpoint's `network.local_points` asks for a second decoder, and `local_normalization` is missing"
    )]
    NoLocalNormalization,
    /// There are too few trajectories to learn from.
    #[error("{found} trajectories to train on, at least 2 are needed")]
    TooFewTrajectories {
        /// Number of trajectories.
        found: usize,
    },
    /// A trajectory has too few steps to be a motion.
    #[error("trajectory `{name}` has {found} steps, at least 2 are needed")]
    TooFewSteps {
        /// The trajectory's name.
        name: String,
        /// Number of its steps.
        found: usize,
    },
    /// A number is NaN or infinite.
    #[error("`{name}` holds a number that is not finite: {what}")]
    NotFinite {
        /// The trajectory or object.
        name: String,
        /// Name of the number that is not finite.
        what: &'static str,
    },
    /// A trajectory has another number of joint positions than the hand has joints.
    #[error("trajectory `{name}` has {found} joint positions, the hand has {expected} joints")]
    WrongDof {
        /// The trajectory's name.
        name: String,
        /// Joints of the hand.
        expected: usize,
        /// Joint positions found.
        found: usize,
    },
    /// The configuration asks for a device that this program was built without.
    #[error(
        "this program was built without the feature `{feature}`, which `device = \"{feature}\"` needs"
    )]
    NotBuiltFor {
        /// The feature and device.
        feature: &'static str,
    },
    /// An object's surface is described by too few points.
    #[error("object `{object}` has {found} surface points, at least {expected} are needed")]
    TooFewPoints {
        /// The object's name.
        object: String,
        /// The least number of points.
        expected: usize,
        /// Number of its points.
        found: usize,
    },
    /// The hand has no link of a name that the configuration gives.
    #[error("the hand has no link `{link}`")]
    UnknownLink {
        /// The link's name.
        link: String,
    },
    /// Penetration is penalized for an object without a distance field.
    #[error("object `{object}` has no distance field, which `penetration_weight` needs")]
    NoDistances {
        /// The object's name.
        object: String,
    },
    /// The hand's collision shapes are far larger than a hand's.
    #[error(
        "the collision shapes up to link `{link}` need more than {} spheres",
        spheres::MAX_SPHERES
    )]
    LargeShapes {
        /// Name of the link at which they became too large.
        link: String,
    },
    /// A value of the configuration cannot be used.
    #[error(transparent)]
    Config(#[from] options::OptionFault),
    /// The decoder was given numbers of another network.
    #[error("`{what}` has {found} numbers, the network takes {expected}")]
    WrongWidth {
        /// Name of the numbers.
        what: &'static str,
        /// Width that the network takes.
        expected: usize,
        /// Width found.
        found: usize,
    },
    /// The loss is no longer a number.
    #[error("training diverged in epoch {epoch}: the loss is {loss}")]
    Diverged {
        /// The epoch, from 1.
        epoch: usize,
        /// The loss.
        loss: f32,
    },
    /// A file of the checkpoint cannot be read or written.
    #[error("cannot {action} the checkpoint `{}`", path.display())]
    Io {
        /// Operation that failed, e.g. `read`.
        action: &'static str,
        /// Where.
        path: PathBuf,
        /// Why it failed.
        source: io::Error,
    },
    /// The checkpoint's weights are truncated or no safetensors file.
    #[error("the checkpoint's weights are damaged")]
    Weights(#[from] safetensors::SafeTensorError),
    /// The checkpoint's description is damaged.
    #[error("the checkpoint's description is damaged")]
    Description(#[from] serde_json::Error),
    /// The checkpoint is of another version.
    #[error("the checkpoint is of version `{found}`, expected `{expected}`")]
    Version {
        /// The version that can be read.
        expected: &'static str,
        /// The version found.
        found: String,
    },
    /// The checkpoint lacks the resting pose of a demonstration's object.
    #[error("the checkpoint's demonstration `{demonstration}` has no direction against gravity")]
    RestingPose {
        /// The demonstration's name.
        demonstration: String,
    },
    /// The shapes of the checkpoint's weights differ from its description.
    #[error("the checkpoint's tensor `{name}` is {found}, expected {expected}")]
    Tensor {
        /// The tensor's name.
        name: String,
        /// Description of the tensor found.
        found: String,
        /// Description of the tensor expected.
        expected: String,
    },
    /// A training cannot go on from a checkpoint of another network.
    #[error("the checkpoint is of another `network`")]
    AnotherNetwork,
    /// The checkpoint belongs to another hand.
    #[error("the checkpoint is of a hand with joints {found:?}, expected {expected:?}")]
    AnotherHand {
        /// Joints of the hand at hand.
        expected: Vec<String>,
        /// Joints that the checkpoint was trained with.
        found: Vec<String>,
    },
    /// The tensor library failed.
    #[error("a tensor operation failed")]
    Tensors(#[from] candle_core::Error),
}
