//! Controllers that stand in for ROS 2: they listen and publish under the same keys and types, and
//! follow the rules of `joint_trajectory_controller` (`ros2_controllers`, function
//! `validate_trajectory_msg` and class `Trajectory`). Nothing here is a robot: a joint is where it is
//! commanded to be.

use std::{
    collections::VecDeque,
    str::FromStr,
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, JoinHandle},
    time::Duration,
};

use cell::{
    CellRobot, JointPoint, JointRates, JointTrack, Ros2Node, Ros2Publisher, Ros2Subscriber,
    Urgency, ros2_now_ns,
};
use robot::Joint;
use schemas::ros2::{
    JointState, JointTrajectory, PoseStamped, Time,
    motion::{header, joint_state, pose},
};

use crate::{
    config::{Config, Controller},
    measurements::lock,
};

/// Period of a controller's update, in nanoseconds.
const STEP_NS: i64 = 4_000_000;
/// Updates between two joint states.
const STATE_STEPS: u64 = 2;
/// Delay with which a late controller reads its messages, in nanoseconds.
const LATE_NS: i64 = 100_000_000;
/// Distance of a jerky controller's joint from its command, in radians.
const JERK_RAD: f64 = 0.02;
/// Speed of a runaway joint, in rad/s.
const RUNAWAY_RAD_PER_S: f64 = 0.5;

/// Time at which a faulty controller fails, in nanoseconds after its first message.
const GOES_WRONG_NS: i64 = 1_000_000_000;
/// A pause between messages after which the next one begins another motion, in nanoseconds.
const PAUSE_NS: i64 = 500_000_000;

/// Behavior of an emulated controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Behavior {
    /// It works correctly.
    Sound,
    /// It reads each message a tenth of a second late.
    Late,
    /// Its joints alternate between the two sides of their commands.
    Jerky,
    /// It refuses every message.
    Refusing,
    /// It dies a second after its first message, and its joint states end too.
    Dying,
    /// A second after its first message its first joint runs away, and does not stop.
    Runaway,
}

impl FromStr for Behavior {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "sound" => Ok(Self::Sound),
            "late" => Ok(Self::Late),
            "jerky" => Ok(Self::Jerky),
            "refusing" => Ok(Self::Refusing),
            "dying" => Ok(Self::Dying),
            "runaway" => Ok(Self::Runaway),
            _ => Err(format!(
                "`{text}` is no behavior: sound, late, jerky, refusing, dying or runaway"
            )),
        }
    }
}

/// Log of the controllers, by their own clock.
#[derive(Debug, Clone, Default)]
pub(crate) struct Log {
    /// Times of all updates, in nanoseconds, and the largest change of a joint in each, in radians.
    pub(crate) steps: Vec<(i64, f64)>,
    /// Motions that the messages made, of all controllers: messages without a pause are one motion.
    pub(crate) motions_n: usize,
    /// Messages refused, with the reasons.
    pub(crate) refused: Vec<String>,
}

/// Emulated controllers of an arm and a hand; they end when dropped.
pub(crate) struct Emulated {
    ended: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    log: Arc<Mutex<Log>>,
    object_z_m: Arc<Mutex<Option<f64>>>,
    _subscribers: Vec<Ros2Subscriber>,
}

/// A controller.
struct Emulation {
    behavior: Behavior,
    /// Its joints' names at the controller.
    joints: Vec<String>,
    q_rad: Vec<f64>,
    /// The trajectory being followed and its start time, by the controller's clock; if the first point lay in the
    /// future, it begins at the joints' positions on arrival.
    active: Option<(i64, JointTrack)>,
    inbox: Arc<Mutex<VecDeque<(i64, JointTrajectory)>>>,
    states: Ros2Publisher<JointState>,
    /// Times of the first and the latest message.
    begun_ns: Option<i64>,
    heard_ns: Option<i64>,
}

impl Emulated {
    /// Starts the controllers that a cell expects, arm and hand with a behavior each, their joints
    /// at `start_rad`: the arm's, the hand's, in the order of the URDF.
    pub(crate) fn start(
        config: &Config,
        robot: &CellRobot,
        behaviors: [Behavior; 2],
        start_rad: [Vec<f64>; 2],
    ) -> Result<Self, String> {
        let said = |err| cell::with_causes(&err);
        let wait = Duration::from_secs(10);
        let name = (config.domain, "emulated_controllers");
        let node = Ros2Node::connect(&config.router, name, wait).map_err(said)?;
        let (mut subscribers, mut emulations) = (Vec::new(), Vec::new());
        let parts: [(&Controller, &[Joint]); 2] = [
            (&config.arm, robot.arm_joints()),
            (&config.hand, robot.hand_joints()),
        ];
        for (((controller, joints), behavior), q_rad) in
            parts.into_iter().zip(behaviors).zip(start_rad)
        {
            let inbox = Arc::new(Mutex::new(VecDeque::new()));
            let filled = Arc::clone(&inbox);
            let heard = move |message: Result<JointTrajectory, _>| {
                if let Ok(message) = message {
                    lock(&filled).push_back((ros2_now_ns(), message));
                }
            };
            let topic = format!("{}/joint_trajectory", controller.node);
            subscribers.push(node.subscribe(&topic, heard).map_err(said)?);
            let names = joints.iter().map(|joint| controller.name_of(&joint.name));
            emulations.push(Emulation {
                behavior,
                joints: names.map(ToOwned::to_owned).collect(),
                q_rad,
                active: None,
                inbox,
                states: node
                    .publish(&controller.joint_states, Urgency::Data)
                    .map_err(said)?,
                begun_ns: None,
                heard_ns: None,
            });
        }
        let object = config.object.as_ref().map(|topic| {
            let publisher: Ros2Publisher<PoseStamped> =
                node.publish(&topic.pose, Urgency::Data).map_err(said)?;
            Ok::<_, String>((publisher, topic.frame.clone()))
        });
        let object = object.transpose()?;
        let ended = Arc::new(AtomicBool::new(false));
        let log = Arc::new(Mutex::new(Log::default()));
        let object_z_m = Arc::new(Mutex::new(None));
        let thread = {
            let (ended, log) = (Arc::clone(&ended), Arc::clone(&log));
            let height = Arc::clone(&object_z_m);
            thread::spawn(move || {
                // It owns the topics.
                let _node = node;
                let mut now_ns = ros2_now_ns();
                for step in 0_u64.. {
                    if ended.load(Ordering::Relaxed) {
                        return;
                    }
                    let mut changed = 0.0_f64;
                    for emulation in &mut emulations {
                        let change = emulation.update(now_ns, &mut lock(&log));
                        changed = changed.max(change);
                        if step.is_multiple_of(STATE_STEPS) {
                            emulation.publish(now_ns, step);
                        }
                    }
                    lock(&log).steps.push((now_ns, changed));
                    if let (Some((topic, frame)), Some(z_m)) = (&object, *lock(&height)) {
                        let there = nalgebra::Isometry3::translation(0.0, 0.0, z_m);
                        let there: spatial::Pose<(), ()> = spatial::Pose::new(there);
                        topic.put(&PoseStamped {
                            header: header(now_ns, frame),
                            pose: pose(&there),
                        });
                    }
                    // A controller that was held up goes on with the time that it is.
                    now_ns = (now_ns + STEP_NS).max(ros2_now_ns());
                    let rest_ns = u64::try_from(now_ns - ros2_now_ns()).unwrap_or(0);
                    thread::sleep(Duration::from_nanos(rest_ns));
                }
            })
        };
        Ok(Self {
            ended,
            thread: Some(thread),
            log,
            object_z_m,
            _subscribers: subscribers,
        })
    }

    /// Puts the object at this height above the table's origin; before that none is measured.
    pub(crate) fn put_object(&self, z_m: f64) {
        *lock(&self.object_z_m) = Some(z_m);
    }

    /// Returns the log of the controllers so far.
    pub(crate) fn log(&self) -> Log {
        lock(&self.log).clone()
    }
}

impl Drop for Emulated {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ended = thread.join();
        }
    }
}

impl Emulation {
    /// Reads received messages, and moves the joints to their commanded positions; returns the
    /// largest change of a joint, in radians.
    fn update(&mut self, now_ns: i64, log: &mut Log) -> f64 {
        let late_ns = if self.behavior == Behavior::Late {
            LATE_NS
        } else {
            0
        };
        loop {
            let next =
                lock(&self.inbox).pop_front_if(|(heard_ns, _)| *heard_ns + late_ns <= now_ns);
            let Some((heard_ns, message)) = next else {
                break;
            };
            self.begun_ns.get_or_insert(heard_ns);
            let pause_ns = self.heard_ns.map_or(i64::MAX, |last_ns| heard_ns - last_ns);
            log.motions_n += usize::from(pause_ns > PAUSE_NS);
            self.heard_ns = Some(heard_ns);
            if self.behavior == Behavior::Refusing || self.is_dead(now_ns) {
                continue;
            }
            match self.accept(&message, now_ns) {
                Ok(taken) => self.active = Some(taken),
                Err(why) => log.refused.push(why),
            }
        }
        let Some((begin_ns, track)) = &self.active else {
            return 0.0;
        };
        if self.is_dead(now_ns) {
            return 0.0;
        }
        let time_s = seconds(now_ns - begin_ns);
        let Some(point) = track.at(time_s) else {
            return 0.0;
        };
        let mut q_rad = point.q_rad;
        if self.behavior == Behavior::Runaway
            && let Some(q) = q_rad.first_mut()
        {
            *q += RUNAWAY_RAD_PER_S * seconds(self.age_ns(now_ns) - GOES_WRONG_NS).max(0.0);
        }
        let both = self.q_rad.iter().zip(&q_rad);
        let change = both.fold(0.0_f64, |most, (old, new)| most.max((new - old).abs()));
        self.q_rad = q_rad;
        change
    }

    fn is_dead(&self, now_ns: i64) -> bool {
        self.behavior == Behavior::Dying && self.age_ns(now_ns) > GOES_WRONG_NS
    }

    /// Returns the time since the first message, in nanoseconds.
    fn age_ns(&self, now_ns: i64) -> i64 {
        now_ns - self.begun_ns.unwrap_or(now_ns)
    }

    /// Checks a message as a controller does; returns its start time and the trajectory to follow from now on.
    fn accept(&self, message: &JointTrajectory, now_ns: i64) -> Result<(i64, JointTrack), String> {
        let mut names: Vec<&String> = message.joint_names.iter().collect();
        let mut own: Vec<&String> = self.joints.iter().collect();
        names.sort();
        own.sort();
        if names != own {
            return Err(format!("joints {:?}", message.joint_names));
        }
        let dof = names.len();
        let points = message.points.iter().map(|point| {
            let full =
                |numbers: &[f64]| numbers.len() == dof && numbers.iter().all(|x| x.is_finite());
            let after = point.time_from_start;
            let is_whole =
                full(&point.positions) && full(&point.velocities) && full(&point.accelerations);
            (is_whole && point.effort.is_empty()).then(|| JointPoint {
                time_s: f64::from(after.sec) + f64::from(after.nanosec) * 1e-9,
                q_rad: point.positions.clone(),
                rates: JointRates {
                    velocity: point.velocities.clone(),
                    acceleration: point.accelerations.clone(),
                },
            })
        });
        let mut points = points
            .collect::<Option<Vec<_>>>()
            .ok_or("a point is not whole")?;
        let rising = points.iter().zip(points.iter().skip(1));
        if !rising.clone().all(|(from, to)| to.time_s > from.time_s) {
            return Err("the times do not increase".to_owned());
        }
        let [Some(first), Some(last)] = [points.first(), points.last()] else {
            return Err("no points".to_owned());
        };
        if last
            .rates
            .velocity
            .iter()
            .any(|v| v.abs() > f64::from(f32::EPSILON))
        {
            return Err("the last velocity is not zero".to_owned());
        }
        let begin_ns = nanoseconds_of(message.header.stamp);
        if seconds(now_ns - begin_ns) > last.time_s {
            return Err("it ends in the past".to_owned());
        }
        let elapsed_s = seconds(now_ns - begin_ns);
        if elapsed_s < first.time_s {
            // The way to a first point in the future begins where the joints are.
            let here = JointPoint {
                time_s: elapsed_s,
                q_rad: self.q_rad.clone(),
                rates: JointRates::zero(dof),
            };
            points.insert(0, here);
        }
        let track = JointTrack {
            joints: message.joint_names.clone(),
            points,
        };
        let track = track
            .reordered(&self.joints)
            .map_err(|err| err.to_string())?;
        Ok((begin_ns, track))
    }

    fn publish(&self, now_ns: i64, step: u64) {
        if self.is_dead(now_ns) {
            return;
        }
        let side = if step.is_multiple_of(2 * STATE_STEPS) {
            JERK_RAD
        } else {
            -JERK_RAD
        };
        let off_rad = if self.behavior == Behavior::Jerky && self.active.is_some() {
            side
        } else {
            0.0
        };
        let q_rad: Vec<f64> = self.q_rad.iter().map(|q| q + off_rad).collect();
        self.states
            .put(&joint_state(now_ns, &self.joints, &q_rad, &[]));
    }
}

fn seconds(time_ns: i64) -> f64 {
    time_ns as f64 * 1e-9
}

fn nanoseconds_of(stamp: Time) -> i64 {
    i64::from(stamp.sec) * 1_000_000_000 + i64::from(stamp.nanosec)
}
