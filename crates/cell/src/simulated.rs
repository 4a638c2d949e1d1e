//! A cell backed by physics alone, with the same protocol as a real one.

mod acceptance;
mod answers;
mod control;
mod fault;
mod journal;
mod model_mismatch;
mod namesake;
mod physics;
mod playing;
mod robot;
mod stream;
mod watched;

use std::{
    collections::BTreeMap,
    path::PathBuf,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
        mpsc,
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use ::robot::RobotModel;
use simulation::{ObjectShape, SceneConfig};
use zenoh::{
    Session, Wait,
    liveliness::LivelinessToken,
    pubsub::Subscriber,
    qos::{CongestionControl, Priority},
    query::{Query, Queryable},
};

use self::{
    answers::requested_from,
    control::Control,
    fault::Faults,
    journal::{Job, Journal, fresh_name},
    robot::Robot,
    stream::Stream,
    watched::MonitoredMotion,
};
pub use self::{
    control::Abort,
    fault::{Fault, PlannedFault},
    model_mismatch::ModelMismatch,
    robot::CellArm,
    watched::Tick,
};
use crate::{
    Access, CellError, Goal, Keys,
    capabilities::Acknowledgment,
    heartbeat::HeartbeatMessage,
    report::{Report, Sample},
    ros2::Mirror,
    session,
    signature::JournalKey,
    wire,
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
    /// How it serves.
    pub service: ServiceConfig,
}

/// How a simulated cell serves its dispatcher.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ServiceConfig {
    /// Folder of the goal journal, which a restarted cell reads; without one it forgets its goals
    /// when it ends.
    pub journal: Option<PathBuf>,
    /// Whether motions run in real time and are aborted on a heartbeat timeout; else they are
    /// simulated as fast as possible.
    pub real_time: bool,
    /// ROS 2 domain in which it publishes its joints, if any: `/joint_states` while it moves, and
    /// `/joint_trajectory` of each goal, under the keys and types of `rmw_zenoh`.
    pub ros2_domain: Option<u32>,
    /// Router that it connects to, e.g. `tcp/127.0.0.1:7447`, instead of listening itself; it
    /// reconnects after an outage.
    pub router: Option<String>,
    /// Access file: credentials, trusted peers and access rules.
    pub access: Option<PathBuf>,
    /// Injected faults.
    pub faults: Vec<PlannedFault>,
}

/// Timeout for reaching a router when a cell starts.
const ROUTER_WAIT: Duration = Duration::from_secs(10);

/// Heartbeat timeout before a motion in real time is aborted.
const HEARTBEAT_TIMEOUT: Duration = Duration::from_millis(250);

/// A running simulated cell; it stops when dropped.
pub struct SimulatedCell {
    shared: Arc<Shared>,
    endpoint: String,
    session: Session,
    served: Option<Served>,
    worker: Option<JoinHandle<()>>,
    /// Publishes the state, in real time.
    streamer: Option<JoinHandle<()>>,
}

/// Returns an object by its name, if it exists, or why the lookup failed.
pub type ObjectFinder = Box<dyn Fn(&str) -> Result<Option<ObjectShape>, String> + Send + Sync>;

/// Called with the report of each goal that has ended.
pub type OutcomeListener = Box<dyn Fn(&Report) + Send + Sync>;

/// Called at each step of the control loop.
pub type TickListener = Box<dyn Fn(Tick) + Send + Sync>;

/// What keeps the cell reachable.
struct Served {
    _alive: LivelinessToken,
    _queryables: Vec<Queryable<()>>,
    _heartbeat: Subscriber<()>,
}

/// State shared by the threads of a cell.
struct Shared {
    config: SimulatedCellConfig,
    keys: Keys,
    robot: Robot,
    objects: Mutex<BTreeMap<String, ObjectShape>>,
    finder: Mutex<Option<ObjectFinder>>,
    listener: Mutex<Option<OutcomeListener>>,
    ticks: Mutex<Option<TickListener>>,
    journal: Mutex<Journal>,
    /// The journal's key, which signs every answer.
    key: Arc<JournalKey>,
    control: Control,
    stream: Stream,
    ended: AtomicBool,
    faults: Faults,
    /// Queries that a fault leaves open: dropping them would send an empty answer.
    unanswered: Mutex<Vec<Query>>,
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
    /// what `urdf` describes, with the shapes of its meshes.
    ///
    /// # Errors
    ///
    /// As [`SimulatedCell::start`].
    pub fn start_with(
        config: SimulatedCellConfig,
        urdf: &str,
        hand: RobotModel,
    ) -> Result<Self, CellError> {
        let journal = match &config.service.journal {
            Some(folder) => Journal::open(folder)?,
            None => Journal::in_memory()?,
        };
        let keys = Keys::new(&config.name)?;
        let robot = Robot::new(urdf, hand, &config)?;
        let (session, endpoint) = open(&config)?;
        namesake::refuse(&session, &keys, &endpoint)?;
        let serving = |source: zenoh::Error| CellError::Zenoh {
            action: "serve the simulated cell",
            source: source.into(),
        };
        let (epoch, joints) = (fresh_name(), robot.joint_names());
        let stream = Stream::new(&session, &keys, epoch, joints, &stream::at_rest(&robot))
            .map_err(serving)?;
        let shared = Arc::new(Shared {
            keys,
            robot,
            stream,
            ended: AtomicBool::new(false),
            objects: Mutex::default(),
            finder: Mutex::default(),
            listener: Mutex::default(),
            ticks: Mutex::default(),
            key: journal.key(),
            journal: Mutex::new(journal),
            control: Control::new(config.service.real_time.then_some(HEARTBEAT_TIMEOUT)),
            faults: Faults::new(config.service.faults.clone()),
            unanswered: Mutex::default(),
            config,
        });
        let (jobs, queue) = mpsc::channel();
        let served = serve(&session, &shared, &jobs).map_err(serving)?;
        let mirror = shared.config.service.ros2_domain;
        let mirror = mirror.map(|domain| Mirror::new(&session, domain));
        let mirror = mirror.transpose().map_err(|source| CellError::Zenoh {
            action: "show the cell to ROS 2",
            source: source.into(),
        })?;
        let worker = {
            let (shared, session) = (Arc::clone(&shared), session.clone());
            thread::Builder::new()
                .name(format!("cell {}", shared.config.name))
                .spawn(move || work(&shared, &session, mirror.as_ref(), &queue))
                .map_err(CellError::Thread)?
        };
        let mut cell = Self {
            shared,
            endpoint,
            session,
            served: Some(served),
            worker: Some(worker),
            streamer: None,
        };
        if cell.shared.config.service.real_time {
            let shared = Arc::clone(&cell.shared);
            let streamer = thread::Builder::new()
                .name(format!("state {}", shared.config.name))
                .spawn(move || shared.stream.run(&shared.ended));
            cell.streamer = Some(streamer.map_err(CellError::Thread)?);
        }
        Ok(cell)
    }

    /// Returns the cell's name.
    pub fn name(&self) -> &str {
        self.shared.keys.name()
    }

    /// Returns the id of the connected router, which changes when the router restarts; none for a
    /// cell that listens itself.
    pub fn router(&self) -> Option<String> {
        session::router(&self.session)
    }

    /// Returns the cell's endpoint, e.g. `tcp/127.0.0.1:7447`.
    pub fn endpoint(&self) -> &str {
        &self.endpoint
    }

    /// Puts an object within the robot's reach, under the name that goals use.
    pub fn put_object(&self, name: &str, object: ObjectShape) {
        lock(&self.shared.objects).insert(name.to_owned(), object);
    }

    /// Sets the lookup for goals' objects that were not put before the robot.
    pub fn find_objects(&self, finder: ObjectFinder) {
        *lock(&self.shared.finder) = Some(finder);
    }

    /// Sets the listener for goals that have ended.
    pub fn on_outcome(&self, listener: OutcomeListener) {
        *lock(&self.shared.listener) = Some(listener);
    }

    /// Sets the listener for steps of the real-time control loop.
    pub fn on_tick(&self, listener: TickListener) {
        *lock(&self.shared.ticks) = Some(listener);
    }

    /// Returns the number of executed goals.
    pub fn executed_count(&self) -> usize {
        lock(&self.shared.journal).executed_count()
    }

    /// Stops the cell after the current goal.
    pub fn stop(self) {
        drop(self);
    }
}

impl Drop for SimulatedCell {
    fn drop(&mut self) {
        // The queryables own the sending end of the worker's queue: dropping them ends it.
        self.served = None;
        if let Some(worker) = self.worker.take() {
            let _finished = worker.join();
        }
        self.shared.ended.store(true, Ordering::Relaxed);
        if let Some(streamer) = self.streamer.take() {
            let _finished = streamer.join();
        }
        let _closed = self.session.close().wait();
    }
}

/// Opens the cell's session; returns it with the cell's endpoint.
fn open(config: &SimulatedCellConfig) -> Result<(Session, String), CellError> {
    let access = config.service.access.as_deref().map(Access::read);
    let access = access.transpose()?;
    match &config.service.router {
        None => session::listen(&config.listen, access.as_ref()),
        Some(router) => match session::connect(router, access.as_ref(), ROUTER_WAIT) {
            Ok(session) => Ok((session, router.clone())),
            Err(CellError::Connect {
                endpoint,
                access,
                waited,
                source,
            }) => Err(CellError::Router {
                endpoint,
                access,
                waited,
                source,
            }),
            Err(err) => Err(err),
        },
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
    let robot = Robot::new(urdf, RobotModel::from_urdf(urdf)?, config)?;
    if let Err(refused) = acceptance::check(goal, &robot, |name| name == goal.object) {
        return Ok(Report::rejected(&goal.encode().goal_id, refused));
    }
    let job = Job {
        encoded: goal.encode(),
        goal: goal.clone(),
        received: Instant::now(),
    };
    let id = job.encoded.goal_id.clone();
    let done = physics::carry_out(&job, object, &robot, config, see);
    Ok(done.unwrap_or_else(|err| Report::aborted(&id, err.to_string())))
}

/// Locks even after a panic in another thread: guarded values are replaced whole.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Declares a cell's queryables.
fn serve(
    session: &Session,
    shared: &Arc<Shared>,
    jobs: &mpsc::Sender<Job>,
) -> Result<Served, zenoh::Error> {
    let keys = &shared.keys;
    let answer = |key: String, answer: fn(&Shared, Query)| {
        let shared = Arc::clone(shared);
        session
            .declare_queryable(key)
            .callback(move |query| answer(&shared, query))
            .wait()
    };
    let goal = {
        let (shared, jobs) = (Arc::clone(shared), jobs.clone());
        session
            .declare_queryable(keys.goal())
            .callback(move |query| shared.goal(&query, &jobs))
            .wait()?
    };
    let heartbeat = {
        let shared = Arc::clone(shared);
        session
            .declare_subscriber(keys.heartbeat())
            .callback(move |sample| {
                let bytes = sample.payload().to_bytes();
                let beat = wire::split_line::<HeartbeatMessage>("heartbeat", &bytes);
                // Ignore unreadable heartbeats.
                if let Ok((beat, _)) = beat {
                    shared.control.beat(&beat.dispatcher);
                }
            })
            .wait()?
    };
    Ok(Served {
        _queryables: vec![
            answer(keys.capabilities(), |shared, query| {
                shared.reply(&query, &wire::line(&shared.capabilities()));
            })?,
            goal,
            answer(keys.result("*"), Shared::result)?,
            answer(keys.results(), |shared, query| {
                let outcomes = lock(&shared.journal).outcomes(requested_from(&query));
                shared.reply(&query, &outcomes.to_bytes());
            })?,
            answer(keys.history(), |shared, query| {
                shared.reply(&query, &shared.stream.since(requested_from(&query)));
            })?,
            answer(keys.cancel("*"), Shared::cancel)?,
            answer(keys.stop(), Shared::stop)?,
            answer(keys.resume(), |shared, query| {
                shared.control.resume();
                shared.acknowledge(&query, Acknowledgment::Done);
            })?,
        ],
        _heartbeat: heartbeat,
        _alive: session.liveliness().declare_token(keys.alive()).wait()?,
    })
}

impl Shared {
    /// Executes a goal and reports on it.
    fn execute(&self, mirror: Option<&Mirror>, job: &Job) -> Report {
        let id = &job.encoded.goal_id;
        let object = match self.object(&job.goal.object) {
            Ok(Some(object)) => object,
            Ok(None) => {
                return Report::aborted(id, format!("`{}` was taken away", job.goal.object));
            }
            Err(why) => return Report::aborted(id, why),
        };
        if let Some(mirror) = mirror {
            mirror.announce(&job.goal);
        }
        let mut motion = MonitoredMotion::new(self, mirror, id, job.received);
        let report = physics::carry_out(job, &object, &self.robot, &self.config, &mut |sample| {
            motion.see(sample)
        })
        .unwrap_or_else(|err| Report::aborted(id, err.to_string()));
        self.stream.rest();
        report
    }
}

/// Executes goals one after another until the cell stops.
fn work(shared: &Shared, session: &Session, mirror: Option<&Mirror>, queue: &mpsc::Receiver<Job>) {
    for job in queue {
        let report = shared.execute(mirror, &job);
        let bytes = shared.faults.given(report.clone());
        let (waiting, outcome) = {
            let mut journal = lock(&shared.journal);
            let waiting = journal.conclude(&report.goal_id, bytes.clone());
            (waiting, journal.outcome(&report.goal_id))
        };
        if let Some(notify) = lock(&shared.listener).as_ref() {
            notify(&report);
        }
        // A cancel request may have come after the motion's end.
        for query in shared.control.awaiting_stop() {
            shared.acknowledge(&query, Acknowledgment::Over);
        }
        if let Some(outcome) = outcome {
            let _published = session
                .put(shared.keys.outcome(&outcome.goal_id), outcome.to_line())
                .congestion_control(CongestionControl::Block)
                .priority(Priority::DataHigh)
                .wait();
        }
        for query in waiting {
            shared.reply(&query, &bytes);
        }
    }
}
