//! Why motions could not be dispatched.

use std::path::PathBuf;

use cell::CellError;
use dataflow::Diagnostic;
use options::OptionFault;

use planning::MAX_HZ;

/// Why motions could not be dispatched; a failed motion is a row of `executions`.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DispatchError {
    /// An option has an invalid value.
    #[error("option `{}` of dispatch cannot be used: {}", .0.key, .0.problem)]
    BadOption(OptionFault),
    /// The cell cannot be reached or started.
    #[error(transparent)]
    Cell(#[from] CellError),
    /// The cell's robot differs from the one planned for.
    #[error("cell `{cell}` drives another robot than `{}`; nothing was sent to it", hand.display())]
    OtherRobot {
        /// The cell's name.
        cell: String,
        /// The URDF planned for.
        hand: PathBuf,
    },
    /// The cell's controllers differ from the goals'.
    #[error("cell `{cell}` cannot take goals for this robot, nothing was sent to it: {problem}")]
    Controllers {
        /// The cell's name.
        cell: String,
        /// The difference.
        problem: ControllerMismatch,
    },
    /// A motion's outcome is unknown: the cell does not answer, or its answer fails its checks.
    #[error(
        "outcome of motion `{candidate_id}` at cell `{cell}` is unknown; the robot may have moved: {message} \
         (goal {goal_id})"
    )]
    Unknown {
        /// The cell's name.
        cell: String,
        /// The motion.
        candidate_id: String,
        /// The goal.
        goal_id: String,
        /// Why the outcome is unknown.
        message: String,
    },
    /// A person canceled the motion.
    #[error(
        "motion `{candidate_id}` was stopped at cell `{cell}` by a person, nothing more is sent: {message} \
         (goal {goal_id})"
    )]
    Stopped {
        /// The cell's name.
        cell: String,
        /// The motion.
        candidate_id: String,
        /// The goal.
        goal_id: String,
        /// The cell's message.
        message: String,
    },
    /// The cell accepts no goals now.
    #[error("cell `{cell}` refuses motion `{candidate_id}` for now; nothing moved: {reason}")]
    NotNow {
        /// The cell's name.
        cell: String,
        /// The motion.
        candidate_id: String,
        /// The cell's reason.
        reason: String,
    },
    /// A report does not hold the robot's joints.
    #[error("the report on goal {goal_id} does not name the joints of `{}`", hand.display())]
    Report {
        /// The goal.
        goal_id: String,
        /// The URDF planned for.
        hand: PathBuf,
    },
    /// A rollout's motion is missing.
    #[error("motion `{candidate_id}` was accepted for `{object}`, but is not among its candidates")]
    NoCandidate {
        /// The object.
        object: String,
        /// The motion.
        candidate_id: String,
    },
    /// A motion's name cannot be the name of its recording.
    #[error("motion `{candidate_id}` cannot name a recording's file")]
    CandidateName {
        /// The motion.
        candidate_id: String,
    },
}

impl From<OptionFault> for DispatchError {
    fn from(fault: OptionFault) -> Self {
        Self::BadOption(fault)
    }
}

/// Difference of a cell's controllers from those that goals command.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ControllerMismatch {
    /// There are not one for the palm or the arm and one for the hand.
    #[error("it has {found} controllers, not two")]
    Count {
        /// Number of controllers.
        found: usize,
    },
    /// Goals move a free palm, and the cell has no limits for it.
    #[error("it says no limits of its palm")]
    NoPalmLimits,
    /// A controller is of another kind.
    #[error("it has a controller `{found}` for `{expected}`")]
    Kind {
        /// Its kind.
        found: String,
        /// The kind that goals command.
        expected: &'static str,
    },
    /// A controller's rate is out of range.
    #[error(
        "its controller `{controller}` is commanded {rate_hz} times a second, expected 1 to {MAX_HZ}"
    )]
    Rate {
        /// The controller.
        controller: String,
        /// Its rate, in 1/s.
        rate_hz: f64,
    },
    /// A controller lacks a joint.
    #[error("its controller `{controller}` has no joint `{joint}`")]
    MissingJoint {
        /// The controller.
        controller: String,
        /// The joint.
        joint: String,
    },
    /// A controller has a joint that no goal commands.
    #[error("no goal commands joint `{joint}` of its controller `{controller}`")]
    UncommandedJoint {
        /// The controller.
        controller: String,
        /// The joint.
        joint: String,
    },
    /// A controller names a joint twice.
    #[error("its controller `{controller}` names a joint twice")]
    JointTwice {
        /// The controller.
        controller: String,
    },
}

impl Diagnostic for DispatchError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::BadOption(_) => {
                Some("`pipeline stages dispatch` lists every option with its unit".to_owned())
            }
            Self::Cell(CellError::PortTaken { .. }) => Some(
                "end it, or take any free port with `--set dispatch.listen=tcp/127.0.0.1:0`".to_owned(),
            ),
            Self::Cell(err) => err.hint(),
            Self::OtherRobot { .. } => Some(
                "set `hand` of every stage to the URDF that the cell was started with".to_owned(),
            ),
            Self::Unknown { .. } => Some(
                "look at the robot; when its cell is up again, the same command asks it for the \
                 outcome of this motion before it sends another; `attempt` makes another goal of it"
                    .to_owned(),
            ),
            Self::Stopped { .. } => Some(
                "look at the robot; the same command counts this motion as stopped and goes on with the \
                 next, with `--set dispatch.resume_stopped=true` it sends this one again"
                    .to_owned(),
            ),
            Self::Controllers { .. } => Some(
                "set `arm` and `joint_names` to what the cell has, or have its drivers changed".to_owned(),
            ),
            Self::NotNow { .. } => Some(
                "clear the cause at the cell, then run the same command: it continues with this \
                 motion"
                    .to_owned(),
            ),
            Self::NoCandidate { .. } => {
                Some("wire `candidates` to the stage whose motions were screened".to_owned())
            }
            Self::Report { .. } | Self::CandidateName { .. } => None,
        }
    }
}
