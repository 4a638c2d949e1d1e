//! The continuous grasping function: a motion of a robot hand as a function of time, a latent code
//! and an object (Ye et al., *Learning Continuous Grasping Function with a Dexterous Hand from Human
//! Demonstrations*, 2023, section III).
//!
//! [`train`] makes a [`Cgf`] of motions above a table; [`Cgf::decode`] gives the hand at any time
//! between 1 (far) and 0 (the grasp). The network sees the object as it lies: points and palm are in
//! the table frame, z up, so that it knows where the table is. Weights and noise come from our own
//! seeded generator and every sum has a fixed order: equal arguments give equal bytes on any number
//! of threads of one machine.
//! This crate knows candle; it does not know stages, tables or physics.

mod adam;
mod augmentation;
mod config;
mod data;
mod error;
mod grasp;
mod kinematics;
mod loss;
mod model;
mod network;
mod point_net;
mod precision;
mod random;
mod training;
mod weights;

pub use config::{
    Activation, Augmentation, Contact, NetworkConfig, Outputs, Schedule, TrainingConfig,
};
pub use data::{Scene, TimedGrasp, Track};
pub use error::CgfError;
pub use grasp::{Grasp, Normalization};
pub use model::{
    Cgf, Curve, Demonstration, Description, GraspError, JointRange, ObjectFeature, Posterior,
    VERSION,
};
pub use random::Random;
pub use training::{Losses, TrainingSet, train};
pub use weights::{Array, Weights};
