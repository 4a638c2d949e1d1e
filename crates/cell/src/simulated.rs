//! A cell made of physics alone, behind the same protocol as a real one.

mod acceptance;
mod control;
mod fault;
mod gap;
mod journal;
mod physics;
mod playing;
mod robot;

use std::{
    collections::BTreeMap,
    path::PathBuf,
    sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc},
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use simulation::{ObjectShape, SceneConfig};
use zenoh::{
    Session, Wait,
    liveliness::LivelinessToken,
    pubsub::{Publisher, Subscriber},
    qos::CongestionControl,
    query::{Query, Queryable},
};

use self::{
    acceptance::MAX_GOAL_BYTES,
    control::Control,
    fault::Faults,
    journal::{Asked, Job, Journal},
    robot::Robot,
};
pub use self::{
    fault::{Fault, PlannedFault},
    gap::{Gap, ObjectError},
    robot::CellArm,
};
use crate::{
    CellError, Goal, Keys, PROTOCOL,
    goal::{Rejection, RejectionCode, SealedGoal, now},
    keys::goal_id_of,
    report::{Answer, Capabilities, NEVER_TAKEN, Report, Sample, Word},
    ros2::Mirror,
    session,
    wire::{self, StateHeader},
};

/// How a simulated cell is set up.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulatedCellConfig {
    /// The cell's name.
    pub name: String,
    /// Where it listens: `tcp/127.0.0.1:PORT`, port 0 for any free one.
    pub listen: String,
    /// Its physics; where they differ from the screen's is the gap that a motion must bridge.
    pub scene: SceneConfig,
    /// The arm that carries the hand; without one it flies.
    pub arm: Option<CellArm>,
    /// How else it differs from that.
    pub gap: Gap,
    /// How it serves.
    pub service: Service,
}

/// How a simulated cell serves its dispatcher.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Service {
    /// Folder in which it keeps what it has done, for the cell that is started after it; without one
    /// it forgets its goals when it ends.
    pub journal: Option<PathBuf>,
    /// Whether motions take as long as they say, and are broken off when the dispatcher falls silent;
    /// else they are simulated as fast as possible.
    pub real_time: bool,
    /// ROS 2 domain in which it shows its joints, if it does: `/joint_states` while it moves, and
    /// `/joint_trajectory` of each goal, under the keys and types of `rmw_zenoh`.
    pub ros2_domain: Option<u32>,
    /// What goes wrong.
    pub faults: Vec<PlannedFault>,
}

/// Longest time without a dispatcher's heartbeat before a motion in real time is broken off.
const SILENCE: Duration = Duration::from_millis(250);

/// A running simulated cell; it stops when this is dropped.
pub struct SimulatedCell {
    shared: Arc<Shared>,
    endpoint: String,
    session: Session,
    served: Option<Served>,
    worker: Option<JoinHandle<()>>,
}

/// Returns an object by its name, if it is there.
pub type ObjectFinder = Box<dyn Fn(&str) -> Option<ObjectShape> + Send + Sync>;

/// What keeps the cell reachable.
struct Served {
    _alive: LivelinessToken,
    _queryables: Vec<Queryable<()>>,
    _heartbeat: Subscriber<()>,
}

/// What the threads of a cell share.
struct Shared {
    config: SimulatedCellConfig,
    keys: Keys,
    robot: Robot,
    objects: Mutex<BTreeMap<String, ObjectShape>>,
    finder: Mutex<Option<ObjectFinder>>,
    journal: Mutex<Journal>,
    control: Control,
    faults: Faults,
}

impl SimulatedCell {
    /// Starts a cell for the robot described by `urdf`; it is reachable when this returns.
    ///
    /// # Errors
    ///
    /// Fails if the endpoint cannot be listened on, or the URDF or the journal cannot be used.
    pub fn start(config: SimulatedCellConfig, urdf: &str) -> Result<Self, CellError> {
        let journal = match &config.service.journal {
            Some(folder) => Journal::open(folder)?,
            None => Journal::default(),
        };
        let shared = Arc::new(Shared {
            keys: Keys::new(&config.name)?,
            robot: Robot::new(urdf, config.arm.as_ref())?,
            objects: Mutex::default(),
            finder: Mutex::default(),
            journal: Mutex::new(journal),
            control: Control::new(config.service.real_time.then_some(SILENCE)),
            faults: Faults::new(config.service.faults.clone()),
            config,
        });
        let (session, endpoint) = session::listen(&shared.config.listen)?;
        let (jobs, queue) = mpsc::channel();
        let served = serve(&session, &shared, &jobs).map_err(|source| CellError::Zenoh {
            action: "serve the simulated cell",
            source: source.into(),
        })?;
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
        Ok(Self {
            shared,
            endpoint,
            session,
            served: Some(served),
            worker: Some(worker),
        })
    }

    /// Returns the cell's name.
    pub fn name(&self) -> &str {
        self.shared.keys.name()
    }

    /// Returns where the cell is reached, e.g. `tcp/127.0.0.1:7447`.
    pub fn endpoint(&self) -> &str {
        &self.endpoint
    }

    /// Puts an object within the robot's reach: goals name it.
    pub fn put_object(&self, name: &str, object: ObjectShape) {
        lock(&self.shared.objects).insert(name.to_owned(), object);
    }

    /// Has objects that were not put before the robot looked for when a goal names them.
    pub fn find_objects(&self, finder: ObjectFinder) {
        *lock(&self.shared.finder) = Some(finder);
    }

    /// Returns how many goals the cell has executed.
    pub fn executed_n(&self) -> usize {
        lock(&self.shared.journal).executed_n()
    }

    /// Stops the cell when the goal in execution is over.
    pub fn stop(self) {
        drop(self);
    }
}

impl Drop for SimulatedCell {
    fn drop(&mut self) {
        // The queryables own the sending end of the worker's queue: without them it ends.
        self.served = None;
        if let Some(worker) = self.worker.take() {
            let _finished = worker.join();
        }
        let _closed = self.session.close().wait();
    }
}

/// Takes a lock even if a thread died with it: what it guards is replaced whole, never half.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Declares everything that a cell answers.
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
            .callback(move |_| shared.control.beat())
            .wait()?
    };
    Ok(Served {
        _queryables: vec![
            answer(keys.capabilities(), |shared, query| {
                reply(&query, &wire::line(&shared.capabilities()));
            })?,
            goal,
            answer(keys.result("*"), Shared::result)?,
            answer(keys.cancel("*"), Shared::cancel)?,
            answer(keys.stop(), Shared::stop)?,
            answer(keys.resume(), |shared, query| {
                shared.control.resume();
                reply(&query, &wire::line(&Word::Done));
            })?,
        ],
        _heartbeat: heartbeat,
        _alive: session.liveliness().declare_token(keys.alive()).wait()?,
    })
}

/// Answers a question; who asked may be gone, which is theirs to notice.
fn reply(query: &Query, bytes: &[u8]) {
    let _sent = query.reply(query.key_expr(), bytes).wait();
}

/// Answers that the goal is not one of this cell's.
fn never_taken(query: &Query) {
    let _sent = query.reply_err(NEVER_TAKEN).wait();
}

impl Shared {
    fn capabilities(&self) -> Capabilities {
        let scene = &self.config.scene;
        let Gap {
            object,
            latency_s,
            encoder_noise_rad,
        } = &self.config.gap;
        Capabilities {
            protocol: PROTOCOL,
            cell: self.keys.name().to_owned(),
            simulated: true,
            robot: self.robot.digest.clone(),
            controllers: self.robot.controllers(scene.control_step_s()),
            table_from_base: self.robot.table_from_base(),
            max_goal_bytes: MAX_GOAL_BYTES,
            gap: format!(
                "friction {}, mass times {}, torque limit {} Nm, object misplaced by up to {} m and {} rad, \
                 commands {latency_s} s late, encoder noise {encoder_noise_rad} rad",
                scene.friction,
                scene.mass_scale,
                scene.drive.torque_limit,
                object.position_m,
                object.yaw_rad
            ),
            real_time: self.config.service.real_time,
            silence_s: (self.config.service.real_time).then_some(SILENCE.as_secs_f64()),
        }
    }

    /// Answers a goal.
    fn goal(&self, query: &Query, jobs: &mpsc::Sender<Job>) {
        self.faults.goal();
        let payload = query.payload().map(|payload| payload.to_bytes());
        let (answer, job) = self.take(&payload.unwrap_or_default());
        self.faults.die(Fault::DieBeforeAnswer);
        self.faults.delay();
        let answer = wire::line(&answer);
        if !self.faults.strikes(Fault::LoseAnswer) {
            reply(query, &answer);
        }
        if self.faults.strikes(Fault::DoubleAnswer) {
            reply(query, &answer);
        }
        self.faults.die(Fault::DieAfterAnswer);
        if let Some(job) = job {
            // The worker ends only after the last queryable, whose callback this is.
            let _queued = jobs.send(job);
        }
    }

    /// Returns an object that lies before the robot.
    fn object(&self, name: &str) -> Option<ObjectShape> {
        let known = lock(&self.objects).get(name).cloned();
        known.or_else(|| {
            let found = lock(&self.finder).as_ref()?(name)?;
            lock(&self.objects).insert(name.to_owned(), found.clone());
            Some(found)
        })
    }

    /// Takes or refuses a goal; a goal taken before is known, whatever has changed since.
    fn take(&self, bytes: &[u8]) -> (Answer, Option<Job>) {
        let opened = acceptance::check_length(bytes).and_then(|()| SealedGoal::open(bytes));
        match opened.and_then(|(sealed, goal)| self.admit(sealed, goal)) {
            Ok(Some(job)) => (Answer::Accepted { known: false }, Some(job)),
            Ok(None) => (Answer::Accepted { known: true }, None),
            Err(rejection) => (Answer::Rejected(rejection), None),
        }
    }

    /// Notes a goal; returns it if it is to be executed now.
    fn admit(&self, sealed: SealedGoal, goal: Goal) -> Result<Option<Job>, Rejection> {
        if lock(&self.journal).knows(&sealed.goal_id) {
            return Ok(None);
        }
        let known = |object: &str| self.object(object).is_some();
        acceptance::check(&goal, &self.robot, known)?;
        let mut journal = lock(&self.journal);
        if self.control.is_stopped() {
            let reason = "the cell was stopped and has not been told to resume";
            return Err(Rejection::new(RejectionCode::Stopped, reason.to_owned()));
        }
        if sealed.has_expired(now()) {
            let reason = "the goal came after the time until which it was valid";
            return Err(Rejection::new(RejectionCode::Expired, reason.to_owned()));
        }
        if !journal.admit(&sealed)? {
            return Ok(None);
        }
        self.control.begin();
        Ok(Some(Job { sealed, goal }))
    }

    /// Answers with the report on a goal, now or when it is over.
    fn result(&self, query: Query) {
        if self.faults.strikes(Fault::LoseResult) {
            return;
        }
        let id = goal_id_of(query.key_expr().as_str()).map(ToOwned::to_owned);
        let asked = lock(&self.journal).ask(id.as_deref().unwrap_or_default(), query);
        match asked {
            Asked::Kept => {}
            Asked::Over(query, report) => reply(&query, &report),
            Asked::NeverTaken(query) => never_taken(&query),
        }
    }

    /// Breaks a goal off, and answers when that is done.
    fn cancel(&self, query: Query) {
        let id = goal_id_of(query.key_expr().as_str()).map(ToOwned::to_owned);
        let id = id.unwrap_or_default();
        let journal = lock(&self.journal);
        if journal.executing() == Some(&id) {
            self.control.cancel(&id, query);
        } else if journal.knows(&id) {
            reply(&query, &wire::line(&Word::Over));
        } else {
            never_taken(&query);
        }
    }

    /// Breaks off whatever moves and takes no more goals.
    fn stop(&self, query: Query) {
        let journal = lock(&self.journal);
        if let Some(query) = self.control.stop(query, journal.executing().is_some()) {
            reply(&query, &wire::line(&Word::Done));
        }
    }

    /// Carries out a goal and reports on it.
    fn execute(&self, session: &Session, mirror: Option<&Mirror>, job: &Job) -> Report {
        let id = &job.sealed.goal_id;
        let Some(object) = self.object(&job.goal.object) else {
            return Report::aborted(id, format!("`{}` was taken away", job.goal.object));
        };
        if let Some(mirror) = mirror {
            mirror.announce(&job.goal);
        }
        let mut motion = Watched::new(self, session, mirror, id);
        physics::carry_out(job, &object, &self.robot, &self.config, &mut motion)
            .unwrap_or_else(|err| Report::aborted(id, err.to_string()))
    }
}

/// A motion in execution, as those see it who watch or have a word in it.
struct Watched<'a> {
    shared: &'a Shared,
    goal_id: &'a str,
    joints: Vec<String>,
    /// Whoever watches may lose samples: they are all in the report.
    publisher: Option<Publisher<'a>>,
    mirror: Option<&'a Mirror>,
    /// When the first sample was shown.
    started: Option<Instant>,
    seq: u64,
}

impl<'a> Watched<'a> {
    fn new(
        shared: &'a Shared,
        session: &'a Session,
        mirror: Option<&'a Mirror>,
        goal_id: &'a str,
    ) -> Self {
        Self {
            shared,
            goal_id,
            joints: shared.robot.joint_names(),
            publisher: session.declare_publisher(shared.keys.state()).wait().ok(),
            mirror,
            started: None,
            seq: 0,
        }
    }

    /// Shows a sample at its time; returns why the motion is to be broken off now, if it is.
    fn see(&mut self, sample: &Sample) -> Option<String> {
        if self.shared.config.service.real_time {
            let started = *self.started.get_or_insert_with(Instant::now);
            let at = started + Duration::from_secs_f64(sample.time_s);
            thread::sleep(at.saturating_duration_since(Instant::now()));
        }
        if self.seq > 0 {
            self.shared.faults.die(Fault::DieInMotion);
        }
        let mut bytes = wire::line(&StateHeader {
            goal_id: self.goal_id.to_owned(),
            seq: self.seq,
            joints: self.joints.clone(),
        });
        wire::push_numbers(&mut bytes, sample.to_row());
        self.seq += 1;
        if let Some(mirror) = self.mirror {
            mirror.show(&self.joints, sample);
        }
        let _published = self
            .publisher
            .as_ref()
            .map(|publisher| publisher.put(bytes).wait());
        self.shared.control.reason(self.goal_id)
    }

    /// Tells those who asked that the palm stands still.
    fn halted(&self) {
        for query in self.shared.control.asking() {
            reply(&query, &wire::line(&Word::Done));
        }
    }
}

/// Executes goals one after another until the cell stops.
fn work(shared: &Shared, session: &Session, mirror: Option<&Mirror>, queue: &mpsc::Receiver<Job>) {
    for job in queue {
        let report = shared.execute(session, mirror, &job);
        let bytes = report.to_bytes();
        let waiting = lock(&shared.journal).conclude(&report.goal_id, bytes.clone());
        // Somebody may have asked for an end when the motion was over already.
        for query in shared.control.asking() {
            reply(&query, &wire::line(&Word::Over));
        }
        let _published = session
            .put(shared.keys.outcome(&report.goal_id), report.to_line())
            .congestion_control(CongestionControl::Block)
            .wait();
        for query in waiting {
            reply(&query, &bytes);
        }
    }
}
