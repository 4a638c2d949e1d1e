//! From a grasp to a motion, the same for every generator of grasps, and a hand that closes until it touches.
//!
//! A generator finds the last step alone. The way there is a script: from a [`Start`], the first step of a retargeted
//! demonstration carried to where the object lies, straight to a pregrasp, which is the grasp with its palm backed
//! off along its [`HandAxes`] and its fingers opened, and straight to the grasp ([`ApproachPath`]). Rates are exact.
//!
//! [`Attempts`] gives each random attempt at a grasp its own random numbers and resting pose.
//!
//! [`HandBody`] says how near a hand is to an object and a table, link by link; [`HandBody::closed`] closes the
//! fingers on the object, joint by joint. Nothing is simulated, and fingers do not stop at each other.
//!
//! Everything is in meters, radians and seconds; hands are in the object's frame.

mod approach_path;
mod attempts;
mod axes;
mod body;
mod candidate;
mod closing;
mod config;
mod error;
#[cfg(test)]
mod fixture;
mod palms;
mod pregrasp;
mod rest_distribution;
mod start;
mod virtual_contacts;
mod wrenches;

pub use approach_path::ApproachPath;
pub use attempts::Attempts;
pub use axes::HandAxes;
pub use body::{HandBody, PlacedHand, Touch};
pub use candidate::{Grasp, Reach};
pub use config::{ApproachConfig, RestChoice};
pub use error::ApproachError;
pub use palms::{Palms, uniform_rotation};
pub use pregrasp::pregrasp;
pub use rest_distribution::RestDistribution;
pub use start::{Start, grasping_hands, grasps, joints_of};
pub use virtual_contacts::virtual_contacts;
pub use wrenches::ContactModel;
