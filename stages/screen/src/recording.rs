//! Rollouts as recordings for a viewer.

use std::{collections::BTreeMap, path::Path};

use dataflow::BoxedDiagnostic;
use lake::recording::Recording;
use robot::RobotModel;
use schemas::{
    Table,
    objects::Object,
    rollouts::{Rollout as Row, Rollouts},
    ros2::motion::{
        self, CONTACT_FORCES, CONTACTS, ContactForce, JOINT_TRAJECTORY, RecordingScene, START_NS,
        SceneStep, TrajectoryPoint,
    },
};
use simulation::{Rollout, Trace};
use spatial::Palm;

use crate::ScreenError;

/// Constants of all recordings of an object.
pub(crate) struct RecordingContext<'a> {
    /// The hand's URDF.
    pub(crate) urdf: &'a str,
    /// The hand.
    pub(crate) model: &'a RobotModel,
    /// The object.
    pub(crate) object: &'a Object,
}

/// Writes `<candidate_id>.mcap` into `folder`, with the reason of its `row`; a rollout without a trace has
/// no recording.
pub(crate) fn record(
    context: &RecordingContext<'_>,
    row: &Row,
    rollout: &Rollout,
    folder: &Path,
) -> Result<(), BoxedDiagnostic> {
    let Some(Trace { steps }) = &rollout.trace else {
        return Ok(());
    };
    let joints = context.model.joint_names();
    let scene = RecordingScene {
        urdf: context.urdf,
        joints: &joints,
        robot: context.model,
        root_from_links: &context.model.link_poses::<Palm>(|_| 0.0),
        vertices_m: &context.object.vertices_m,
        triangles: &context.object.triangles,
    };
    let about = [
        ("schema", Rollouts::VERSION),
        ("object", &context.object.name),
        ("candidate_id", &row.candidate_id),
        ("reason", row.verdict.as_str()),
    ]
    .map(|(key, value)| (key.to_owned(), value.to_owned()));
    let path = folder.join(format!("{}.mcap", row.candidate_id));
    let mut recording = Recording::create(&path, &BTreeMap::from(about))?;
    recording.write_scene(&scene)?;
    let commands = steps
        .iter()
        .map(|step| TrajectoryPoint::positions(step.time_s, &step.q_command));
    recording.write_latched(
        JOINT_TRAJECTORY,
        START_NS,
        &motion::joint_trajectory(START_NS, &joints, commands),
    )?;
    let links: Vec<String> = context
        .model
        .links()
        .iter()
        .map(|link| link.name.clone())
        .collect();
    for step in steps {
        let moment = SceneStep {
            time_s: step.time_s,
            table_from_root: step.table_from_palm.reinterpret(),
            table_from_object: step.table_from_object,
            root_from_links: &context
                .model
                .forward_kinematics(&step.q)
                .map_err(ScreenError::from)?,
            q_rad: &step.q,
            q_velocity_rad_per_s: &[],
        };
        recording.write_step(&scene, &moment)?;
        let contacts = step.contacts.iter().filter_map(|contact| {
            Some(ContactForce {
                link: links.get(contact.link)?,
                point_in_table_m: contact.point_in_table_m,
                force_in_table_n: contact.force_in_table_n,
            })
        });
        let contacts: Vec<ContactForce<'_>> = contacts.collect();
        let time_ns = moment.time_ns();
        recording.write(
            CONTACTS,
            time_ns,
            &motion::contact_markers(time_ns, &contacts),
        )?;
        let forces = motion::contact_forces(time_ns, &links, &contacts);
        recording.write(CONTACT_FORCES, time_ns, &forces)?;
    }
    Ok(recording.finish()?)
}
