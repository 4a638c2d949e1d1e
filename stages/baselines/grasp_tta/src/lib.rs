//! Grasp synthesis with test-time adaptation (Jiang, Liu, Wang and Wang, *Hand-Object Contact Consistency Reasoning for
//! Human Grasps Generation*, ICCV 2021), for a robot hand: the learned baseline that makes grasps and no motions.
//!
//! The first output, `grasp_networks`, is what is learned from the last steps of retargeted demonstrations; the second,
//! `candidates`, has grasps drawn from it, each adapted to its object ([`cgf::grasp_tta`]), with the way to them that
//! the script of [`approach`] makes. Options of the adaptation rerun no training.
//!
//! Nothing is simulated: `screen` judges every generator alike.

mod candidates;
mod config;
mod error;
#[cfg(test)]
mod fixture;
mod grasp_tta;
mod networks;
mod surface;

pub use candidates::{AdaptedCandidates, GraspTtaMetrics};
pub use config::{Finish, GraspTtaConfig};
pub use error::GraspTtaError;
pub use grasp_tta::GraspTta;
pub use networks::{GraspNetworksMetrics, LearnedNetworks};
