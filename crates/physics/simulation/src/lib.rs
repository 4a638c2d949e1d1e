//! Rapier worlds of a hand, an object and a table, and rollouts in them.
//!
//! A [`SettledScene`] is one object lying on a table with one hand beside it, built and settled once.
//! [`SettledScene::rollout`] runs one [`motion::Motion`] in a fresh copy of it: reach, close, squeeze, lift,
//! hold; the [`Verdict`] says how it ended and, if it failed, the one reason.
//!
//! - The hand is a reduced-coordinate multibody made from the same [`robot::RobotModel`] that
//!   kinematics uses. Its palm is a kinematic joint with six degrees of freedom: it follows its path exactly, with any
//!   force, or lags by drives of its own ([`PalmDriveConfig`]); with [`PalmComplianceConfig`], as by `full_contact`,
//!   contact pushes it off its path.
//! - Finger joints are PD drives, with an optional velocity reference and inverse dynamics, integrated
//!   implicitly, with clamped torque.
//! - Equal arguments give equal bytes: no clock, no threads, a fresh copy of the world each time.
//! - Everything outside is `f64` and in the frames of [`spatial`]; inside, physics is `f32` and in
//!   centimeters.
//!
//! It does not know of candidates, files or robots' wires.

mod config;
mod contact;
mod desired;
mod episode;
mod error;
#[cfg(test)]
mod fixture;
mod hand;
mod judge;
mod object;
mod palm_compliance;
mod palm_course;
mod played;
mod protocols;
mod rejection;
mod rollout;
mod scene_randomization;
mod script;
mod settings;
mod settled_scene;
mod shortcuts;
mod units;
mod world;

pub use config::{
    Approach, ControllerKind, DriveConfig, KnockedUntil, ObjectMass, Offset, PalmComplianceConfig,
    PalmDriveConfig, Protocol, PullConfig, SceneConfig, StrictConfig, Support, Trial,
};
pub use contact::ContactPoint;
pub use episode::{Divergence, Episode, EpisodeState};
pub use error::SimulationError;
pub use object::ObjectShape;
pub use played::CommandStep;
pub use protocols::ProtocolName;
pub use rollout::{Rollout, StepDecision, Trace, TraceMode, TraceStep, WatchedRollout};
pub use scene_randomization::SceneRandomization;
pub use schemas::rollouts::{Measures, Verdict};
pub use script::{Flexion, Phase, Setpoint};
pub use settled_scene::{SettledScene, check_hand};
pub use shortcuts::Shortcuts;
