//! Grasp synthesis with test-time adaptation: a variational autoencoder draws a grasp for an object, a second network
//! says where on the object that grasp should touch, and the grasp is moved until it does (Jiang, Liu, Wang and Wang,
//! *Hand-Object Contact Consistency Reasoning for Human Grasps Generation*, ICCV 2021), for a robot hand.
//!
//! [`train_grasps`] fits both networks to the last steps of retargeted demonstrations; [`GraspNetworks::grasps`] draws
//! grasps and moves them. A hand is 25 numbers for 16 joints: translation, two columns of its
//! rotation, joint positions. Everything is in the table's frame, z up, the table at z = 0, in meters and radians.
//!
//! Losses and their gradients by these numbers are computed by hand, through kinematics to fixed points on the hand's
//! surface ([`HandSurface`]): the networks alone are on candle's tape, and the adaptation needs none.

mod adaptation;
mod checkpoint;
mod config;
mod contact_map;
#[cfg(test)]
mod fixture;
mod loss;
mod nearest;
mod networks;
mod surface;
mod training;

pub use self::{
    adaptation::{Adaptation, AdaptedGrasp},
    checkpoint::GraspDescription,
    config::{AdaptationConfig, GraspNetworkConfig, GraspTrainingConfig, TermWeights},
    loss::GraspTerms,
    networks::GraspNetworks,
    surface::HandSurface,
    training::{DemonstratedGrasp, GraspEpoch, GraspOptions, GraspSet, train_grasps},
};
