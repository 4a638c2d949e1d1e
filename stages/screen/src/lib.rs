//! Judges candidate motions in physics.
//!
//! Every candidate is carried out by the simulated hand on the object, lying as the candidate says:
//! reach, close, squeeze, lift, hold. What becomes of it is a row of `rollouts`, success or one
//! reason for failure; the first accepted ones of each object are recorded for a viewer.
//!
//! Candidates are independent: they run on all threads and keep their order, and each can be run
//! again alone with the same verdict. This stage does not know who drew them.
//!
//! How often they hold, why the others fail and how different the grasps are says crate
//! `report-screen`.

mod by_verdict;
mod config;
mod error;
mod pose_noise;
mod recording;
mod smoothness;
mod stage;
mod verdicts;

pub use by_verdict::ByVerdict;
pub use config::ScreenConfig;
pub use error::ScreenError;
pub use stage::{Screen, ScreenMetrics};
