//! Topics of ROS 2 under the keys and types of `rmw_zenoh`, so that a ROS 2 machine on the same
//! router needs no bridge, and a cell no ROS 2.
//!
//! A topic's data is under `<domain>/<topic>/<type>/<type hash>`, CDR with an attachment of
//! sequence number, time and sender; liveliness tokens under `@ros2_lv` announce the topic
//! (`rmw_zenoh`, *Design*, sections "Topic Keyexpr" and "Graph Cache").

use std::{
    marker::PhantomData,
    sync::atomic::{AtomicU32, AtomicU64, Ordering},
    time::Duration,
};

use motion::{JointTrack, PalmTrajectory};
use schemas::ros2::{
    CdrError, Message,
    motion::{JOINT_STATES, JOINT_TRAJECTORY, TrajectoryPoint, joint_state, joint_trajectory},
};
use zenoh::{
    Session, Wait,
    liveliness::LivelinessToken,
    pubsub::{Publisher, Subscriber},
    qos::{CongestionControl, Priority},
};

use crate::{CellError, Goal, message::now, report::Sample, session};

/// `QoS`: reliable, volatile, keep the last ten; the default of ROS 2.
const QOS: &str = "::,10:,:,:,,";
/// Bytes of a sender's GID.
const GID: usize = 16;

/// A node of ROS 2: it owns topics.
pub struct Ros2Node {
    session: Session,
    domain: u32,
    name: String,
    entities_n: AtomicU32,
    _token: LivelinessToken,
}

/// A topic that a node publishes.
pub struct Ros2Publisher<M> {
    publisher: Publisher<'static>,
    sent_n: AtomicU64,
    gid: [u8; GID],
    _token: LivelinessToken,
    message: PhantomData<fn(M)>,
}

/// A topic that a node listens to, until it is dropped.
pub struct Ros2Subscriber {
    _subscriber: Subscriber<()>,
    _token: LivelinessToken,
}

/// Priority of a topic's messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Urgency {
    /// Data for watchers.
    Data,
    /// Commands to a controller: ahead of everything else, and sent at once.
    Command,
}

impl Ros2Node {
    /// Connects a node to the router of a ROS 2 machine, e.g. `tcp/127.0.0.1:7447`.
    ///
    /// # Errors
    ///
    /// Fails if no router answers within `timeout`.
    pub fn connect(
        router: &str,
        (domain, name): (u32, &str),
        timeout: Duration,
    ) -> Result<Self, CellError> {
        let session = session::connect(router, None, timeout);
        Self::new(&session.map_err(CellError::of_a_router)?, domain, name)
    }

    /// Announces a node of the session.
    pub(crate) fn new(session: &Session, domain: u32, name: &str) -> Result<Self, CellError> {
        let zid = session.info().zid().wait();
        let token = format!("@ros2_lv/{domain}/{zid}/0/0/NN/%/%/{name}");
        let token = session.liveliness().declare_token(token).wait();
        Ok(Self {
            session: session.clone(),
            domain,
            name: name.to_owned(),
            entities_n: AtomicU32::new(0),
            _token: token.map_err(failed)?,
        })
    }

    /// Announces a topic, e.g. `/joint_states`, that the node publishes.
    ///
    /// # Errors
    ///
    /// Fails if the topic's name cannot be part of a key.
    pub fn publish<M: Message>(
        &self,
        topic: &str,
        urgency: Urgency,
    ) -> Result<Ros2Publisher<M>, CellError> {
        let (token, text) = self.announce::<M>("MP", topic)?;
        let mut gid = [0; GID];
        blake3::Hasher::new()
            .update(text.as_bytes())
            .finalize_xof()
            .fill(&mut gid);
        let is_command = urgency == Urgency::Command;
        let publisher = self
            .session
            .declare_publisher(self.key::<M>(topic, M::HASH))
            .congestion_control(CongestionControl::Drop)
            .priority(match urgency {
                Urgency::Data => Priority::DEFAULT,
                Urgency::Command => Priority::RealTime,
            })
            .express(is_command);
        Ok(Ros2Publisher {
            publisher: publisher.wait().map_err(failed)?,
            sent_n: AtomicU64::new(0),
            gid,
            _token: token,
            message: PhantomData,
        })
    }

    /// Calls `heard` with each message of a topic, whatever the hash of its type: with the message,
    /// or the reason why it cannot be read.
    ///
    /// # Errors
    ///
    /// Fails if the topic's name cannot be part of a key.
    pub fn subscribe<M: Message>(
        &self,
        topic: &str,
        heard: impl Fn(Result<M, CdrError>) + Send + Sync + 'static,
    ) -> Result<Ros2Subscriber, CellError> {
        let (token, _) = self.announce::<M>("MS", topic)?;
        let subscriber = self
            .session
            .declare_subscriber(self.key::<M>(topic, "*"))
            .callback(move |sample| heard(M::from_cdr(&sample.payload().to_bytes())));
        Ok(Ros2Subscriber {
            _subscriber: subscriber.wait().map_err(failed)?,
            _token: token,
        })
    }

    fn key<M: Message>(&self, topic: &str, hash: &str) -> String {
        let topic = topic.trim_start_matches('/');
        format!("{}/{topic}/{}/{hash}", self.domain, dds_name(M::TYPE))
    }

    /// Declares the token of a publisher (`MP`) or a subscription (`MS`); returns it with its text.
    fn announce<M: Message>(
        &self,
        kind: &str,
        topic: &str,
    ) -> Result<(LivelinessToken, String), CellError> {
        let zid = self.session.info().zid().wait();
        let entity = self.entities_n.fetch_add(1, Ordering::Relaxed) + 1;
        let text = format!(
            "@ros2_lv/{}/{zid}/0/{entity}/{kind}/%/%/{}/{}/{}/{}/{QOS}",
            self.domain,
            self.name,
            topic.replace('/', "%"),
            dds_name(M::TYPE),
            M::HASH
        );
        let token = self.session.liveliness().declare_token(&text).wait();
        Ok((token.map_err(failed)?, text))
    }
}

impl<M: Message> Ros2Publisher<M> {
    /// Publishes a message; subscribers may miss some.
    pub fn put(&self, message: &M) {
        let number = self.sent_n.fetch_add(1, Ordering::Relaxed) + 1;
        let mut attachment = number.to_le_bytes().to_vec();
        attachment.extend(ros2_now_ns().to_le_bytes());
        attachment.extend(u8::try_from(GID).map(u8::to_le_bytes).unwrap_or_default());
        attachment.extend(self.gid);
        let _sent = self
            .publisher
            .put(message.to_cdr())
            .attachment(attachment)
            .wait();
    }

    /// Returns whether anyone subscribes to the topic with this type and its hash.
    pub fn has_subscriber(&self) -> bool {
        let status = self.publisher.matching_status().wait();
        status.is_ok_and(|status| status.matching())
    }
}

/// Publishes a cell's joints for ROS 2.
pub(crate) struct Mirror {
    states: Ros2Publisher<schemas::ros2::JointState>,
    trajectories: Ros2Publisher<schemas::ros2::JointTrajectory>,
    _node: Ros2Node,
}

impl Mirror {
    /// Announces the topics in a ROS 2 domain.
    pub(crate) fn new(session: &Session, domain: u32) -> Result<Self, CellError> {
        let node = Ros2Node::new(session, domain, "robot_cell")?;
        Ok(Self {
            states: node.publish(JOINT_STATES, Urgency::Data)?,
            trajectories: node.publish(JOINT_TRAJECTORY, Urgency::Data)?,
            _node: node,
        })
    }

    /// Publishes the joint states.
    pub(crate) fn show(&self, joints: &[String], sample: &Sample) {
        self.states
            .put(&joint_state(ros2_now_ns(), joints, &sample.q_rad, &[]));
    }

    /// Publishes the joint trajectories, one message per controller.
    pub(crate) fn announce(&self, goal: &Goal) {
        let time_ns = ros2_now_ns();
        if let PalmTrajectory::Arm(arm) = &goal.carrier {
            self.trajectories.put(&trajectory(time_ns, arm));
        }
        self.trajectories.put(&trajectory(time_ns, &goal.hand));
    }
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

fn failed(source: zenoh::Error) -> CellError {
    CellError::Zenoh {
        action: "open a topic of ROS 2",
        source: source.into(),
    }
}

/// Returns a type's name as DDS has it: `sensor_msgs::msg::dds_::JointState_`.
fn dds_name(name: &str) -> String {
    match name.rsplit_once('/') {
        Some((package, kind)) => format!("{}::dds_::{kind}_", package.replace('/', "::")),
        None => name.to_owned(),
    }
}

/// Returns the time of this machine's clock as a stamp of ROS 2, in nanoseconds since 1970.
pub fn ros2_now_ns() -> i64 {
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
