//! One recording per motion executed: what was commanded and what was measured.

use std::{collections::BTreeMap, path::Path};

use cell::{Goal, JointTrack, PalmTrajectory, Report, Sample};
use dataflow::BoxedDiagnostic;
use lake::recording::Recording;
use robot::{JointOrder, WrongDof};
use schemas::{
    Table,
    executions::Executions,
    objects::Object,
    ros2::{
        JointTrajectory,
        motion::{
            self, ARM_TRAJECTORY, GRASP_POSE, JOINT_COMMANDS, JOINT_TRAJECTORY, OBJECT,
            RecordingScene, START_NS, SceneStep, TrajectoryPoint,
        },
    },
};
use spatial::{Base, Object as InObject, Palm, Pose};

use crate::{DispatchError, robots::Robots};

/// The robot and the object of a recording.
pub(crate) struct Setting<'a> {
    pub(crate) robots: &'a Robots,
    pub(crate) hand_path: &'a Path,
    pub(crate) object: &'a Object,
    /// The cell's name.
    pub(crate) cell: &'a str,
    /// Differences of the cell from the planning model.
    pub(crate) gap: &'a str,
    /// Pose of the palm at the grasp, in the object frame.
    pub(crate) object_from_grasp: &'a Pose<InObject, Palm>,
}

/// Writes `<candidate_id>.mcap` into `folder`; a motion without samples has no recording.
pub(crate) fn record(
    setting: &Setting<'_>,
    goal: &Goal,
    report: &Report,
    folder: &Path,
) -> Result<(), BoxedDiagnostic> {
    if report.samples.is_empty() {
        return Ok(());
    }
    let wrong = || DispatchError::Report {
        goal_id: report.goal_id.clone(),
        hand: setting.hand_path.to_owned(),
    };
    let robot = setting.robots.whole();
    let joints = robot.joint_names();
    let order = JointOrder::new(&report.joints, &joints).map_err(|_other| wrong())?;
    let in_order = |sample: &Sample| -> Result<Sample, WrongDof> {
        Ok(Sample {
            q_rad: order.apply(&sample.q_rad)?,
            q_command_rad: order.apply(&sample.q_command_rad)?,
            ..sample.clone()
        })
    };
    let samples = report.samples.iter().map(in_order);
    let samples: Vec<Sample> = samples
        .collect::<Result<_, _>>()
        .map_err(|_short| wrong())?;
    let link_poses = |q: &[f64]| robot.forward_kinematics(q).map_err(|_short| wrong());
    let first = samples.first().ok_or_else(wrong)?;
    let scene = RecordingScene {
        urdf: &robot::plain_urdf(setting.robots.urdf()),
        joints: &joints,
        robot,
        root_from_links: &link_poses(&first.q_rad)?,
        vertices_m: &setting.object.vertices_m,
        triangles: &setting.object.triangles,
    };
    let path = folder.join(format!("{}.mcap", goal.candidate_id));
    let mut recording = Recording::create(&path, &about(setting, goal, report))?;
    recording.write_scene(&scene)?;
    // Under the names on the wire: the cell's commands.
    recording.write_latched(JOINT_TRAJECTORY, START_NS, &trajectory(&goal.hand))?;
    if let PalmTrajectory::Arm(arm) = &goal.carrier {
        recording.write_latched(ARM_TRAJECTORY, START_NS, &trajectory(arm))?;
    }
    let grasp = motion::pose_stamped(START_NS, OBJECT, setting.object_from_grasp);
    recording.write_latched(GRASP_POSE, START_NS, &grasp)?;
    for sample in &samples {
        recording.write_step(
            &scene,
            &SceneStep {
                time_s: sample.time_s,
                // A hand without an arm is its own base.
                table_from_root: setting.robots.arm.as_ref().map_or_else(
                    || sample.table_from_palm.reinterpret::<_, Base>(),
                    |arm| arm.table_from_base,
                ),
                table_from_object: sample.table_from_object,
                root_from_links: &link_poses(&sample.q_rad)?,
                q_rad: &sample.q_rad,
                q_velocity_rad_per_s: &[],
            },
        )?;
        let time_ns = motion::stamp_ns(sample.time_s);
        let commanded = motion::joint_state(time_ns, &joints, &sample.q_command_rad, &[]);
        recording.write(JOINT_COMMANDS, time_ns, &commanded)?;
    }
    recording.finish()?;
    Ok(())
}

/// Returns a controller's commands.
fn trajectory(track: &JointTrack) -> JointTrajectory {
    let points = track.points.iter().map(|point| TrajectoryPoint {
        time_s: point.time_s,
        q_rad: &point.q_rad,
        velocity_rad_per_s: &point.rates.velocity,
        acceleration_rad_per_s2: &point.rates.acceleration,
    });
    motion::joint_trajectory(START_NS, &track.joints, points)
}

fn about(setting: &Setting<'_>, goal: &Goal, report: &Report) -> BTreeMap<String, String> {
    [
        ("schema", Executions::VERSION),
        ("object", &goal.object),
        ("candidate_id", &goal.candidate_id),
        ("goal_id", &report.goal_id),
        ("cell", setting.cell),
        ("gap", setting.gap),
        ("outcome", report.outcome.as_str()),
        ("message", &report.message),
    ]
    .map(|(key, value)| (key.to_owned(), value.to_owned()))
    .into()
}
