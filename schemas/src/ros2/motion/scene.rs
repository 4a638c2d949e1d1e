//! The scene of a recording: a robot and an object in motion.

use robot::{Link, RobotModel};
use spatial::{Object, Pose, Table};

use super::{OBJECT, OBJECT_COLOR, START_NS, TABLE, stamp_ns, transform_stamped};
use crate::ros2::{JointState, MarkerArray, Text, TfMessage, TransformStamped};

/// The static part of a scene; `Root` is the frame of the robot's root link: a hand's palm or an arm's
/// base.
#[derive(Debug, Clone, Copy)]
pub struct RecordingScene<'a, Root> {
    /// The robot's URDF.
    pub urdf: &'a str,
    /// The robot.
    pub robot: &'a RobotModel,
    /// Names of its movable joints.
    pub joints: &'a [String],
    /// Pose of each link at any joint positions; fixed links are taken from it.
    pub root_from_links: &'a [Pose<Root, Link>],
    /// Vertices of the object's mesh, object frame, in meters.
    pub vertices_m: &'a [[f64; 3]],
    /// Triangles of the object's mesh.
    pub triangles: &'a [[u32; 3]],
}

/// One moment of a motion.
#[derive(Debug, Clone, Copy)]
pub struct SceneStep<'a, Root> {
    /// Seconds since the motion's first step.
    pub time_s: f64,
    /// Pose of the robot's root link.
    pub table_from_root: Pose<Table, Root>,
    /// Pose of the object.
    pub table_from_object: Pose<Table, Object>,
    /// Pose of each of the robot's links.
    pub root_from_links: &'a [Pose<Root, Link>],
    /// Joint positions in radians, in the order of [`RecordingScene::joints`].
    pub q_rad: &'a [f64],
    /// Joint velocities in rad/s; empty if not known.
    pub q_velocity_rad_per_s: &'a [f64],
}

impl<Root> SceneStep<'_, Root> {
    /// Returns the step's stamp in nanoseconds.
    pub fn time_ns(&self) -> i64 {
        stamp_ns(self.time_s)
    }
}

impl<Root> RecordingScene<'_, Root> {
    /// Returns the robot's URDF, for [`super::ROBOT_DESCRIPTION`].
    pub fn description(&self) -> Text {
        super::robot_description(self.urdf)
    }

    /// Returns the fixed links' poses, for [`super::TF_STATIC`].
    pub fn fixed(&self) -> TfMessage {
        fixed_links(self.robot, self.root_from_links)
    }

    /// Returns the object's mesh, for [`super::MARKERS`].
    pub fn shapes(&self) -> MarkerArray {
        super::markers([super::mesh_marker(
            START_NS,
            OBJECT,
            self.vertices_m,
            self.triangles,
            OBJECT_COLOR,
        )])
    }

    /// Returns the joint positions, for [`super::JOINT_STATES`].
    pub fn state(&self, step: &SceneStep<'_, Root>) -> JointState {
        super::joint_state(
            step.time_ns(),
            self.joints,
            step.q_rad,
            step.q_velocity_rad_per_s,
        )
    }

    /// Returns the poses of the robot's links and of the object, for [`super::TF`].
    pub fn poses(&self, step: &SceneStep<'_, Root>) -> TfMessage {
        let time_ns = step.time_ns();
        let mut poses = moving_links(
            time_ns,
            self.robot,
            &step.table_from_root,
            step.root_from_links,
        );
        poses.transforms.push(transform_stamped(
            time_ns,
            TABLE,
            OBJECT,
            &step.table_from_object,
        ));
        poses
    }
}

/// Returns the poses of a robot's links that change, for [`super::TF`]: the root in the table's frame and
/// every moving link in its parent's.
pub fn moving_links<Root>(
    time_ns: i64,
    robot: &RobotModel,
    table_from_root: &Pose<Table, Root>,
    root_from_links: &[Pose<Root, Link>],
) -> TfMessage {
    let first = robot.links().iter().take(1);
    let first = first.map(|link| transform_stamped(time_ns, TABLE, &link.name, table_from_root));
    let moving = below_parents(time_ns, robot, root_from_links, |link| link.joint.is_some());
    TfMessage {
        transforms: first.chain(moving).collect(),
    }
}

/// Returns the poses of a robot's links that never change, for [`super::TF_STATIC`]: those fixed to
/// their parents.
pub fn fixed_links<Root>(robot: &RobotModel, root_from_links: &[Pose<Root, Link>]) -> TfMessage {
    let fixed = below_parents(START_NS, robot, root_from_links, |link| {
        link.joint.is_none()
    });
    TfMessage {
        transforms: fixed.collect(),
    }
}

fn below_parents<Root>(
    time_ns: i64,
    robot: &RobotModel,
    root_from_links: &[Pose<Root, Link>],
    is_wanted: impl Fn(&Link) -> bool,
) -> impl Iterator<Item = TransformStamped> {
    let links = robot.links().iter().zip(root_from_links);
    links
        .filter(move |(link, _)| is_wanted(link))
        .filter_map(move |(link, root_from_link)| {
            let parent = link.parent?;
            let parent_from_root = root_from_links.get(parent)?.inverse();
            Some(transform_stamped(
                time_ns,
                &robot.links().get(parent)?.name,
                &link.name,
                &(parent_from_root * *root_from_link),
            ))
        })
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;
    use spatial::Palm;

    use super::*;

    const FINGER: &str = r#"<robot name="hand">
        <link name="palm"/> <link name="finger"/> <link name="tip"/>
        <joint name="knuckle" type="continuous"><parent link="palm"/><child link="finger"/></joint>
        <joint name="end" type="fixed"><parent link="finger"/><child link="tip"/></joint>
    </robot>"#;

    #[test]
    fn every_link_hangs_below_its_parent_once() {
        let robot = RobotModel::from_urdf(FINGER).unwrap();
        let poses =
            [0.0, 0.1, 0.15].map(|z| Pose::<Palm, _>::new(Isometry3::translation(0.0, 0.0, z)));
        let table_from_palm = Pose::new(Isometry3::translation(0.0, 0.0, 0.5));
        let names = |tf: &TfMessage| -> Vec<(String, String, f64)> {
            tf.transforms
                .iter()
                .map(|t| {
                    let up = (t.transform.translation.z * 1e6).round() / 1e6;
                    (t.header.frame_id.clone(), t.child_frame_id.clone(), up)
                })
                .collect()
        };
        let row = |parent: &str, child: &str, up| (parent.to_owned(), child.to_owned(), up);
        assert_eq!(
            names(&moving_links(START_NS, &robot, &table_from_palm, &poses)),
            [row("table", "palm", 0.5), row("palm", "finger", 0.1)]
        );
        assert_eq!(
            names(&fixed_links(&robot, &poses)),
            [row("finger", "tip", 0.05)]
        );
    }
}
