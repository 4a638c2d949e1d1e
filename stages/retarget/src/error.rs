//! Why demonstrations could not be retargeted.

use std::path::PathBuf;

use dataflow::Diagnostic;
use hand_files::HandFileError;
use posture::PostureError;
use retargeting::RetargetingError;
use robot::WrongDof;
use robot_meshes::LoadError;

/// Why demonstrations could not be retargeted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RetargetError {
    /// The hand table cannot be read or used.
    #[error(transparent)]
    HandTable(#[from] HandFileError),
    /// The hand's URDF cannot be used, or lacks a link that its table names.
    #[error("cannot use the hand's URDF `{}`", path.display())]
    Hand {
        /// The file.
        path: PathBuf,
        /// The problem.
        source: PostureError,
    },
    /// A trajectory has another number of joints than the hand.
    #[error("a trajectory cannot be recorded")]
    Dof(#[from] WrongDof),
    /// The robot cannot be loaded.
    #[error(transparent)]
    LoadRobot(#[from] LoadError),
    /// The hand and the options do not fit together.
    #[error(transparent)]
    Retargeting(#[from] RetargetingError),
    /// The hand's file cannot be used with this hand.
    #[error("cannot use the hand's file `{}`", path.display())]
    InHandTable {
        /// The file.
        path: PathBuf,
        /// The problem.
        source: Box<Self>,
    },
    /// The configuration file of dex-retargeting cannot be read.
    #[error("cannot read the configuration `{}`", path.display())]
    ReadConfiguration {
        /// The file.
        path: PathBuf,
        /// The problem.
        source: std::io::Error,
    },
    /// The file is no configuration of dex-retargeting.
    #[error("cannot use the configuration `{}`", path.display())]
    Configuration {
        /// The file.
        path: PathBuf,
        /// The problem.
        source: dex_retargeting::ConfigError,
    },
    /// The configuration does not fit the hand.
    #[error("cannot use the configuration `{}` on this hand", path.display())]
    ConfiguredHand {
        /// The file.
        path: PathBuf,
        /// The problem.
        source: Box<dex_retargeting::ProblemError>,
    },
    /// The configuration's joints are not the hand's.
    #[error("`ignore_mimic_joint` of `{}` makes joints that the hand does not have", path.display())]
    OtherJoints {
        /// The file.
        path: PathBuf,
    },
    /// There is no object at all.
    #[error("there are no objects, so that no demonstration has one")]
    NoObjects,
}

impl Diagnostic for RetargetError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::HandTable(err) => err.hint(),
            Self::InHandTable { source, .. } => source.hint(),
            Self::Hand { source, .. } => source.hint().or_else(|| {
                Some("the Allegro hand's URDF is `data/robots/allegro_right.urdf`".to_owned())
            }),
            Self::LoadRobot(err) => err.hint(),
            Self::Retargeting(err) => err.hint(),
            Self::ReadConfiguration { .. } => {
                Some("`dex_retargeting` is the path of a YAML file of dex-retargeting".to_owned())
            }
            Self::Configuration { source, .. } => source.hint(),
            Self::ConfiguredHand { source, .. } => source.hint(),
            Self::OtherJoints { .. } => {
                Some("remove the key, or the `<mimic>` elements of the hand's URDF".to_owned())
            }
            Self::NoObjects | Self::Dof(_) => None,
        }
    }

    fn missing_input(&self) -> Option<&'static str> {
        // Objects are those of demonstrations: where there are none, these say why.
        matches!(self, Self::NoObjects).then_some("demonstrations")
    }
}
