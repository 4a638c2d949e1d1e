//! Trajectories as recordings for a viewer: the hand follows beside the object as it lay.

use std::{collections::BTreeMap, path::Path};

use dataflow::BoxedDiagnostic;
use geometry::TriMesh;
use lake::recording::Recording;
use robot::RobotModel;
use schemas::{
    Table,
    ros2::motion::{self, JOINT_TRAJECTORY, RecordingScene, START_NS, SceneStep, TrajectoryPoint},
    trajectories::Trajectory,
};

use crate::RetargetError;

/// Name of the recording in the artifact.
pub(crate) const FILE: &str = "trajectory.mcap";

/// Writes the recording of a trajectory into `folder`.
pub(crate) fn record(
    urdf: &str,
    model: &RobotModel,
    mesh: &TriMesh,
    trajectory: &Trajectory,
    folder: &Path,
) -> Result<(), BoxedDiagnostic> {
    let vertices_m: Vec<[f64; 3]> = mesh.vertices_m.iter().map(|&p| p.into()).collect();
    let scene = RecordingScene {
        urdf,
        joints: trajectory.motion.joints(),
        robot: model,
        root_from_links: &model.link_poses(|_| 0.0),
        vertices_m: &vertices_m,
        triangles: &mesh.triangles,
    };
    let about = [
        ("schema", Trajectory::VERSION),
        ("object", &trajectory.object),
        ("sequence", &trajectory.sequence),
    ]
    .map(|(key, value)| (key.to_owned(), value.to_owned()));
    let mut recording = Recording::create(&folder.join(FILE), &BTreeMap::from(about))?;
    recording.write_scene(&scene)?;
    let steps = trajectory.motion.steps();
    let positions = steps
        .iter()
        .map(|step| TrajectoryPoint::positions(step.time_s, &step.q_rad));
    recording.write_latched(
        JOINT_TRAJECTORY,
        START_NS,
        &motion::joint_trajectory(START_NS, trajectory.motion.joints(), positions),
    )?;
    let table_from_object = trajectory.rest.table_from_object();
    for step in steps {
        recording.write_step(
            &scene,
            &SceneStep {
                time_s: step.time_s,
                table_from_root: table_from_object * step.frame_from_palm,
                table_from_object,
                root_from_links: &model
                    .forward_kinematics(&step.q_rad)
                    .map_err(RetargetError::from)?,
                q_rad: &step.q_rad,
                q_velocity_rad_per_s: &step.rates.joints.velocity,
            },
        )?;
    }
    Ok(recording.finish()?)
}
