//! Why motions cannot be exported.

use geometry::GeometryError;
use motion::MotionError;

/// Why motions cannot be exported.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FormatError {
    /// There is nothing to export.
    #[error("there is no motion to export")]
    Empty,
    /// A motion's steps are not a motion.
    #[error("`{name}` is not a motion")]
    Motion {
        /// The motion.
        name: String,
        /// The fault.
        source: MotionError,
    },
    /// Some steps of a motion have a commanded position, and others none.
    #[error("`{name}` has commands at some steps only")]
    Commands {
        /// The motion.
        name: String,
    },
    /// Motions of different hands cannot be in one file.
    #[error("`{name}` has other joints than `{first}`")]
    Joints {
        /// The motion.
        name: String,
        /// The first motion.
        first: String,
    },
    /// Two motions have one name.
    #[error("two motions are named `{name}`")]
    Twice {
        /// The name.
        name: String,
    },
    /// The evaluator has no model of the hand.
    #[error(
        "the joint `{joint}` is not one of a right Allegro hand's, `joint_0.0` to `joint_15.0`"
    )]
    NotAllegro {
        /// The first such joint, or the first that is missing.
        joint: String,
    },
    /// The evaluator has no model of a left hand.
    #[error("the hand `{hand}` is a left one")]
    NotRight {
        /// The robot's name.
        hand: String,
    },
    /// The times of pregrasp and grasp are not in order.
    #[error(
        "pregrasp at {pregrasp} and grasp at {grasp} of the motion are not in order within 0..=1"
    )]
    GraspTimes {
        /// Fraction of the motion.
        pregrasp: f64,
        /// Fraction of the motion.
        grasp: f64,
    },
    /// An object's shape is not known.
    #[error("the shape of `{object}` is not known")]
    Shape {
        /// The object.
        object: String,
    },
    /// A convex part of an object spans no volume.
    #[error("a convex part of `{object}` cannot be used")]
    Part {
        /// The object.
        object: String,
        /// The fault.
        source: GeometryError,
    },
    /// A table cannot be encoded.
    #[error("cannot encode `{file}`: {message}")]
    Encode {
        /// The file.
        file: String,
        /// The encoder's message.
        message: String,
    },
}

impl FormatError {
    /// Returns a function that names the file that cannot be encoded.
    pub(crate) fn encode<E: std::fmt::Display>(file: &str) -> impl Fn(E) -> Self {
        move |err| Self::Encode {
            file: file.to_owned(),
            message: err.to_string(),
        }
    }

    /// Returns the next action, where there is one.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::Empty => Some(
                "name other partitions, or another artifact: `pipeline inspect STAGE.ARTIFACT` lists them"
                    .to_owned(),
            ),
            Self::Joints { .. } => {
                Some("export the motions of each hand on their own".to_owned())
            }
            Self::NotAllegro { .. } | Self::NotRight { .. } => Some(
                "of the bench's hands only the right Allegro is supported; `lerobot` and `csv` take any".to_owned(),
            ),
            Self::GraspTimes { .. } => {
                Some("e.g. `--pregrasp-at 0.75 --grasp-at 0.9`".to_owned())
            }
            Self::Shape { .. } => Some("export from a run that has `objects`".to_owned()),
            Self::Motion { .. }
            | Self::Commands { .. }
            | Self::Twice { .. }
            | Self::Part { .. }
            | Self::Encode { .. } => None,
        }
    }
}
