//! A cell made of physics alone, behind the same protocol as a real one.

mod acceptance;
mod journal;
mod physics;

use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc},
    thread::{self, JoinHandle},
};

use robot::RobotModel;
use simulation::{ObjectShape, SceneConfig};
use zenoh::{
    Session, Wait,
    liveliness::LivelinessToken,
    qos::CongestionControl,
    query::{Query, Queryable},
};

use self::{
    acceptance::MAX_GOAL_BYTES,
    journal::{Asked, Job, Journal},
};
use crate::{
    CellError, Goal, Keys, PROTOCOL,
    goal::SealedGoal,
    keys::goal_id_of,
    report::{Answer, Capabilities, Report},
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
    /// How wrong the motions are about where the object lies.
    pub object_error: ObjectError,
}

/// Bounds of the error with which the object's pose on the table is known; the error of each goal
/// is drawn evenly from within them, by the goal's digest.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ObjectError {
    /// Largest displacement along each of the table's axes, in meters.
    pub position_m: f64,
    /// Largest rotation about the vertical, in radians.
    pub yaw_rad: f64,
}

/// A running simulated cell; it stops when this is dropped.
pub struct SimulatedCell {
    shared: Arc<Shared>,
    endpoint: String,
    session: Session,
    served: Option<Served>,
    worker: Option<JoinHandle<()>>,
}

/// What keeps the cell reachable.
struct Served {
    _alive: LivelinessToken,
    _queryables: [Queryable<()>; 3],
}

/// What the threads of a cell share.
struct Shared {
    config: SimulatedCellConfig,
    keys: Keys,
    model: RobotModel,
    robot: String,
    objects: Mutex<BTreeMap<String, ObjectShape>>,
    journal: Mutex<Journal>,
}

impl SimulatedCell {
    /// Starts a cell for the robot described by `urdf`; it is reachable when this returns.
    ///
    /// # Errors
    ///
    /// Fails if the endpoint cannot be listened on or the URDF cannot be used.
    pub fn start(config: SimulatedCellConfig, urdf: &str) -> Result<Self, CellError> {
        let shared = Arc::new(Shared {
            keys: Keys::new(&config.name)?,
            model: RobotModel::from_urdf(urdf)?,
            robot: wire::robot_digest(urdf),
            objects: Mutex::default(),
            journal: Mutex::default(),
            config,
        });
        let (session, endpoint) = session::listen(&shared.config.listen)?;
        let (jobs, queue) = mpsc::channel();
        let served = serve(&session, &shared, &jobs).map_err(|source| CellError::Zenoh {
            action: "serve the simulated cell",
            source: source.into(),
        })?;
        let worker = {
            let (shared, session) = (Arc::clone(&shared), session.clone());
            thread::Builder::new()
                .name(format!("cell {}", shared.config.name))
                .spawn(move || work(&shared, &session, &queue))
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
    let capabilities = {
        let shared = Arc::clone(shared);
        session
            .declare_queryable(keys.capabilities())
            .callback(move |query| reply(&query, &wire::line(&shared.capabilities())))
            .wait()?
    };
    let goal = {
        let (shared, jobs) = (Arc::clone(shared), jobs.clone());
        session
            .declare_queryable(keys.goal())
            .callback(move |query| {
                let payload = query.payload().map(|payload| payload.to_bytes());
                let answer = shared.take(&payload.unwrap_or_default(), &jobs);
                reply(&query, &wire::line(&answer));
            })
            .wait()?
    };
    let result = {
        let shared = Arc::clone(shared);
        session
            .declare_queryable(keys.result("*"))
            .callback(move |query| shared.result(query))
            .wait()?
    };
    Ok(Served {
        _alive: session.liveliness().declare_token(keys.alive()).wait()?,
        _queryables: [capabilities, goal, result],
    })
}

/// Answers a question; who asked may be gone, which is theirs to notice.
fn reply(query: &Query, bytes: &[u8]) {
    let _sent = query.reply(query.key_expr(), bytes).wait();
}

impl Shared {
    fn capabilities(&self) -> Capabilities {
        let scene = &self.config.scene;
        let error = &self.config.object_error;
        Capabilities {
            protocol: PROTOCOL,
            cell: self.keys.name().to_owned(),
            simulated: true,
            robot: self.robot.clone(),
            joints: self.model.joint_names(),
            max_goal_bytes: MAX_GOAL_BYTES,
            gap: format!(
                "friction {}, mass times {}, torque limit {} Nm, object misplaced by up to {} m and {} rad",
                scene.friction,
                scene.mass_scale,
                scene.drive.torque_limit,
                error.position_m,
                error.yaw_rad
            ),
        }
    }

    /// Takes or refuses a goal; a goal taken before is not taken again.
    fn take(&self, bytes: &[u8], jobs: &mpsc::Sender<Job>) -> Answer {
        let (sealed, goal) = match self.check(bytes) {
            Ok(checked) => checked,
            Err(rejection) => return Answer::Rejected(rejection),
        };
        match lock(&self.journal).admit(&sealed) {
            Ok(true) => {
                // The worker ends only after the last queryable, whose callback this is.
                let _queued = jobs.send(Job { sealed, goal });
                Answer::Accepted
            }
            Ok(false) => Answer::Accepted,
            Err(rejection) => Answer::Rejected(rejection),
        }
    }

    fn check(&self, bytes: &[u8]) -> Result<(SealedGoal, Goal), crate::Rejection> {
        acceptance::check_length(bytes)?;
        let (sealed, goal) = SealedGoal::open(bytes)?;
        let known = |object: &str| lock(&self.objects).contains_key(object);
        acceptance::check(&goal, &self.model, &self.robot, known)?;
        Ok((sealed, goal))
    }

    /// Answers with the report on a goal, now or when it is over.
    fn result(&self, query: Query) {
        let id = goal_id_of(query.key_expr().as_str()).map(ToOwned::to_owned);
        let asked = lock(&self.journal).ask(id.as_deref().unwrap_or_default(), query);
        match asked {
            Asked::Kept => {}
            Asked::Over(query, report) => reply(&query, &report),
            Asked::NeverTaken(query) => {
                let _sent = query.reply_err("this cell took no such goal").wait();
            }
        }
    }

    /// Carries out a goal and reports on it.
    fn execute(&self, job: &Job) -> Report {
        let id = &job.sealed.goal_id;
        let object = lock(&self.objects).get(&job.goal.object).cloned();
        let Some(object) = object else {
            return Report::aborted(id, format!("`{}` was taken away", job.goal.object));
        };
        physics::carry_out(job, &object, &self.model, &self.config)
            .unwrap_or_else(|err| Report::aborted(id, err.to_string()))
    }
}

/// Executes goals one after another until the cell stops.
fn work(shared: &Shared, session: &Session, queue: &mpsc::Receiver<Job>) {
    for job in queue {
        let report = shared.execute(&job);
        // Whoever watches may lose samples: they are all in the report.
        let _published = publish(shared, session, &report);
        let bytes = report.to_bytes();
        let waiting = lock(&shared.journal).conclude(&report.goal_id, bytes.clone());
        for query in waiting {
            reply(&query, &bytes);
        }
    }
}

/// Publishes a report's samples one by one, as a real cell does while it moves, and the outcome.
fn publish(shared: &Shared, session: &Session, report: &Report) -> Result<(), zenoh::Error> {
    let publisher = session.declare_publisher(shared.keys.state()).wait()?;
    for (seq, sample) in report.samples.iter().enumerate() {
        let mut bytes = wire::line(&StateHeader {
            goal_id: report.goal_id.clone(),
            seq: seq as u64,
            joints: report.joints.clone(),
        });
        wire::push_numbers(&mut bytes, sample.to_row());
        publisher.put(bytes).wait()?;
    }
    session
        .put(shared.keys.outcome(&report.goal_id), report.to_line())
        .congestion_control(CongestionControl::Block)
        .wait()
}
