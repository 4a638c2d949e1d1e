//! The two controllers: slices of a path become their `JointTrajectory` messages.

use cell::{CellError, CellRobot, JointPoint, Ros2Node, Ros2Publisher, Urgency};
use robot::Joint;
use schemas::ros2::{
    JointTrajectory,
    motion::{TrajectoryPoint, joint_trajectory},
};

use crate::{
    config::{Config, Controller},
    path::Slice,
};

/// The controllers of arm and hand.
pub(crate) struct Controllers {
    parts: [Part; 2],
}

struct Part {
    /// Its topic.
    topic: String,
    publisher: Ros2Publisher<JointTrajectory>,
    /// The URDF's names of its joints, and its own.
    joints: Vec<(String, String)>,
}

impl Controllers {
    /// Announces the topics on which the controllers listen.
    pub(crate) fn new(
        node: &Ros2Node,
        config: &Config,
        robot: &CellRobot,
    ) -> Result<Self, CellError> {
        let part = |controller: &Controller, joints: &[Joint]| {
            let topic = format!("{}/joint_trajectory", controller.node);
            let names = joints.iter().map(|joint| {
                let theirs = controller.name_of(&joint.name);
                (joint.name.clone(), theirs.to_owned())
            });
            Ok::<_, CellError>(Part {
                publisher: node.publish(&topic, Urgency::Command)?,
                topic,
                joints: names.collect(),
            })
        };
        Ok(Self {
            parts: [
                part(&config.arm, robot.arm_joints())?,
                part(&config.hand, robot.hand_joints())?,
            ],
        })
    }

    /// Checks that a controller listens on each topic.
    ///
    /// # Errors
    ///
    /// Fails with the topic on which none does.
    pub(crate) fn check(&self) -> Result<(), String> {
        let silent = self
            .parts
            .iter()
            .find(|part| !part.publisher.has_subscriber());
        silent.map_or(Ok(()), |part| {
            Err(format!(
                "nothing listens on `{}` with the type of ROS 2 Jazzy: is the controller active?",
                part.topic
            ))
        })
    }

    /// Sends a slice, its times counted from `origin_ns`; `joints` are the names in its points.
    pub(crate) fn send(&self, slice: &Slice, origin_ns: i64, joints: [&[String]; 2]) {
        let begin_ns = origin_ns + nanoseconds(slice.begin_s);
        for ((part, points), names) in self.parts.iter().zip(&slice.points).zip(joints) {
            let theirs: Vec<String> = names.iter().map(|name| part.name_of(name)).collect();
            let points = points.iter().map(of_point);
            let message = joint_trajectory(begin_ns, &theirs, points);
            part.publisher.put(&message);
        }
    }
}

impl Part {
    fn name_of(&self, joint: &str) -> String {
        let found = self.joints.iter().find(|(ours, _)| ours == joint);
        found.map_or_else(|| joint.to_owned(), |(_, theirs)| theirs.clone())
    }
}

fn of_point(point: &JointPoint) -> TrajectoryPoint<'_> {
    TrajectoryPoint {
        time_s: point.time_s,
        q_rad: &point.q_rad,
        velocity_rad_per_s: &point.rates.velocity,
        acceleration_rad_per_s2: &point.rates.acceleration,
    }
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "a motion lasts minutes, which are few nanoseconds"
)]
fn nanoseconds(time_s: f64) -> i64 {
    (time_s * 1e9).round() as i64
}
