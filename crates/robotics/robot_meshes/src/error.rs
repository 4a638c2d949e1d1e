//! Errors of loading a robot.

use std::{io, path::PathBuf};

use dataflow::Diagnostic;
use geometry::GeometryError;
use robot::RobotError;

use crate::place;

/// Reason why a robot cannot be loaded from its URDF and meshes.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LoadError {
    /// The URDF that names the meshes cannot be read.
    #[error("cannot read the URDF `{}`", path.display())]
    ReadUrdf {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// The URDF that names the meshes cannot be used.
    #[error("cannot use the URDF `{}`", path.display())]
    Urdf {
        /// The file.
        path: PathBuf,
        /// The problem with it.
        source: Box<RobotError>,
    },
    /// There is no such file.
    #[error("link `{link}` of `{}` collides with the mesh `{file}`, which is not there", urdf.display())]
    Missing {
        /// The link.
        link: String,
        /// The mesh as the URDF names it.
        file: String,
        /// The URDF.
        urdf: PathBuf,
    },
    /// The file is of a kind that is not read.
    #[error("link `{link}` collides with the mesh `{}`, which is neither STL nor OBJ nor PLY", path.display())]
    Kind {
        /// The link.
        link: String,
        /// The file.
        path: PathBuf,
    },
    /// The file cannot be read.
    #[error("cannot read the mesh `{}` of link `{link}`", path.display())]
    Read {
        /// The link.
        link: String,
        /// The file.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// The file is not a mesh with a volume.
    #[error("cannot use the mesh `{}` of link `{link}`", path.display())]
    Mesh {
        /// The link.
        link: String,
        /// The file.
        path: PathBuf,
        /// The problem with it.
        source: GeometryError,
    },
}

impl Diagnostic for LoadError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::ReadUrdf { path, .. } => Some(format!(
                "name the URDF of a robot; {}",
                dataflow::missing(path)
            )),
            Self::Read { .. } => None,
            Self::Urdf { source, .. } => source.hint(),
            Self::Missing { file, .. } => Some(place::advice(file).unwrap_or_else(|| {
                "put it where the URDF says, relative to it or to a folder above it that has the \
                 package's name, or give its link `<collision>` shapes that are not meshes"
                    .to_owned()
            })),
            Self::Kind { path, .. } => {
                let stl = path.with_extension("stl");
                Some(format!(
                    "convert it and name the new file in the URDF, e.g. `assimp export {} {}`",
                    path.display(),
                    stl.display()
                ))
            }
            Self::Mesh { source, .. } => source.hint(),
        }
    }
}
