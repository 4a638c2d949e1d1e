//! The cell's side of the protocol, for any [`Machine`].

mod answers;
mod control;
mod fault;
mod journal;
mod monitored;
mod namesake;
mod refused;
mod stream;

use std::{
    path::PathBuf,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
        mpsc,
    },
    thread::{self, JoinHandle},
    time::Duration,
};

use schemas::executions::Outcome;
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
    refused::Refused,
    stream::Stream,
};
pub use self::{
    control::Abort,
    fault::{Fault, PlannedFault},
    monitored::{MonitoredMotion, Tick},
};
use crate::{
    Access, CellError, Keys, Machine, MachineDescription, PublicKey, SigningKey,
    capabilities::Acknowledgment, heartbeat::HeartbeatMessage, report::Report, ros2::Mirror,
    session, wire,
};

/// Settings of a cell's service for its dispatcher.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ServiceConfig {
    /// Folder of the goal journal, which a restarted cell reads; without one it forgets its goals
    /// when it ends.
    pub journal: Option<PathBuf>,
    /// Whether motions run in real time and are aborted on a heartbeat timeout; else they are
    /// simulated as fast as possible.
    pub real_time: bool,
    /// Heartbeat timeout of a simulated cell in real time; a quarter of a second if `None`.
    pub silence: Option<Duration>,
    /// ROS 2 domain in which it publishes its joints, if any: `/joint_states` while it moves, and
    /// `/joint_trajectory` of each goal, under the keys and types of `rmw_zenoh`.
    pub ros2_domain: Option<u32>,
    /// Router that it connects to, e.g. `tcp/127.0.0.1:7447`, instead of listening itself; it
    /// reconnects after an outage.
    pub router: Option<String>,
    /// Access file: credentials, trusted peers and access rules.
    pub access: Option<PathBuf>,
    /// Public keys of the dispatchers whose goals it takes; those of any if empty.
    pub dispatchers: Vec<PublicKey>,
    /// Injected faults.
    pub faults: Vec<PlannedFault>,
}

/// A cell's name, endpoint and service settings.
#[derive(Debug, Clone, PartialEq)]
pub struct ServerConfig {
    /// The cell's name.
    pub name: String,
    /// Endpoint that it listens on: `tcp/127.0.0.1:PORT`, port 0 for any free one.
    pub listen: String,
    /// Settings of its service.
    pub service: ServiceConfig,
}

/// Timeout for reaching a router when a cell starts.
const ROUTER_WAIT: Duration = Duration::from_secs(10);

/// A running cell; it stops when dropped.
pub struct CellServer {
    shared: Arc<Shared>,
    endpoint: String,
    session: Session,
    served: Option<CellServices>,
    worker: Option<JoinHandle<()>>,
    /// Publishes the state, in real time.
    streamer: Option<JoinHandle<()>>,
}

/// Called with the report of each goal that has ended.
pub type OutcomeListener = Box<dyn Fn(&Report) + Send + Sync>;

/// Called at each step of the control loop.
pub type TickListener = Box<dyn Fn(Tick) + Send + Sync>;

/// Threads and sessions that keep the cell reachable.
struct CellServices {
    _alive: LivelinessToken,
    _queryables: Vec<Queryable<()>>,
    _heartbeat: Subscriber<()>,
}

/// State shared by the threads of a cell.
struct Shared {
    real_time: bool,
    keys: Keys,
    machine: Arc<dyn Machine>,
    description: MachineDescription,
    listener: Mutex<Option<OutcomeListener>>,
    ticks: Mutex<Option<TickListener>>,
    journal: Mutex<Journal>,
    refused: Mutex<Refused>,
    /// The journal's key, which signs every answer.
    key: Arc<SigningKey>,
    /// Public keys of the dispatchers whose goals it takes; those of any if empty.
    dispatchers: Vec<PublicKey>,
    control: Control,
    stream: Stream,
    ended: AtomicBool,
    faults: Faults,
    /// Queries that a fault leaves open: dropping them would send an empty answer.
    unanswered: Mutex<Vec<Query>>,
}

impl CellServer {
    /// Starts a cell that drives `machine`; it is reachable when this returns.
    ///
    /// # Errors
    ///
    /// Fails if it cannot listen on the endpoint or reach the router, another cell has the name, or
    /// the journal cannot be used.
    pub fn start(config: ServerConfig, machine: Arc<dyn Machine>) -> Result<Self, CellError> {
        let ServerConfig {
            name,
            listen,
            service,
        } = config;
        let description = machine.description();
        let journal = match &service.journal {
            Some(folder) => Journal::open(folder, description.simulated)?,
            None => Journal::in_memory()?,
        };
        let keys = Keys::new(&name)?;
        let (session, endpoint) = open(&listen, &service)?;
        namesake::refuse(&session, &keys, &endpoint)?;
        let serving = |source: zenoh::Error| CellError::Zenoh {
            action: "serve the cell",
            source: source.into(),
        };
        let joints = description.joints.clone();
        let stream = Stream::new(&session, &keys, fresh_name(), joints).map_err(serving)?;
        let shared = Arc::new(Shared {
            real_time: service.real_time,
            keys,
            machine,
            stream,
            ended: AtomicBool::new(false),
            listener: Mutex::default(),
            ticks: Mutex::default(),
            key: journal.key(),
            journal: Mutex::new(journal),
            refused: Mutex::default(),
            dispatchers: service.dispatchers,
            control: Control::new(description.silence),
            description,
            faults: Faults::new(service.faults),
            unanswered: Mutex::default(),
        });
        let (jobs, queue) = mpsc::channel();
        let served = serve(&session, &shared, &jobs).map_err(serving)?;
        let mirror = service.ros2_domain;
        let mirror = mirror.map(|domain| Mirror::new(&session, domain));
        let mirror = mirror.transpose()?;
        let worker = {
            let (shared, session) = (Arc::clone(&shared), session.clone());
            thread::Builder::new()
                .name(format!("cell {name}"))
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
        if cell.shared.real_time {
            let shared = Arc::clone(&cell.shared);
            let streamer = thread::Builder::new()
                .name(format!("state {name}"))
                .spawn(move || shared.stream.run(shared.machine.as_ref(), &shared.ended));
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

impl Drop for CellServer {
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
fn open(listen: &str, service: &ServiceConfig) -> Result<(Session, String), CellError> {
    let access = service.access.as_deref().map(Access::read);
    let access = access.transpose()?;
    match &service.router {
        None => session::listen(listen, access.as_ref()),
        Some(router) => {
            let session = session::connect(router, access.as_ref(), ROUTER_WAIT);
            let session = session.map_err(CellError::of_a_router)?;
            Ok((session, router.clone()))
        }
    }
}

/// Locks even after a panic in another thread: guarded values are replaced whole.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
/// Declares a cell's queryables.
fn serve(
    session: &Session,
    shared: &Arc<Shared>,
    jobs: &mpsc::Sender<Job>,
) -> Result<CellServices, zenoh::Error> {
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
    Ok(CellServices {
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

/// Executes goals one after another until the cell stops.
fn work(shared: &Shared, session: &Session, mirror: Option<&Mirror>, queue: &mpsc::Receiver<Job>) {
    for job in queue {
        if let Some(mirror) = mirror {
            mirror.announce(&job.goal);
        }
        let mut motion = MonitoredMotion::new(shared, mirror, &job);
        let report = shared.machine.execute(&job.goal, &job.encoded, &mut motion);
        shared.stream.rest();
        let bytes = shared.faults.given(report.clone());
        let (waiting, outcome) = {
            let mut journal = lock(&shared.journal);
            let waiting = journal.conclude(&job.encoded.goal_id, bytes.clone());
            (waiting, journal.outcome(&job.encoded.goal_id))
        };
        if let Some(notify) = lock(&shared.listener).as_ref() {
            notify(&report);
        }
        // A cancel request may have come after the motion's end. Where the end is unknown it has no
        // answer: something may be moving.
        let asked = shared.control.awaiting_stop();
        if report.outcome != Outcome::Unknown {
            for query in asked {
                shared.acknowledge(&query, Acknowledgment::Over);
            }
        }
        if let Some(outcome) = outcome {
            let _published = session
                .put(shared.keys.outcome(&outcome.goal_id), outcome.to_line())
                .congestion_control(CongestionControl::Block)
                .priority(Priority::DataHigh)
                .wait();
        }
        for query in waiting {
            shared.reply_report(&query, &bytes);
        }
    }
}
