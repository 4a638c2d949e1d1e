//! A cell backed by physics alone, with the same protocol as a real one.

mod model_mismatch;
mod physics;
mod playing;

use std::{
    cell::RefCell,
    collections::BTreeMap,
    ops::Deref,
    sync::{Arc, Mutex},
    time::Duration,
};

use ::robot::{Joint, RobotModel};
use nalgebra::Isometry3;
use simulation::{ObjectShape, SceneConfig, check_hand};
use spatial::Pose;

pub use self::model_mismatch::ModelMismatch;
use crate::{
    CellArm, CellError, CellRobot, CellServer, EncodedGoal, Goal, Machine, MachineDescription,
    Rejection, ServerConfig, ServiceConfig,
    acceptance::PALM,
    report::{Report, Sample},
    server::{Abort, MonitoredMotion, lock},
};

/// Configuration of a simulated cell.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulatedCellConfig {
    /// The cell's name.
    pub name: String,
    /// Endpoint that it listens on: `tcp/127.0.0.1:PORT`, port 0 for any free one.
    pub listen: String,
    /// Its physics; the difference from the screen's is the gap that a motion must bridge.
    pub scene: SceneConfig,
    /// The arm that carries the hand; without one the hand is free-flying.
    pub arm: Option<CellArm>,
    /// Its other differences from the screen.
    pub mismatch: ModelMismatch,
    /// Settings of its service.
    pub service: ServiceConfig,
}

/// Heartbeat timeout before a motion in real time is aborted, unless another is configured.
const HEARTBEAT_TIMEOUT: Duration = Duration::from_millis(250);

/// A running simulated cell; it stops when dropped.
pub struct SimulatedCell {
    server: CellServer,
    machine: Arc<Simulated>,
}

/// Returns an object by its name, if it exists, or the reason why the lookup failed.
pub type ObjectFinder = Box<dyn Fn(&str) -> Result<Option<ObjectShape>, String> + Send + Sync>;

/// The machine: a robot in physics.
struct Simulated {
    config: SimulatedCellConfig,
    robot: CellRobot,
    objects: Mutex<BTreeMap<String, ObjectShape>>,
    finder: Mutex<Option<ObjectFinder>>,
    /// The latest measurement.
    measured: Mutex<Sample>,
}

impl SimulatedCell {
    /// Starts a cell for the robot described by `urdf`; it is reachable when this returns.
    ///
    /// # Errors
    ///
    /// Fails if it cannot listen on the endpoint, another cell has the name, the URDF or the
    /// journal cannot be used, the hand cannot be simulated, or its collision shapes are meshes,
    /// which need [`SimulatedCell::start_with`].
    pub fn start(config: SimulatedCellConfig, urdf: &str) -> Result<Self, CellError> {
        Self::start_with(config, urdf, RobotModel::from_urdf(urdf)?)
    }

    /// Starts a cell as [`SimulatedCell::start`] does, for a hand with loaded meshes: `hand` is
    /// the robot of `urdf`, with the shapes of its meshes.
    ///
    /// # Errors
    ///
    /// As [`SimulatedCell::start`].
    pub fn start_with(
        config: SimulatedCellConfig,
        urdf: &str,
        hand: RobotModel,
    ) -> Result<Self, CellError> {
        check_hand(&config.scene, &hand)?;
        let robot = CellRobot::new(urdf, hand, config.arm.as_ref())?;
        let server = ServerConfig {
            name: config.name.clone(),
            listen: config.listen.clone(),
            service: config.service.clone(),
        };
        let machine = Arc::new(Simulated {
            measured: Mutex::new(at_rest(&robot)),
            config,
            robot,
            objects: Mutex::default(),
            finder: Mutex::default(),
        });
        Ok(Self {
            server: CellServer::start(server, Arc::clone(&machine) as Arc<dyn Machine>)?,
            machine,
        })
    }

    /// Puts an object within the robot's reach, under the name that goals use.
    pub fn put_object(&self, name: &str, object: ObjectShape) {
        lock(&self.machine.objects).insert(name.to_owned(), object);
    }

    /// Sets the lookup for goals' objects that were not put before the robot.
    pub fn find_objects(&self, finder: ObjectFinder) {
        *lock(&self.machine.finder) = Some(finder);
    }

    /// Stops the cell after the current goal.
    pub fn stop(self) {
        drop(self);
    }
}

impl Deref for SimulatedCell {
    type Target = CellServer;

    fn deref(&self) -> &CellServer {
        &self.server
    }
}

/// Executes a goal as a simulated cell does, but without a cell: nothing is published, journaled or
/// queried, and equal goals give equal reports. `see` is called at each control step and returns a
/// reason to abort, if any.
///
/// # Errors
///
/// Fails if the URDF cannot be used; a refusal or failed execution is a report.
pub fn execute_offline(
    config: &SimulatedCellConfig,
    urdf: &str,
    object: &ObjectShape,
    goal: &Goal,
    see: &mut dyn FnMut(&Sample) -> Option<Abort>,
) -> Result<Report, CellError> {
    let hand = RobotModel::from_urdf(urdf)?;
    check_hand(&config.scene, &hand)?;
    let robot = CellRobot::new(urdf, hand, config.arm.as_ref())?;
    let encoded = goal.encode();
    if let Err(refused) = robot.check(goal, |name| name == goal.object) {
        return Ok(Report::rejected(&encoded.goal_id, refused));
    }
    let done = physics::execute((goal, &encoded), object, &robot, config, see);
    Ok(done.unwrap_or_else(|err| Report::aborted(&encoded.goal_id, err.to_string())))
}

impl Simulated {
    /// Returns an object on the table, or the reason why the lookup failed.
    fn object(&self, name: &str) -> Result<Option<ObjectShape>, String> {
        if let Some(known) = lock(&self.objects).get(name) {
            return Ok(Some(known.clone()));
        }
        let found = match lock(&self.finder).as_ref() {
            Some(find) => find(name)?,
            None => None,
        };
        if let Some(found) = &found {
            lock(&self.objects).insert(name.to_owned(), found.clone());
        }
        Ok(found)
    }
}

impl Machine for Simulated {
    fn description(&self) -> MachineDescription {
        let scene = &self.config.scene;
        MachineDescription {
            simulated: true,
            robot: self.robot.digest().to_owned(),
            joints: self.robot.joint_names(),
            controllers: self.robot.controllers(scene.control_step_s()),
            palm: self.robot.arm.is_none().then_some(PALM),
            table_from_base: self.robot.table_from_base(),
            gap: self.config.mismatch.description(scene),
            silence: (self.config.service.real_time)
                .then(|| self.config.service.silence.unwrap_or(HEARTBEAT_TIMEOUT)),
        }
    }

    fn check(&self, goal: &Goal) -> Result<(), Rejection> {
        let unsaid = RefCell::new(None);
        let known = |object: &str| match self.object(object) {
            Ok(found) => found.is_some(),
            Err(why) => {
                *unsaid.borrow_mut() = Some(why);
                false
            }
        };
        let checked = self.robot.check(goal, known);
        checked.map_err(|refused| match unsaid.take() {
            Some(why) => Rejection::new(refused.code, format!("{}: {why}", refused.reason)),
            None => refused,
        })
    }

    fn measure(&self) -> Option<Sample> {
        Some(lock(&self.measured).clone())
    }

    fn execute(
        &self,
        goal: &Goal,
        encoded: &EncodedGoal,
        motion: &mut MonitoredMotion<'_>,
    ) -> Report {
        let id = &encoded.goal_id;
        let object = match self.object(&goal.object) {
            Ok(Some(object)) => object,
            Ok(None) => {
                return Report::aborted(id, format!("`{}` was taken away", goal.object));
            }
            Err(why) => return Report::aborted(id, why),
        };
        let mut see = |sample: &Sample| {
            motion.pace(sample.time_s);
            sample.clone_into(&mut lock(&self.measured));
            let abort = motion.see(sample);
            // From this step on the palm halts.
            if abort.is_some() {
                motion.has_stopped();
            }
            abort
        };
        let aim = (goal, encoded);
        let done = physics::execute(aim, &object, &self.robot, &self.config, &mut see);
        done.unwrap_or_else(|err| Report::aborted(id, err.to_string()))
    }
}

/// Returns the measurement before the first motion: the palm at the origin, and the joints at zero
/// or as close to it as their limits allow.
fn at_rest(robot: &CellRobot) -> Sample {
    let joints = robot.joints();
    let q_rad: Vec<f64> = joints.map(Joint::nearest_zero).collect();
    Sample {
        time_s: 0.0,
        table_from_palm: Pose::new(Isometry3::identity()),
        table_from_object: Pose::new(Isometry3::identity()),
        q_command_rad: q_rad.clone(),
        q_rad,
    }
}
