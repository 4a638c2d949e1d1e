//! Measurements of the machine: its joints, and the object.

use std::{
    collections::{BTreeMap, VecDeque},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

use cell::{CellError, CellRobot, Ros2Node, Ros2Subscriber, ros2_now_ns};
use schemas::ros2::{JointState, PoseStamped};
use spatial::{Object, Pose, Table};

use crate::config::Config;

/// Time for which readings are kept, in nanoseconds.
const KEPT_NS: i64 = 250_000_000;
/// A joint stands still if it stayed within this range, in radians, for this time, in nanoseconds,
/// of which there are so many readings.
const STILL_RAD: f64 = 0.004;
const STILL_NS: i64 = 60_000_000;
const STILL_READINGS: usize = 3;
/// Largest difference between the clocks of the ROS 2 machine and the cell, in nanoseconds.
const CLOCKS_NS: i64 = 50_000_000;

/// The measurements of a machine, and the subscriptions that bring them.
pub(crate) struct Measurements {
    joints: Arc<Mutex<Vec<JointReadings>>>,
    object: Arc<Mutex<Option<Seen>>>,
    _subscribers: Vec<Ros2Subscriber>,
}

/// Arrival time of the object's measurement, and its pose.
type Seen = (Instant, Pose<Table, Object>);

/// Received readings of a joint.
struct JointReadings {
    /// Its name in the URDF.
    name: String,
    /// Stamps of the ROS 2 machine, in nanoseconds, and positions, the newest last.
    readings: VecDeque<(i64, f64)>,
    /// Arrival time of the newest.
    heard: Option<Instant>,
    /// Least delay between the stamp and the arrival of a kept reading, in nanoseconds.
    least_lag_ns: i64,
}

impl Measurements {
    /// Listens to the joints of a robot and to the object.
    pub(crate) fn new(
        node: &Ros2Node,
        config: &Config,
        robot: &CellRobot,
    ) -> Result<Self, CellError> {
        let names = robot.joint_names();
        let joints = names.iter().map(|name| JointReadings {
            name: name.clone(),
            readings: VecDeque::new(),
            heard: None,
            least_lag_ns: 0,
        });
        let joints = Arc::new(Mutex::new(joints.collect::<Vec<_>>()));
        let object = Arc::new(Mutex::new(None));
        let mut subscribers = Vec::new();
        for (controller, own) in [
            (&config.arm, robot.arm_joints()),
            (&config.hand, robot.hand_joints()),
        ] {
            let places = own.iter().filter_map(|joint| {
                let place = names.iter().position(|name| *name == joint.name)?;
                Some((controller.name_of(&joint.name).to_owned(), place))
            });
            let places: BTreeMap<String, usize> = places.collect();
            let joints = Arc::clone(&joints);
            let heard = move |state: Result<JointState, _>| {
                // Unreadable messages are ignored: the joints grow stale.
                if let Ok(state) = state {
                    read(&mut lock(&joints), &places, &state);
                }
            };
            subscribers.push(node.subscribe(&controller.joint_states, heard)?);
        }
        if let Some(topic) = &config.object {
            let (object, frame) = (Arc::clone(&object), topic.frame.clone());
            let heard = move |pose: Result<PoseStamped, _>| {
                let there = pose.ok().filter(|pose| pose.header.frame_id == frame);
                if let Some(there) = there.and_then(|pose| pose_of(&pose)) {
                    *lock(&object) = Some((Instant::now(), there));
                }
            };
            subscribers.push(node.subscribe(&topic.pose, heard)?);
        }
        Ok(Self {
            joints,
            object,
            _subscribers: subscribers,
        })
    }

    /// Returns the latest positions, in the robot's order; `None` before all joints were heard.
    pub(crate) fn positions(&self) -> Option<Vec<f64>> {
        let joints = lock(&self.joints);
        joints.iter().map(JointReadings::latest).collect()
    }

    /// Checks that every joint was heard a moment ago.
    ///
    /// # Errors
    ///
    /// Fails with the joint that was not.
    pub(crate) fn check_fresh(&self, max_age_s: f64) -> Result<(), String> {
        for joint in lock(&self.joints).iter() {
            let Some(heard) = joint.heard else {
                return Err(format!("no state of joint `{}` was heard", joint.name));
            };
            let age_s = heard.elapsed().as_secs_f64();
            if age_s > max_age_s {
                let name = &joint.name;
                return Err(format!(
                    "the last state of joint `{name}` is {age_s:.2} s old"
                ));
            }
        }
        Ok(())
    }

    /// Checks that the stamps are by this machine's clock: slices are stamped by it.
    ///
    /// # Errors
    ///
    /// Fails with the joint whose stamps are not.
    pub(crate) fn check_clock(&self) -> Result<(), String> {
        for joint in lock(&self.joints).iter() {
            if joint.least_lag_ns.abs() > CLOCKS_NS {
                return Err(format!(
                    "the stamps of joint `{}` are {:.3} s behind this machine's clock: set both clocks by one \
                     server, and `use_sim_time` to false",
                    joint.name,
                    Duration::from_nanos(joint.least_lag_ns.unsigned_abs()).as_secs_f64()
                        * joint.least_lag_ns.signum() as f64
                ));
            }
        }
        Ok(())
    }

    /// Checks that nothing moves.
    ///
    /// # Errors
    ///
    /// Fails with the joint that moves, or was not heard often enough.
    pub(crate) fn check_still(&self, max_age_s: f64) -> Result<(), String> {
        self.check_fresh(max_age_s)?;
        for joint in lock(&self.joints).iter() {
            let Some(range) = joint.range_rad() else {
                return Err(format!("joint `{}` is heard too seldom", joint.name));
            };
            if range > STILL_RAD {
                return Err(format!("joint `{}` moves", joint.name));
            }
        }
        Ok(())
    }

    /// Returns the object's latest pose, and its age in seconds.
    pub(crate) fn object(&self) -> Option<(f64, Pose<Table, Object>)> {
        lock(&self.object).map(|(heard, pose)| (heard.elapsed().as_secs_f64(), pose))
    }
}

impl JointReadings {
    fn latest(&self) -> Option<f64> {
        self.readings.back().map(|(_, q)| *q)
    }

    /// Returns the range of the joint's recent readings, in radians; `None` if there are too few.
    fn range_rad(&self) -> Option<f64> {
        let (newest_ns, _) = *self.readings.back()?;
        let (oldest_ns, _) = *self.readings.front()?;
        let recent = self.readings.iter().rev();
        let recent = recent.take_while(|(stamp_ns, _)| newest_ns - stamp_ns <= STILL_NS);
        let (mut n, mut low, mut high) = (0, f64::INFINITY, f64::NEG_INFINITY);
        for (_, q) in recent {
            (n, low, high) = (n + 1, low.min(*q), high.max(*q));
        }
        let long_enough = newest_ns - oldest_ns >= STILL_NS && n >= STILL_READINGS;
        long_enough.then_some(high - low)
    }
}

/// Takes the joints of a message; `places` has their names there.
fn read(joints: &mut [JointReadings], places: &BTreeMap<String, usize>, state: &JointState) {
    let stamp = state.header.stamp;
    let stamp_ns = i64::from(stamp.sec) * 1_000_000_000 + i64::from(stamp.nanosec);
    let lag_ns = ros2_now_ns() - stamp_ns;
    for (name, q) in state.name.iter().zip(&state.position) {
        let place = places.get(name).and_then(|&place| joints.get_mut(place));
        let Some(joint) = place.filter(|_| q.is_finite()) else {
            continue;
        };
        // A message that is repeated, or comes after a later one, says nothing new.
        let newest = joint.readings.back();
        if newest.is_some_and(|(newest_ns, _)| *newest_ns >= stamp_ns) {
            continue;
        }
        joint.least_lag_ns = match newest {
            // It forgets, so that a clock that was set is seen.
            Some((newest_ns, _)) => lag_ns.min(joint.least_lag_ns + (stamp_ns - newest_ns) / 10),
            None => lag_ns,
        };
        joint.readings.push_back((stamp_ns, *q));
        joint.heard = Some(Instant::now());
        while (joint.readings.front()).is_some_and(|(old_ns, _)| stamp_ns - old_ns > KEPT_NS) {
            joint.readings.pop_front();
        }
    }
}

fn pose_of(message: &PoseStamped) -> Option<Pose<Table, Object>> {
    let (at, turn) = (&message.pose.position, &message.pose.orientation);
    Pose::from_array([at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w]).ok()
}

/// Locks even after a panic in another thread: guarded values are replaced whole.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
