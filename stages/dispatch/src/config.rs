//! Options of `kind = "dispatch"`.

use std::{collections::BTreeMap, path::PathBuf, time::Duration};

use cell::{Access, CellError, Keys, with_causes};
use options::{OptionFaults, above, options};
use planning::{ArmConfig, CommandRatesConfig, LimitsConfig};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use simulation::{Protocol, SceneConfig, SceneRandomization};

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
#[options(also = Self::combined_faults)]
pub struct DispatchConfig {
    /// `simulated`, which this stage starts itself, or the endpoint of a cell or its router: on
    /// this machine e.g. `tcp/127.0.0.1:7447`, on another e.g. `tls/robot.lab:7447`.
    pub cell: String,
    /// Access file with the dispatcher's credentials, a certificate or password, e.g.
    /// `data/access/certificates/dispatcher.json5` (none).
    // Credentials do not change what a cell does.
    #[option(path, default)]
    pub access: Option<PathBuf>,
    /// The cell's name in its keys, `cgf/cell/NAME/…`.
    #[option(default = SIMULATED.to_owned())]
    pub cell_name: String,
    /// Endpoint of the simulated cell, on the loopback interface; port 0 takes any free one, so
    /// that several runs can go at once; a fixed one can be watched, e.g. `tcp/127.0.0.1:7447`.
    // The endpoint does not change what a cell does.
    #[serde(skip_serializing)]
    #[option(default = "tcp/127.0.0.1:0".to_owned())]
    pub listen: String,
    /// Whether a cell that is not simulated may move; without it the run is a dry run.
    #[option(default)]
    pub execute: bool,
    /// Largest number of feasible motions sent for one object. Few, because each takes seconds of a
    /// robot's time; paper: 20.
    #[option(
        default = 3, range = 0..=MAX_MOTIONS,
        why = "each motion takes seconds of a robot's time"
    )]
    pub per_object: usize,
    /// Order in which an object's accepted motions are sent: `robust`, by the share of their trials under
    /// errors that succeed, and different grasps first (the default), or `accepted`, as they were
    /// screened.
    #[option(default)]
    pub order: SendOrder,
    /// Number of this attempt: increase it to execute motions again at a cell that knows them.
    #[option(default = 1)]
    pub attempt: u32,
    /// Whether motions stopped by a person before this run are sent again, each as a new goal;
    /// without it they are reported and skipped.
    // Resending moves the robot again but must not invalidate finished results.
    #[serde(skip_serializing)]
    #[option(default)]
    pub resume_stopped: bool,
    /// What follows an outcome that the cell itself reports as unknown: `stop`, the run ends with code 1 so that a
    /// person looks at the robot (the default), or `continue`, with the next motion. Without the cell's word a run
    /// ends in any case.
    // As `resume_stopped`.
    #[serde(skip_serializing)]
    #[option(default)]
    pub after_unknown: AfterUnknown,
    /// Timeout for a cell to accept or refuse a goal (s): a check takes far less.
    #[option(
        default = 10.0, range = above(0.0, DAY_S),
        why = "a run that waits longer waits for nothing"
    )]
    pub answer_timeout_s: f64,
    /// Timeout for a cell to execute a motion (s): one takes about 5 s, and may be slowed down.
    #[option(
        default = 60.0, range = above(0.0, DAY_S),
        why = "a run that waits longer waits for nothing"
    )]
    pub result_timeout_s: f64,
    /// Largest difference of a joint from the first step when the motion starts (rad): 6°, which a
    /// controller takes up without a jerk.
    #[option(default = 0.1, range = 0.0..=MAX_ERROR, why = "it is a joint angle in radians")]
    pub start_tolerance_rad: f64,
    /// File of the robot hand, or its URDF alone; the root link is the palm.
    #[option(path)]
    pub hand: PathBuf,
    /// The arm that carries the hand (none: the hand is free-flying).
    #[option(default, table)]
    pub arm: Option<ArmConfig>,
    /// Joint names on the wire by joint names in the URDF, where a cell's differ, e.g. `{
    /// "joint_0.0" = "ah_joint00" }` (none).
    #[option(default)]
    pub joint_names: BTreeMap<String, String>,
    /// Command rates of the controllers: their own rates, so that none has to interpolate.
    #[option(default, table)]
    pub rates: CommandRatesConfig,
    /// Limits on the speeds of palm and joints.
    #[option(default, table)]
    pub limits: LimitsConfig,
    /// Execution and success criteria of a motion; a path slowed down by limits gets the time that
    /// it needs.
    pub protocol: Protocol,
    /// The simulated cell's physics.
    #[option(table)]
    pub simulated: SimulatedConfig,
}

/// Order in which an object's accepted motions are sent.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(inline)]
pub enum SendOrder {
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
#[options(also = Self::scene_faults)]
pub struct SimulatedConfig {
    /// Errors of the object's pose, of friction, of its mass and of the fingers' delay, sampled for each
    /// goal.
    #[option(default)]
    pub errors: SceneRandomization,
    /// Delay until a command takes effect (s): a cycle of the hand's controller.
    #[option(
        default = 0.003, range = 0.0..=LATEST_S,
        why = "a longer latency exceeds the duration of a motion"
    )]
    pub latency_s: f64,
    /// Standard deviation of the encoders' noise on joint positions (rad): a tenth of a degree.
    #[option(
        default = 0.002, range = 0.0..=MAX_ERROR,
        why = "it is a standard deviation in radians"
    )]
    pub encoder_noise_rad: f64,
    /// The scene; give it another mass or friction than the screen's.
    #[option(table)]
    pub scene: SceneConfig,
}

impl DispatchConfig {
    /// Returns the options for which the protocol's name stands.
    #[must_use]
    pub fn resolved(&self) -> Self {
        let (scene, protocol) = self.protocol.resolved(&self.simulated.scene);
        let simulated = SimulatedConfig {
            scene,
            ..self.simulated.clone()
        };
        Self {
            protocol,
            simulated,
            ..self.clone()
        }
    }

    fn combined_faults(&self, faults: &mut OptionFaults) {
        let elsewhere = ["tcp/", "tls/"];
        if self.cell != SIMULATED && !elsewhere.iter().any(|way| self.cell.starts_with(way)) {
            let problem = format!(
                "`{}` is neither `simulated` nor `tcp/HOST:PORT` or `tls/HOST:PORT`",
                self.cell
            );
            faults.note("cell", problem);
        } else if self.cell != SIMULATED {
            let checked = cell::check_endpoint(&self.cell, self.access.as_deref());
            note_cell("cell", checked, faults);
        }
        note_cell("cell_name", Keys::new(&self.cell_name).map(drop), faults);
        faults.of_table("protocol", self.protocol.faults_in(&self.simulated.scene));
        if let Some(fault) = self.protocol.cell_fault() {
            faults.note(&fault.key, fault.problem);
        }
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
    fn scene_faults(&self, faults: &mut OptionFaults) {
        faults.of_table("errors", self.errors.faults_in(&self.scene));
    }
}

/// Notes why a cell cannot be reached as an option says.
fn note_cell(key: &str, checked: Result<(), CellError>, faults: &mut OptionFaults) {
    if let Err(err) = checked {
        let hint = err.hint().map(|hint| format!("; {hint}"));
        faults.note(key, with_causes(&err) + &hint.unwrap_or_default());
    }
}
