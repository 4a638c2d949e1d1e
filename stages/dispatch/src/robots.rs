//! The robot's descriptions: a hand, and the arm that carries it if there is one.

use std::path::Path;

use cell::robot_digest;
use dataflow::BoxedDiagnostic;
use planning::{ArmConfig, ArmSetup, Planner, PlannerConfig};
use robot::RobotModel;
use robot_meshes::LoadedRobot;
use spatial::{Base, Pose, Table};

use crate::{DispatchConfig, DispatchError};

/// A robot's models.
pub(crate) struct Robots {
    /// The hand alone; its root link is the palm.
    pub(crate) hand: RobotModel,
    /// The text of its URDF.
    pub(crate) hand_urdf: String,
    /// Arm and hand in one, if there is an arm.
    pub(crate) arm: Option<ArmRobot>,
}

/// An arm with the hand on it.
pub(crate) struct ArmRobot {
    pub(crate) model: RobotModel,
    pub(crate) urdf: String,
    pub(crate) table_from_base: Pose<Table, Base>,
}

impl Robots {
    /// Loads the hand and, if the options have an arm, the arm, whose URDF `arm` finds.
    pub(crate) fn load<'a>(
        config: &'a DispatchConfig,
        hand: &Path,
        arm: impl FnOnce(&'a ArmConfig) -> Result<&'a Path, BoxedDiagnostic>,
    ) -> Result<Self, BoxedDiagnostic> {
        let hand = robot_meshes::load(hand)?;
        let arm_robot = |options| {
            let LoadedRobot { urdf, model } = robot_meshes::load(arm(options)?)?;
            Ok::<_, BoxedDiagnostic>(ArmRobot {
                model,
                urdf,
                table_from_base: options.table_from_base().map_err(DispatchError::from)?,
            })
        };
        let arm = config.arm.as_ref().map(arm_robot).transpose()?;
        Ok(Self {
            hand: hand.model,
            hand_urdf: hand.urdf,
            arm,
        })
    }

    /// Returns the model of the whole robot: arm and hand, or the hand alone.
    pub(crate) fn whole(&self) -> &RobotModel {
        self.arm.as_ref().map_or(&self.hand, |arm| &arm.model)
    }

    /// Returns this robot's motion planner.
    pub(crate) fn planner<'a>(
        &'a self,
        config: &'a DispatchConfig,
    ) -> Result<Planner<'a>, DispatchError> {
        let arm = config.arm.as_ref().zip(self.arm.as_ref());
        Ok(Planner::new(&PlannerConfig {
            hand: &self.hand,
            arm: arm.map(|(config, arm)| ArmSetup {
                config,
                robot: &arm.model,
            }),
            protocol: &config.protocol,
            limits: &config.limits,
            rates: config.rates,
        })?)
    }

    /// Returns the URDF of [`Robots::whole`].
    pub(crate) fn urdf(&self) -> &str {
        self.arm
            .as_ref()
            .map_or(self.hand_urdf.as_str(), |arm| &arm.urdf)
    }

    /// Returns the digest that identifies the robot to the cell.
    pub(crate) fn digest(&self) -> String {
        robot_digest(self.urdf())
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use robot_meshes::LoadError;

    /// An arm of meshes keeps clear of things as one of primitives does, or is refused.
    #[test]
    fn an_arm_whose_meshes_are_not_there_is_refused() {
        const XARM: &str = include_str!("../../../data/robots/xarm6_allegro.urdf");
        let start = XARM.find("<collision>").unwrap();
        let shape = start + XARM[start..].find("<geometry>").unwrap() + "<geometry>".len();
        let end = shape + XARM[shape..].find("</geometry>").unwrap();
        let of_mesh = [
            &XARM[..shape],
            "<mesh filename=\"meshes/none.stl\"/>",
            &XARM[end..],
        ];
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("arm.urdf");
        fs::write(&path, of_mesh.concat()).unwrap();
        let refused = robot_meshes::load(&path).unwrap_err();
        assert!(matches!(refused, LoadError::Missing { .. }), "{refused}");
        assert!(
            refused.to_string().contains("`meshes/none.stl`"),
            "{refused}"
        );
    }
}
