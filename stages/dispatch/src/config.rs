//! Options of `kind = "dispatch"`.

use std::{collections::BTreeMap, path::PathBuf, time::Duration};

use cell::{Access, CellError, Keys, with_causes};
use dataflow::{Diagnostic, OptionFault, OptionFaults};
use planning::{ArmConfig, CommandRatesConfig, LimitsConfig};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use simulation::{Protocol, SceneConfig, SceneRandomization};

use crate::DispatchError;

/// The value of `cell` for the simulated cell.
pub const SIMULATED: &str = "simulated";

/// Longest timeout accepted, in seconds.
const DAY_S: f64 = 86_400.0;

/// Maximum number of motions of one object.
const MAX_MOTIONS: usize = 1_000_000;

/// Largest latency of a simulated cell, in seconds.
const LATEST_S: f64 = 10.0;

/// Largest angle by which a joint may be off, in radians.
const MAX_ERROR: f64 = 1000.0;

/// Options of `kind = "dispatch"`.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DispatchConfig {
    /// `simulated`, which this stage starts itself, or the endpoint of a cell or its router: on
    /// this machine e.g. `tcp/127.0.0.1:7447`, on another e.g. `tls/robot.lab:7447`.
    pub cell: String,
    /// Access file with the dispatcher's credentials, a certificate or password, e.g.
    /// `data/access/certificates/dispatcher.json5` (none).
    // Credentials do not change what a cell does.
    #[serde(default, skip_serializing)]
    pub access: Option<PathBuf>,
    /// The cell's name in its keys, `cgf/cell/NAME/…`.
    #[serde(default = "defaults::cell_name")]
    pub cell_name: String,
    /// Endpoint of the simulated cell, on the loopback interface; port 0 takes any free one, so
    /// that several runs can go at once; a fixed one can be watched, e.g. `tcp/127.0.0.1:7447`.
    // The endpoint does not change what a cell does.
    #[serde(default = "defaults::listen", skip_serializing)]
    pub listen: String,
    /// Whether a cell that is not simulated may move; without it the run is a dry run.
    #[serde(default)]
    pub execute: bool,
    /// Largest number of feasible motions sent for one object. Few, because each takes seconds of a
    /// robot's time; paper: 20.
    #[serde(default = "defaults::per_object")]
    pub per_object: usize,
    /// Order in which an object's accepted motions are sent: `robust`, by the share of their trials under
    /// errors that succeed, and different grasps first (the default), or `accepted`, as they were
    /// screened.
    #[serde(default)]
    pub order: Order,
    /// Number of this attempt: increase it to execute motions again at a cell that knows them.
    #[serde(default = "defaults::attempt")]
    pub attempt: u32,
    /// Whether motions stopped by a person before this run are sent again, each as a new goal;
    /// without it they are reported and skipped.
    // Resending moves the robot again but must not invalidate finished results.
    #[serde(default, skip_serializing)]
    pub resume_stopped: bool,
    /// What follows an outcome that the cell itself reports as unknown: `stop`, the run ends with code 1 so that a
    /// person looks at the robot (the default), or `continue`, with the next motion. Without the cell's word a run
    /// ends in any case.
    // As `resume_stopped`.
    #[serde(default, skip_serializing)]
    pub after_unknown: AfterUnknown,
    /// Timeout for a cell to accept or refuse a goal (s): a check takes far less.
    #[serde(default = "defaults::answer_timeout_s")]
    pub answer_timeout_s: f64,
    /// Timeout for a cell to execute a motion (s): one takes about 5 s, and may be slowed down.
    #[serde(default = "defaults::result_timeout_s")]
    pub result_timeout_s: f64,
    /// Largest difference of a joint from the first step when the motion starts (rad): 6°, which a
    /// controller takes up without a jerk.
    #[serde(default = "defaults::start_tolerance_rad")]
    pub start_tolerance_rad: f64,
    /// File of the robot hand, or its URDF alone; the root link is the palm.
    #[serde(skip_serializing)]
    pub hand: PathBuf,
    /// The arm that carries the hand (none: the hand is free-flying).
    #[serde(default)]
    pub arm: Option<ArmConfig>,
    /// Joint names on the wire by joint names in the URDF, where a cell's differ, e.g. `{
    /// "joint_0.0" = "ah_joint00" }` (none).
    #[serde(default)]
    pub joint_names: BTreeMap<String, String>,
    /// Command rates of the controllers: their own rates, so that none has to interpolate.
    #[serde(default)]
    pub rates: CommandRatesConfig,
    /// Limits on the speeds of palm and joints.
    #[serde(default)]
    pub limits: LimitsConfig,
    /// Execution and success criteria of a motion; a path slowed down by limits gets the time that
    /// it needs.
    pub protocol: Protocol,
    /// The simulated cell's physics.
    pub simulated: SimulatedConfig,
}

/// Order in which an object's accepted motions are sent.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(inline)]
pub enum Order {
    /// The most robust first, and of about equally robust ones the one whose grasp differs most from
    /// those before it.
    #[default]
    Robust,
    /// As they were screened.
    Accepted,
}

/// What follows an outcome that the cell itself reports as unknown.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(inline)]
pub enum AfterUnknown {
    /// The run ends.
    #[default]
    Stop,
    /// The next motion is sent.
    Continue,
}

/// The simulated cell: where it differs from the screen is the gap that a motion must bridge.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SimulatedConfig {
    /// Errors of the object's pose, of friction, of its mass and of the fingers' delay, sampled for each
    /// goal.
    #[serde(default)]
    pub errors: SceneRandomization,
    /// Delay until a command takes effect (s): a cycle of the hand's controller.
    #[serde(default = "defaults::latency_s")]
    pub latency_s: f64,
    /// Standard deviation of the encoders' noise on joint positions (rad): a tenth of a degree.
    #[serde(default = "defaults::encoder_noise_rad")]
    pub encoder_noise_rad: f64,
    /// The scene; give it another mass or friction than the screen's.
    pub scene: SceneConfig,
}

impl DispatchConfig {
    /// Returns the invalid options that types do not catch.
    pub(crate) fn faults(&self) -> Vec<OptionFault> {
        let mut faults = OptionFaults::default();
        let arm = self.arm.as_ref().map_or(Ok(()), ArmConfig::check);
        let of_planning = [self.limits.check(), arm].map(|checked| checked.map_err(Into::into));
        for checked in [self.check()].into_iter().chain(of_planning) {
            match checked {
                Ok(()) => {}
                Err(DispatchError::BadOption { key, problem }) => faults.note(key, problem),
                Err(other) => {
                    let hint = other.hint().map(|hint| format!("; {hint}"));
                    let problem = format!("{}{}", with_causes(&other), hint.unwrap_or_default());
                    faults.note(option_behind(&other), problem);
                }
            }
        }
        let why = "each motion takes seconds of a robot's time";
        faults.within("per_object", self.per_object, 0..=MAX_MOTIONS, why);
        let why = "it is a joint angle in radians";
        let tolerance_rad = self.start_tolerance_rad;
        faults.within("start_tolerance_rad", tolerance_rad, 0.0..=MAX_ERROR, why);
        faults.of_table("protocol", self.protocol.faults(&self.simulated.scene));
        if let Some(fault) = self.protocol.cell_fault() {
            faults.note(fault.key, fault.problem);
        }
        self.simulated.check(&mut faults);
        faults.found()
    }

    /// Checks the options beyond their types.
    pub(crate) fn check(&self) -> Result<(), DispatchError> {
        let wrong =
            |key: &'static str, problem: String| Err(DispatchError::BadOption { key, problem });
        let elsewhere = ["tcp/", "tls/"]
            .iter()
            .any(|way| self.cell.starts_with(way));
        if self.cell != SIMULATED && !elsewhere {
            let problem = format!(
                "`{}` is neither `simulated` nor `tcp/HOST:PORT` or `tls/HOST:PORT`",
                self.cell
            );
            return wrong("cell", problem);
        }
        if self.cell != SIMULATED {
            cell::check_endpoint(&self.cell, self.access.as_deref())?;
        }
        for (key, seconds) in [
            ("answer_timeout_s", self.answer_timeout_s),
            ("result_timeout_s", self.result_timeout_s),
        ] {
            if !(seconds > 0.0 && seconds <= DAY_S) {
                return wrong(key, format!("{seconds} is not between 0 and {DAY_S} s"));
            }
        }
        self.rates.check()?;
        Keys::new(&self.cell_name)?;
        Ok(())
    }

    /// Reads the credentials; the simulated cell is in this process and needs none.
    pub(crate) fn credentials(&self) -> Result<Option<Access>, CellError> {
        let access = self.access.as_deref().filter(|_| self.cell != SIMULATED);
        access.map(Access::read).transpose()
    }

    /// Returns the timeout of an answer.
    pub(crate) fn answer_timeout(&self) -> Duration {
        Duration::from_secs_f64(self.answer_timeout_s)
    }

    /// Returns the timeout of an execution.
    pub(crate) fn result_timeout(&self) -> Duration {
        Duration::from_secs_f64(self.result_timeout_s)
    }
}

impl SimulatedConfig {
    fn check(&self, faults: &mut OptionFaults) {
        let why = "a longer latency exceeds the duration of a motion";
        faults.within("simulated.latency_s", self.latency_s, 0.0..=LATEST_S, why);
        let (key, noise_rad) = ("simulated.encoder_noise_rad", self.encoder_noise_rad);
        faults.within(
            key,
            noise_rad,
            0.0..=MAX_ERROR,
            "it is a standard deviation in radians",
        );
        faults.of_table("simulated.errors", self.errors.faults(&self.scene));
        faults.of_table("simulated.scene", self.scene.faults());
    }
}

/// Returns the option that a failed check concerns.
fn option_behind(err: &DispatchError) -> &'static str {
    match err {
        DispatchError::Cell(CellError::Name { .. }) => "cell_name",
        _ => "cell",
    }
}

/// Defaults of options; the options' docs give the reasons.
#[rustfmt::skip]
mod defaults {
    pub(super) fn cell_name() -> String { super::SIMULATED.to_owned() }
    pub(super) fn listen() -> String { "tcp/127.0.0.1:0".to_owned() }
    pub(super) fn per_object() -> usize { 3 }
    pub(super) fn attempt() -> u32 { 1 }
    pub(super) fn answer_timeout_s() -> f64 { 10.0 }
    pub(super) fn result_timeout_s() -> f64 { 60.0 }
    pub(super) fn start_tolerance_rad() -> f64 { 0.1 }
    pub(super) fn latency_s() -> f64 { 0.003 }
    pub(super) fn encoder_noise_rad() -> f64 { 0.002 }
}
