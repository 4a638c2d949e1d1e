//! Why no grasping function could be trained.

use std::{io, path::PathBuf};

use cgf::CgfError;
use dataflow::Diagnostic;
use folds::Fold;
use motion::MotionError;
use robot::{JointMismatch, WrongDof};

/// Why no grasping function could be trained.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrainError {
    /// No trajectory is of a chosen object.
    #[error("none of {found} trajectories is of an object to train on")]
    NoTrajectories {
        /// Number of trajectories.
        found: usize,
    },
    /// A fold of the objects has none.
    #[error("fold `{fold}` of {objects_n} objects is empty")]
    EmptyFold {
        /// The fold.
        fold: Fold,
        /// Number of objects that have trajectories.
        objects_n: usize,
    },
    /// A trajectory's maker did not label it with its object.
    #[error("trajectory `{sequence}` has no label `object`")]
    NoObject {
        /// The trajectory's sequence.
        sequence: String,
    },
    /// An object has no resting orientation.
    #[error("object `{object}` has no resting orientation")]
    NoRests {
        /// The object.
        object: String,
    },
    /// An object has candidates without rollouts, or the other way round.
    #[error("object `{object}` has `{has}` and no `{lacks}`")]
    OneOfTwo {
        /// The object.
        object: String,
        /// The artifact that it has.
        has: &'static str,
        /// The artifact that it lacks.
        lacks: &'static str,
    },
    /// A candidate was not screened.
    #[error("candidate `{candidate}` has no rollout")]
    NoRollout {
        /// Its name.
        candidate: String,
    },
    /// A generated object may be similar to one that nothing is learned from.
    #[error("shape `{shape}` was not kept apart from the unseen object `{unseen}`")]
    SimilarToUnseen {
        /// The generated object.
        shape: String,
        /// The unseen object.
        unseen: String,
    },
    /// A motion to learn from was made of a demonstration that is not learned from.
    #[error(
        "candidate `{candidate}` was carried over from `{demonstration}`, whose object is unseen"
    )]
    OfUnseen {
        /// The candidate.
        candidate: String,
        /// The demonstration.
        demonstration: String,
    },
    /// A trajectory or an accepted motion belongs to another hand.
    #[error("motion `{sequence}` was made for another hand")]
    HandMismatch {
        /// The trajectory's sequence.
        sequence: String,
        /// The difference of its joints from the hand's.
        source: JointMismatch,
    },
    /// The hand has another number of joints than a motion.
    #[error(transparent)]
    Dof(#[from] WrongDof),
    /// The checkpoint does not know a trajectory.
    #[error("the checkpoint was not trained with trajectory `{sequence}` in view")]
    UnknownTrajectory {
        /// The trajectory's sequence.
        sequence: String,
    },
    /// A trajectory's steps are not a motion.
    #[error("trajectory `{sequence}` cannot be followed")]
    Motion {
        /// The trajectory's sequence.
        sequence: String,
        /// The problem.
        source: MotionError,
    },
    /// The curve of a running training cannot be written.
    #[error("cannot write the training's curve `{}`", path.display())]
    Curve {
        /// Where.
        path: PathBuf,
        /// Why it failed.
        source: io::Error,
    },
    /// The function from which the training goes on has learned from an object that is unseen here.
    #[error(
        "the checkpoint from which the training goes on has learned from object `{object}`, which is unseen here"
    )]
    LearnedUnseen {
        /// The object.
        object: String,
    },
    /// Training failed.
    #[error(transparent)]
    Cgf(#[from] CgfError),
}

impl Diagnostic for TrainError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::NoTrajectories { .. } => {
                Some("check `objects`, `unseen_objects` and `unseen_fold`".to_owned())
            }
            Self::EmptyFold { .. } => {
                Some("choose fewer folds than objects in `unseen_fold`".to_owned())
            }
            Self::OneOfTwo { .. } | Self::NoRollout { .. } => Some(
                "wire `inputs.candidates` and `inputs.rollouts` to the candidates that were screened and to that screen"
                    .to_owned(),
            ),
            Self::SimilarToUnseen { .. } | Self::OfUnseen { .. } | Self::LearnedUnseen { .. } => Some(
                "give `shapes`, `transfer` and `train` the same `unseen_objects` and `unseen_fold`"
                    .to_owned(),
            ),
            Self::HandMismatch { .. } => {
                Some("set `hand` in `train` and `retarget` to the same URDF".to_owned())
            }
            Self::NoObject { .. } | Self::NoRests { .. } => {
                Some("make it again with `pipeline run FILE --fresh`".to_owned())
            }
            Self::Cgf(CgfError::Diverged { .. }) => {
                Some("lower `training.learning_rate`, e.g. to a third".to_owned())
            }
            Self::Cgf(CgfError::TooFewTrajectories { .. }) => {
                Some("train on more objects".to_owned())
            }
            Self::Cgf(CgfError::NotBuiltFor { feature }) => Some(format!(
                "set `device = \"cpu\"`, or build with `cargo build --release --features {feature}`"
            )),
            Self::Cgf(CgfError::UnknownLink { .. }) => {
                Some("give `training.tips` the names of the hand's fingertip links".to_owned())
            }
            Self::Cgf(CgfError::LargeShapes { .. }) => Some("URDFs are in meters".to_owned()),
            Self::Curve { .. }
            | Self::Motion { .. }
            | Self::Dof(_)
            | Self::UnknownTrajectory { .. }
            | Self::Cgf(_) => None,
        }
    }

    fn missing_input(&self) -> Option<&'static str> {
        matches!(
            self,
            Self::NoTrajectories { .. } | Self::Cgf(CgfError::TooFewTrajectories { .. })
        )
        .then_some("trajectories")
    }
}
