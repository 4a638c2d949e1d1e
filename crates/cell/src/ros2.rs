//! Publishes a cell's joints to ROS 2: `/joint_states` and `/joint_trajectory` under the keys and
//! types of `rmw_zenoh`, so that a ROS 2 machine on the same router needs no bridge.
//!
//! A topic's data is under `<domain>/<topic>/<type>/<type hash>`, CDR with an attachment of
//! sequence number, time and sender; liveliness tokens under `@ros2_lv` announce the topic
//! (`rmw_zenoh`, *Design*, sections "Topic Keyexpr" and "Graph Cache").

use std::sync::atomic::{AtomicU64, Ordering};

use motion::{JointTrack, PalmTrajectory};
use schemas::ros2::{
    Message,
    motion::{JOINT_STATES, JOINT_TRAJECTORY, TrajectoryPoint, joint_state, joint_trajectory},
};
use zenoh::{Session, Wait, liveliness::LivelinessToken, pubsub::Publisher};

use crate::{
    goal::{Goal, now},
    report::Sample,
};

/// Name of the node that owns the topics.
const NODE: &str = "robot_cell";
/// `QoS`: reliable, volatile, keep the last ten; the default of ROS 2.
const QOS: &str = "::,10:,:,:,,";
/// Bytes of a sender's GID.
const GID: usize = 16;

/// Publishes a cell's joints for ROS 2.
pub(crate) struct Mirror {
    states: Topic,
    trajectories: Topic,
    _node: LivelinessToken,
}

/// Returns a joint track as a ROS 2 message that starts at `time_ns` nanoseconds.
fn trajectory(time_ns: i64, track: &JointTrack) -> schemas::ros2::JointTrajectory {
    let points = track.points.iter().map(|point| TrajectoryPoint {
        time_s: point.time_s,
        q_rad: &point.q_rad,
        velocity_rad_per_s: &point.rates.velocity,
        acceleration_rad_per_s2: &point.rates.acceleration,
    });
    joint_trajectory(time_ns, &track.joints, points)
}

struct Topic {
    publisher: Publisher<'static>,
    sent_n: AtomicU64,
    gid: [u8; GID],
    _token: LivelinessToken,
}

impl Mirror {
    /// Announces the topics in a ROS 2 domain.
    pub(crate) fn new(session: &Session, domain: u32) -> Result<Self, zenoh::Error> {
        let zid = session.info().zid().wait();
        let node = format!("@ros2_lv/{domain}/{zid}/0/0/NN/%/%/{NODE}");
        Ok(Self {
            states: Topic::new::<schemas::ros2::JointState>(session, domain, 1, JOINT_STATES)?,
            trajectories: Topic::new::<schemas::ros2::JointTrajectory>(
                session,
                domain,
                2,
                JOINT_TRAJECTORY,
            )?,
            _node: session.liveliness().declare_token(node).wait()?,
        })
    }

    /// Publishes the joint states.
    pub(crate) fn show(&self, joints: &[String], sample: &Sample) {
        self.states
            .put(&joint_state(now_ns(), joints, &sample.q_rad, &[]));
    }

    /// Publishes the joint trajectories, one message per controller.
    pub(crate) fn announce(&self, goal: &Goal) {
        let time_ns = now_ns();
        if let PalmTrajectory::Arm(arm) = &goal.carrier {
            self.trajectories.put(&trajectory(time_ns, arm));
        }
        self.trajectories.put(&trajectory(time_ns, &goal.hand));
    }
}

impl Topic {
    fn new<M: Message>(
        session: &Session,
        domain: u32,
        entity: u32,
        name: &str,
    ) -> Result<Self, zenoh::Error> {
        let zid = session.info().zid().wait();
        let kind = dds_name(M::TYPE);
        let mangled = name.replace('/', "%");
        let token = format!(
            "@ros2_lv/{domain}/{zid}/0/{entity}/MP/%/%/{NODE}/{mangled}/{kind}/{}/{QOS}",
            M::HASH
        );
        let key = format!(
            "{domain}/{}/{kind}/{}",
            name.trim_start_matches('/'),
            M::HASH
        );
        let mut gid = [0; GID];
        blake3::Hasher::new()
            .update(token.as_bytes())
            .finalize_xof()
            .fill(&mut gid);
        Ok(Self {
            publisher: session.declare_publisher(key).wait()?,
            sent_n: AtomicU64::new(0),
            gid,
            _token: session.liveliness().declare_token(token).wait()?,
        })
    }

    /// Publishes a message; watchers may miss some.
    fn put<M: Message>(&self, message: &M) {
        let number = self.sent_n.fetch_add(1, Ordering::Relaxed) + 1;
        let mut attachment = number.to_le_bytes().to_vec();
        attachment.extend(now_ns().to_le_bytes());
        attachment.extend(u8::try_from(GID).map(u8::to_le_bytes).unwrap_or_default());
        attachment.extend(self.gid);
        let _sent = self
            .publisher
            .put(message.to_cdr())
            .attachment(attachment)
            .wait();
    }
}

/// Returns a type's name as DDS has it: `sensor_msgs::msg::dds_::JointState_`.
fn dds_name(name: &str) -> String {
    match name.rsplit_once('/') {
        Some((package, kind)) => format!("{}::dds_::{kind}_", package.replace('/', "::")),
        None => name.to_owned(),
    }
}

fn now_ns() -> i64 {
    let since_1970 = now().duration_since(std::time::UNIX_EPOCH);
    i64::try_from(since_1970.unwrap_or_default().as_nanos()).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests {
    use super::dds_name;

    #[test]
    fn types_are_named_as_rmw_zenoh_names_them() {
        assert_eq!(
            dds_name("sensor_msgs/msg/JointState"),
            "sensor_msgs::msg::dds_::JointState_"
        );
    }
}
