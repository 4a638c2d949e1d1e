//! A robot from its URDF and the meshes that the URDF names.

use std::{fs, path::Path};

use robot::RobotModel;

use crate::{LoadError, with_mesh_shapes};

/// A robot as its files describe it.
#[derive(Debug, Clone)]
pub struct LoadedRobot {
    /// The text of its URDF.
    pub urdf: String,
    /// Its joints, links and shapes, those of meshes among them.
    pub model: RobotModel,
}

/// Loads a robot with the shapes of its meshes.
///
/// # Errors
///
/// Fails if the URDF cannot be read or used, or a mesh that the robot collides with.
pub fn load(urdf: &Path) -> Result<LoadedRobot, LoadError> {
    let (text, model) = without_meshes(urdf)?;
    let model = with_mesh_shapes(model, urdf)?;
    Ok(LoadedRobot { urdf: text, model })
}

/// Reads a URDF: its text and the robot, links of meshes without a shape.
pub(crate) fn without_meshes(urdf: &Path) -> Result<(String, RobotModel), LoadError> {
    let bytes = fs::read(urdf).map_err(|source| LoadError::ReadUrdf {
        path: urdf.to_owned(),
        source,
    })?;
    let model = RobotModel::from_urdf_bytes(&bytes).map_err(|source| LoadError::Urdf {
        path: urdf.to_owned(),
        source: Box::new(source),
    })?;
    Ok((String::from_utf8_lossy(&bytes).into_owned(), model))
}
