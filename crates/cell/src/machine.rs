//! The machine behind a cell: a simulation, or the controllers of a robot.

use std::time::Duration;

use crate::{
    EncodedGoal, Goal, Rejection,
    capabilities::{ControllerInfo, PalmLimits},
    report::{Report, Sample},
    server::MonitoredMotion,
};

/// The machine that a [`crate::CellServer`] moves.
///
/// The server speaks the protocol: it journals goals, answers, signs, counts heartbeats and keeps
/// requests to stop. A machine checks goals and executes one at a time.
pub trait Machine: Send + Sync {
    /// Describes the machine; the description does not change.
    fn description(&self) -> MachineDescription;

    /// Checks a new goal; nothing moves.
    ///
    /// # Errors
    ///
    /// Fails with the refusal; `busy` where the machine is not ready for any goal yet.
    fn check(&self, goal: &Goal) -> Result<(), Rejection>;

    /// Returns the present measurement, its joints in the order of the description; `None` if there
    /// is none. Called while no goal executes.
    fn measure(&self) -> Option<Sample>;

    /// Executes a goal that was accepted, and returns when nothing moves any more.
    ///
    /// The machine passes its measurements to [`MonitoredMotion::see`], stops on request,
    /// and calls [`MonitoredMotion::has_stopped`] once it has.
    fn execute(
        &self,
        goal: &Goal,
        encoded: &EncodedGoal,
        motion: &mut MonitoredMotion<'_>,
    ) -> Report;
}

/// A machine as `capabilities` has it.
#[derive(Debug, Clone, PartialEq)]
pub struct MachineDescription {
    /// Whether no hardware moves.
    pub simulated: bool,
    /// Digest of the robot's URDF ([`crate::robot_digest`]).
    pub robot: String,
    /// All joints, in the order of its measurements.
    pub joints: Vec<String>,
    /// The controllers: the palm's or arm's, then the hand's.
    pub controllers: Vec<ControllerInfo>,
    /// Limits of the palm, if the hand is free-flying.
    pub palm: Option<PalmLimits>,
    /// Pose of the arm's base in the table's frame, if there is an arm.
    pub table_from_base: Option<[f64; 7]>,
    /// Known differences from the planning model, as text for people.
    pub gap: String,
    /// Heartbeat timeout before a motion is aborted, if heartbeats count.
    pub silence: Option<Duration>,
}
