//! Settled scenes of one hand and one object, by how the object lies.

use robot::RobotModel;
use simulation::{ObjectShape, SceneConfig, SettledScene, SimulationError};
use spatial::{Object, Pose, RestingPose, Table};

/// One settled scene per resting pose.
pub struct Scenes(Vec<(Pose<Table, Object>, SettledScene)>);

impl Scenes {
    /// Builds the scenes of an object's poses on its table, one for equal poses.
    ///
    /// # Errors
    ///
    /// Fails if the hand or the object cannot be simulated, or the object does not settle.
    pub fn new(
        config: &SceneConfig,
        hand: &RobotModel,
        shape: &ObjectShape,
        poses: impl IntoIterator<Item = Pose<Table, Object>>,
    ) -> Result<Self, SimulationError> {
        let mut scenes: Vec<(Pose<Table, Object>, SettledScene)> = Vec::new();
        for pose in poses {
            if scenes.iter().all(|(known, _)| *known != pose) {
                let scene = SettledScene::new(config, hand, shape, &RestingPose::of(&pose))?;
                scenes.push((pose, scene));
            }
        }
        Ok(Self(scenes))
    }

    /// Returns the scene of one of the poses.
    ///
    /// # Errors
    ///
    /// Fails if the pose is none of them.
    pub fn at(&self, pose: &Pose<Table, Object>) -> Result<&SettledScene, SimulationError> {
        let found = self.0.iter().find(|(known, _)| known == pose);
        let (_, scene) = found.ok_or(SimulationError::Unsettled)?;
        Ok(scene)
    }
}
