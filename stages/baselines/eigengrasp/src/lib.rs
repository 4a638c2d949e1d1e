//! `GraspIt`'s search in a space of eigengrasps: the classical planner of grasps.
//!
//! The hand's joints move along the principal components of retargeted grasps. The palm's pose and the components'
//! amplitudes are annealed so that virtual contacts on palm and fingers come near the object and face it (Ciocarlie and
//! Allen, *Dexterous Grasping via Eigengrasps: A Low-dimensional Approach to a High-complexity Problem*, 2007). The
//! best
//! states of each run are finished, the palm advancing until it touches and the fingers closing joint by joint, and
//! ranked by the radius of the largest ball within their wrenches (Ferrari and Canny, *Planning optimal grasps*, 1992).
//!
//! One unit per object. The way to each grasp is the script of [`approach`]. Nothing is simulated: `screen` judges
//! every
//! generator alike.

mod annealing;
mod annealing_run;
mod basis;
mod config;
mod eigengrasp;
mod energy;
mod error;
#[cfg(test)]
mod fixture;
mod hull;
mod quality;
mod variables;

pub use config::EigengraspConfig;
pub use eigengrasp::{Eigengrasp, EigengraspMetrics};
pub use error::EigengraspError;
