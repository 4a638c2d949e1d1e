//! Why a report on a training could not be made.

use cgf::CgfError;
use dataflow::Advise;
use lake::LakeError;
use robot::WrongDof;
use stage_train::TrainError;

/// Why a report on a training could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrainReportError {
    /// What the stage reads too cannot be used.
    #[error(transparent)]
    Train(Box<TrainError>),
    /// The hand has another number of joints than a motion.
    #[error(transparent)]
    Dof(#[from] WrongDof),
    /// The checkpoint does not know a trajectory.
    #[error("the checkpoint was not trained with trajectory `{sequence}` in view")]
    UnknownTrajectory {
        /// The trajectory's sequence.
        sequence: String,
    },
}

impl From<TrainError> for TrainReportError {
    fn from(err: TrainError) -> Self {
        Self::Train(Box::new(err))
    }
}

impl From<CgfError> for TrainReportError {
    fn from(err: CgfError) -> Self {
        TrainError::from(err).into()
    }
}

impl From<LakeError> for TrainReportError {
    fn from(err: LakeError) -> Self {
        TrainError::from(err).into()
    }
}

impl Advise for TrainReportError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::Train(err) => err.hint(),
            Self::Dof(_) | Self::UnknownTrajectory { .. } => None,
        }
    }

    fn lacks(&self) -> Option<&'static str> {
        match self {
            Self::Train(err) => err.lacks(),
            Self::Dof(_) | Self::UnknownTrajectory { .. } => None,
        }
    }
}
