//! Judges candidate motions in physics.
//!
//! The simulated hand executes every candidate on the object in the candidate's resting orientation:
//! reach, close, squeeze, lift, hold. The outcome is a row of `rollouts`, success or one reason for
//! failure; the first accepted and failed ones of each object are recorded for a viewer. Beside it is a row of
//! `smoothness`, of the motion as drawn and as executed. Accepted motions are tried again under drawn errors; the
//! share that succeeds is a row of `robustness`. `pose_errors` has motions, accepted or not, with the object off its
//! estimated pose.
//!
//! Candidates are independent: they run on all threads and keep their order, and each can be rerun
//! alone with the same verdict. This stage does not depend on the generator.
//!
//! Its [`report`] has success rates, failure reasons and the diversity of grasps.

mod by_verdict;
mod config;
mod error;
mod pose_errors;
mod record_alone;
mod recording;
pub mod report;
mod robustness;
mod screen;
mod screening_inputs;

pub use by_verdict::ByVerdict;
pub use config::{RobustnessConfig, ScreenConfig};
pub use error::ScreenError;
pub use pose_errors::{PoseErrorMetrics, PoseErrorTrials};
pub use record_alone::record_alone;
pub use robustness::{RobustnessMetrics, RobustnessTrials};
pub use screen::{Screen, ScreenMetrics, row};
pub use screening_inputs::screening;
