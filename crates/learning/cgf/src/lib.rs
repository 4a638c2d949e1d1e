//! The continuous grasping function: a motion of a robot hand as a function of time, a latent code
//! and an object (Ye et al., *Learning Continuous Grasping Function with a Dexterous Hand from Human
//! Demonstrations*, 2023, section III).
//!
//! [`train`] fits a [`Cgf`] to motions above a table; [`Cgf::decode`] returns the hand at any time
//! between 1 (far) and 0 (the grasp). By default the network sees the object in its resting
//! orientation: points and palm are in the table frame, z up, so that it knows where the table is.
//! Weights and noise come from our own seeded generator and every sum has a fixed order: equal
//! arguments give equal bytes on any number of threads of one machine.
//! [`grasp_tta`] is a baseline for it, a grasp from networks of its own.
//! This crate depends on candle, but not on stages, tables or physics.

mod adam;
mod augmentation;
mod basis_points;
mod batch;
mod config;
mod curve;
mod data;
mod decoded;
mod decoder;
mod dense_product;
mod error;
mod files;
#[cfg(test)]
mod golden;
pub mod grasp_tta;
mod hand_numbers;
mod kinematics;
mod limits;
mod loss;
mod model;
mod network;
mod penetration;
mod point_net;
mod precision;
mod product;
mod random;
mod state;
mod step;
mod training;
mod weights;

pub use config::{
    Activation, Augmentation, Contact, EncoderRotation, EncoderTimes, Initialization, InputFrame,
    JointOutputs, LatentNoise, LatentPrior, LatentVariance, NetworkConfig, Outputs, Reduction,
    Schedule, Times, TrainingConfig, TrainingDevice,
};
pub use curve::Epoch;
pub use data::{RestingObject, TrainingMotion};
pub use decoder::{HandDerivative, HandMotionState};
pub use error::CgfError;
pub use hand_numbers::Normalization;
pub use limits::JointRange;
pub use model::{Cgf, Description, EncodedDemonstration, HandDistance, ObjectFeature, Posterior};
pub use random::Random;
pub use step::Losses;
pub use training::{Trainer, TrainingResult, TrainingSet, train};
pub use weights::{Array, Weights};
