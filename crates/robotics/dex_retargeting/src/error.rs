//! Why a configuration cannot be used.

use motion::MotionError;
use posture::SolverError;
use robot::RobotError;

/// Reason why a text is no configuration of dex-retargeting.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ConfigError {
    /// The text is not YAML, or a value has another type.
    #[error("{0}")]
    Syntax(String),
    /// The library knows no such key.
    #[error("unknown key `{key}` of `retargeting`")]
    UnknownKey {
        /// The key.
        key: String,
        /// The nearest one that exists.
        near: Option<String>,
    },
    /// The library knows no such type of objective.
    #[error("`type` is `{0}`")]
    UnknownType(String),
    /// The objective needs a key that is missing.
    #[error("`type: {kind}` needs `{key}`")]
    MissingKey {
        /// The type.
        kind: &'static str,
        /// The key.
        key: &'static str,
    },
    /// Two lists do not fit together.
    #[error("`{key}` is {found}, and `{other}` is {expected}")]
    Lengths {
        /// The one list.
        key: &'static str,
        /// Its shape.
        found: String,
        /// The other.
        other: &'static str,
        /// Its shape.
        expected: String,
    },
    /// No landmark has such a number.
    #[error("`target_link_human_indices` names landmark {0}")]
    NoLandmark(i64),
    /// `dexpilot` works on two to five fingers.
    #[error("`finger_tip_link_names` names {0} fingers")]
    Fingers(usize),
    /// A number that makes no sense.
    #[error("`{key}` is {value}")]
    BadNumber {
        /// The key.
        key: &'static str,
        /// The number.
        value: f64,
    },
}

/// Reason why a configuration cannot be used on a robot.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProblemError {
    /// The URDF cannot be used, or has no link or joint of a name.
    #[error(transparent)]
    Robot(#[from] RobotError),
    /// The solver cannot work on the robot.
    #[error(transparent)]
    Solver(#[from] SolverError),
    /// The steps make no motion, e.g. because their times do not increase.
    #[error(transparent)]
    Motion(#[from] MotionError),
    /// A hand is to be followed along its wrist, and has no axes.
    #[error("wrist and knuckles of step {step} lie on a line")]
    NoWrist {
        /// The step, from 0.
        step: usize,
    },
    /// Limits cannot be wider by so much.
    #[error("limits cannot be wider by {slack}")]
    Slack {
        /// The number.
        slack: f64,
    },
    /// A number of a frame is not finite.
    #[error("a landmark is no finite number")]
    NotFinite,
    /// There are not as many reference values as the objective follows.
    #[error("{found} reference values, and the objective follows {expected}")]
    References {
        /// Number of values.
        found: usize,
        /// Number that are followed.
        expected: usize,
    },
}

impl ConfigError {
    /// Returns a remedy, if one is known.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::Syntax(_) => Some(
                "the file is one table `retargeting:`, as those that dex-retargeting ships".to_owned(),
            ),
            Self::UnknownKey { near, .. } => {
                near.as_ref().map(|near| format!("did you mean `{near}`?"))
            }
            Self::UnknownType(_) => {
                Some("`type` is `position`, `vector` or `dexpilot`".to_owned())
            }
            Self::MissingKey { key, .. } => Some(format!("add `{key}` to the file")),
            Self::Lengths { .. } => Some("name one landmark for each link".to_owned()),
            Self::NoLandmark(_) => Some(
                "landmarks are 0 to 20: the wrist; thumb, index, middle, ring and little finger, four each".to_owned(),
            ),
            Self::Fingers(_) => Some("name two to five fingertips, the thumb's first".to_owned()),
            Self::BadNumber { .. } => Some("lengths, factors and weights are positive".to_owned()),
        }
    }
}

impl ProblemError {
    /// Returns a remedy, if one is known.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::Robot(err) => err.hint(),
            Self::Solver(_) | Self::Motion(_) | Self::NoWrist { .. } => None,
            Self::Slack { .. } => Some("pass 0, or 0.001 as the library has it".to_owned()),
            Self::NotFinite => Some("leave out frames that were not measured".to_owned()),
            Self::References { .. } => Some(
                "pass a point for each of `target_link_names`, or a vector for each pair of links"
                    .to_owned(),
            ),
        }
    }
}
