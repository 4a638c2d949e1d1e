//! The dispatcher's side: asks a cell what it can do, sends it goals, fetches the reports.

use std::{
    path::PathBuf,
    thread,
    time::{Duration, Instant},
};

use zenoh::{
    Session, Wait,
    qos::{CongestionControl, Priority},
    query::{ConsolidationMode, QueryTarget},
};

use crate::{
    Access, CellError, Goal, Keys, PROTOCOL, SealedGoal,
    goal::now,
    heartbeat::Heartbeat,
    report::{Answer, Capabilities, NEVER_TAKEN, Report, Word},
    session,
    wire::{self, WireError},
};

/// Pause before a question is repeated that no cell has heard: right after a cell reconnects, routers
/// may not know it yet and answer for nobody.
const PAUSE: Duration = Duration::from_millis(100);
/// How long is waited for an answer before the question is repeated, at least.
const PIECE: Duration = Duration::from_secs(1);

/// What was answered to a question.
type Answers = Vec<Result<Vec<u8>, NeverTaken>>;

/// A cell's word that a goal is not one of its own.
struct NeverTaken;

/// What is known of a goal that was sent.
#[derive(Debug, Clone, PartialEq)]
pub enum Executed {
    /// What came of it.
    Over(Report),
    /// What came of it when the cell took it before; nothing has moved now.
    Known(Report),
    /// Nothing was heard, as this says: the robot may have moved.
    Unheard(String),
}

/// What a cell says about a goal that was sent before.
#[derive(Debug, Clone, PartialEq)]
pub enum Recovered {
    /// What came of it.
    Report(Report),
    /// It never took the goal: nothing of it has moved.
    NeverTaken,
    /// Nothing was heard of it.
    Silent,
}

/// What a cell says to somebody who wants a motion broken off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Halt {
    /// It is done: nothing moves any more.
    Done,
    /// The motion was over before.
    Over,
    /// The cell never took that goal.
    NeverTaken,
    /// Nothing was heard: the robot may be moving.
    Unheard,
}

/// A connection to one cell.
pub struct CellClient {
    session: Session,
    endpoint: String,
    /// The file that said who one is.
    access: Option<PathBuf>,
    keys: Keys,
}

impl CellClient {
    /// Connects to the endpoint of the cell `name`, e.g. `tcp/127.0.0.1:7447`.
    ///
    /// # Errors
    ///
    /// Fails if nothing listens there within `timeout`, or the name or endpoint is not one.
    pub fn connect(endpoint: &str, name: &str, timeout: Duration) -> Result<Self, CellError> {
        Self::connect_as(None, endpoint, name, timeout)
    }

    /// As [`CellClient::connect`], as whom an access file says that one is: needed where the endpoint is
    /// `tls/HOST:PORT`.
    ///
    /// # Errors
    ///
    /// As [`CellClient::connect`], and if the one there does not take one's word for it.
    pub fn connect_as(
        access: Option<&Access>,
        endpoint: &str,
        name: &str,
        timeout: Duration,
    ) -> Result<Self, CellError> {
        Ok(Self {
            keys: Keys::new(name)?,
            session: session::connect(endpoint, access, timeout)?,
            endpoint: endpoint.to_owned(),
            access: access.map(|access| access.path().to_owned()),
        })
    }

    /// Asks what the cell can do.
    ///
    /// # Errors
    ///
    /// Fails if no cell or more than one answers within `timeout`, or in a way that cannot be read.
    pub fn capabilities(&self, timeout: Duration) -> Result<Capabilities, CellError> {
        let key = self.keys.capabilities();
        let started = Instant::now();
        let (answers, _) = self.ask(&key, &[], QueryTarget::All, timeout)?;
        let [Ok(answer)] = answers.as_slice() else {
            return Err(if answers.is_empty() {
                CellError::NoAnswer {
                    key,
                    endpoint: self.endpoint.clone(),
                    access: self.access.clone(),
                    waited: started.elapsed(),
                }
            } else {
                CellError::SeveralCells {
                    key,
                    endpoint: self.endpoint.clone(),
                    count: answers.len(),
                }
            });
        };
        let (capabilities, _): (Capabilities, _) = wire::split_line("capabilities", answer)
            .map_err(|source| CellError::Answer { key, source })?;
        if capabilities.protocol == PROTOCOL {
            Ok(capabilities)
        } else {
            Err(CellError::Protocol {
                endpoint: self.endpoint.clone(),
                expected: PROTOCOL,
                found: capabilities.protocol,
            })
        }
    }

    /// Sends a goal and waits for its report: `answer` for the cell's word that it takes the goal,
    /// then `result` for the end of the motion. Meanwhile the cell hears a heartbeat.
    ///
    /// The same goal is sent again while nothing is heard: a cell moves once for one goal. After silence
    /// to the end the cell may have moved, and only it or a person can tell. Ask again with
    /// [`CellClient::recover`]; never send the motion as another goal.
    ///
    /// # Errors
    ///
    /// Fails if the session is broken or an answer cannot be read.
    pub fn execute(
        &self,
        goal: &Goal,
        answer: Duration,
        result: Duration,
    ) -> Result<Executed, CellError> {
        // A goal that comes later than anybody waits for its answer does not start.
        let sealed = goal.seal().valid_until(now() + answer);
        let id = sealed.goal_id.as_str();
        let _heartbeat = Heartbeat::start(&self.session, self.keys.heartbeat())?;
        let key = self.keys.goal();
        let (answers, tries) = self.ask(&key, &sealed.bytes, QueryTarget::BestMatching, answer)?;
        let Some(bytes) = answers.iter().find_map(|answer| answer.as_ref().ok()) else {
            return Ok(silence("goal", answer));
        };
        let (word, _): (Answer, _) = wire::split_line("answer", bytes)
            .map_err(|source| CellError::Answer { key, source })?;
        let mut is_old = false;
        match word {
            Answer::Rejected(rejection) => {
                return Ok(Executed::Over(Report::rejected(id, rejection)));
            }
            Answer::Accepted { known: false } => self.show(&sealed)?,
            // A goal that was sent more than once may be known by its first sending.
            Answer::Accepted { known: true } => is_old = tries == 1,
        }
        Ok(match self.report(id, answer, result)? {
            Recovered::Report(report) if is_old => Executed::Known(report),
            Recovered::Report(report) => Executed::Over(report),
            Recovered::NeverTaken => {
                Executed::Unheard("the cell took it and has forgotten it".to_owned())
            }
            Recovered::Silent => silence("result", result),
        })
    }

    /// Asks what came of a goal that was sent before, perhaps by a dispatcher that has gone; waits up
    /// to `result` for the end of its motion.
    ///
    /// # Errors
    ///
    /// Fails if the session is broken or the report cannot be read.
    pub fn recover(
        &self,
        goal_id: &str,
        answer: Duration,
        result: Duration,
    ) -> Result<Recovered, CellError> {
        let _heartbeat = Heartbeat::start(&self.session, self.keys.heartbeat())?;
        self.report(goal_id, answer, result)
    }

    /// Has a goal broken off; returns when nothing of it moves any more.
    ///
    /// # Errors
    ///
    /// Fails if the session is broken or the answer cannot be read.
    pub fn cancel(&self, goal_id: &str, answer: Duration) -> Result<Halt, CellError> {
        self.halt(self.keys.cancel(goal_id), answer)
    }

    /// Has whatever moves broken off, and every goal refused until [`CellClient::resume`].
    ///
    /// # Errors
    ///
    /// Fails if the session is broken or the answer cannot be read.
    pub fn stop(&self, answer: Duration) -> Result<Halt, CellError> {
        self.halt(self.keys.stop(), answer)
    }

    /// Has goals taken again after a stop.
    ///
    /// # Errors
    ///
    /// Fails if the session is broken or the answer cannot be read.
    pub fn resume(&self, answer: Duration) -> Result<Halt, CellError> {
        self.halt(self.keys.resume(), answer)
    }

    fn halt(&self, key: String, answer: Duration) -> Result<Halt, CellError> {
        let (answers, _) = self.ask(&key, &[], QueryTarget::BestMatching, answer)?;
        match answers.first() {
            None => Ok(Halt::Unheard),
            Some(Err(_)) => Ok(Halt::NeverTaken),
            Some(Ok(bytes)) => {
                let (word, _) = wire::split_line("answer", bytes)
                    .map_err(|source| CellError::Answer { key, source })?;
                Ok(match word {
                    Word::Done => Halt::Done,
                    Word::Over => Halt::Over,
                })
            }
        }
    }

    /// Asks for a report until it comes: in pieces, because a question may be lost as well as its
    /// answer, and gives up early if the cell does not even say what it is.
    fn report(
        &self,
        goal_id: &str,
        answer: Duration,
        result: Duration,
    ) -> Result<Recovered, CellError> {
        let key = self.keys.result(goal_id);
        let deadline = Instant::now() + result;
        let mut heard = Instant::now();
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() || heard.elapsed() > answer {
                return Ok(Recovered::Silent);
            }
            let answers = self.ask_once(
                &key,
                &[],
                QueryTarget::BestMatching,
                Instant::now() + left.min(PIECE),
            )?;
            match answers.first() {
                Some(Ok(bytes)) => {
                    let report = Report::from_bytes(bytes).and_then(|report| {
                        if report.goal_id == goal_id {
                            return Ok(report);
                        }
                        Err(WireError::Json {
                            part: "report",
                            message: format!("it is about goal `{}`", report.goal_id),
                        })
                    });
                    let report = report.map_err(|source| CellError::Answer { key, source })?;
                    return Ok(Recovered::Report(report));
                }
                Some(Err(NeverTaken)) => return Ok(Recovered::NeverTaken),
                None => {
                    let key = self.keys.capabilities();
                    let until = Instant::now() + left.min(PIECE);
                    let there = self.ask_once(&key, &[], QueryTarget::All, until)?;
                    if there.is_empty() {
                        thread::sleep(PAUSE.min(left));
                    } else {
                        heard = Instant::now();
                    }
                }
            }
        }
    }

    /// Publishes a goal that the cell took, for those who watch.
    fn show(&self, goal: &SealedGoal) -> Result<(), CellError> {
        self.session
            .put(self.keys.motion(), goal.bytes.as_slice())
            .congestion_control(CongestionControl::Block)
            .wait()
            .map_err(|source| CellError::Zenoh {
                action: "publish a motion",
                source: source.into(),
            })
    }

    /// Asks a question until something is answered, or `timeout` is over; returns how often, too.
    fn ask(
        &self,
        key: &str,
        payload: &[u8],
        target: QueryTarget,
        timeout: Duration,
    ) -> Result<(Answers, u32), CellError> {
        let deadline = Instant::now() + timeout;
        let mut tries = 0;
        // The first try gets all the time but what others need: an answer may only be late.
        let mut piece = timeout / 2;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok((Vec::new(), tries));
            }
            tries += 1;
            let until = Instant::now() + left.min(piece.max(PIECE));
            let answers = self.ask_once(key, payload, target, until)?;
            if !answers.is_empty() {
                return Ok((answers, tries));
            }
            piece /= 2;
            thread::sleep(PAUSE.min(deadline.saturating_duration_since(Instant::now())));
        }
    }

    /// Asks a question once; returns what was answered in time, which may be nothing.
    fn ask_once(
        &self,
        key: &str,
        payload: &[u8],
        target: QueryTarget,
        deadline: Instant,
    ) -> Result<Answers, CellError> {
        let replies = self
            .session
            .get(key)
            .payload(payload)
            .target(target)
            .consolidation(ConsolidationMode::None)
            // Commands wait for room rather than being dropped, and never behind bulk data.
            .congestion_control(CongestionControl::Block)
            .priority(Priority::RealTime)
            .timeout(deadline.saturating_duration_since(Instant::now()))
            .wait()
            .map_err(|source| CellError::Zenoh {
                action: "ask the robot cell",
                source: source.into(),
            })?;
        let mut answers = Vec::new();
        while let Ok(Some(reply)) = replies.recv_deadline(deadline) {
            match reply.into_result() {
                Ok(sample) => answers.push(Ok(sample.payload().to_bytes().into_owned())),
                // Any other error is a timeout told by a router.
                Err(err) if err.payload().to_bytes() == NEVER_TAKEN.as_bytes() => {
                    answers.push(Err(NeverTaken));
                }
                Err(_) => {}
            }
        }
        Ok(answers)
    }
}

fn silence(about: &str, waited: Duration) -> Executed {
    Executed::Unheard(format!("no answer about the {about} within {waited:.1?}"))
}
