//! The dispatcher's side: asks a cell what it can do, sends it goals, fetches the reports.

use std::{
    path::PathBuf,
    sync::OnceLock,
    thread,
    time::{Duration, Instant},
};

use robot::Joint;
use serde::Deserialize;
use zenoh::{
    Session, Wait,
    qos::{CongestionControl, Priority},
    query::{ConsolidationMode, QueryTarget},
};

use crate::{
    Access, CellError, Goal, Keys, PROTOCOL, SealedGoal, UncheckedReport,
    capabilities::{Capabilities, GoalAnswer, Word},
    error::with_causes,
    goal::{CLOCKS_MS, Sending, now_unix_ms},
    heartbeat::Heartbeat,
    report::Report,
    session,
    signature::{Answer, Question, random_name},
    wire::{self, WireError},
};

/// Pause before a question is repeated that no cell has heard: right after a cell reconnects, routers
/// may not know it yet and answer for nobody.
const PAUSE: Duration = Duration::from_millis(100);
/// How long is waited for an answer before the question is repeated, at least.
const PIECE: Duration = Duration::from_secs(1);
/// Longest report that is read, in bytes: ten minutes of 22 joints at 200 Hz.
pub(crate) const MOST_REPORT: usize = 64 * 1024 * 1024;
/// Longest other answer that is read, in bytes.
pub(crate) const MOST_ANSWER: usize = 1024 * 1024;

/// What is known of a goal that was sent.
#[derive(Debug, Clone, PartialEq)]
pub enum Executed {
    /// What came of it.
    Over(Report),
    /// What came of it when the cell took it before; nothing has moved now.
    Known(Report),
    /// Nobody knows, as this says: the robot may have moved.
    Unknown(String),
}

/// What a cell says about a goal that was sent before.
#[derive(Debug, Clone, PartialEq)]
pub enum Recovered {
    /// What came of it; a report that cannot be believed is one of which the outcome is unknown.
    Report(Report),
    /// It never took the goal: nothing of it has moved.
    NeverTaken,
    /// Nobody knows, as this says.
    Unheard(String),
}

/// What a cell says to a cancel request.
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

/// Why nobody knows what came of a goal.
enum Doubt {
    /// No cell, or not the cell alone, has said.
    Unheard(String),
    /// What the cell has said cannot be believed.
    Unbelieved(String),
}

/// The version that any cell says, whatever else it says.
#[derive(Deserialize)]
struct Version {
    protocol: u32,
}

/// A connection to one cell: the first that answers what it can do.
pub struct CellClient {
    session: Session,
    endpoint: String,
    /// The file that said who one is.
    access: Option<PathBuf>,
    keys: Keys,
    /// One's own name in goals and heartbeats.
    dispatcher: String,
    /// The cell's journal, whose key signs all of its answers.
    journal: OnceLock<String>,
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
            dispatcher: random_name().map_err(CellError::Random)?,
            session: session::connect(endpoint, access, timeout)?,
            endpoint: endpoint.to_owned(),
            access: access.map(|access| access.path().to_owned()),
            journal: OnceLock::new(),
        })
    }

    /// Asks what the cell can do. From then on no other cell is believed.
    ///
    /// # Errors
    ///
    /// Fails if no cell or more than one answers within `timeout`, if it is another one than before, in a
    /// way that cannot be read, or by a clock that differs.
    pub fn capabilities(&self, timeout: Duration) -> Result<Capabilities, CellError> {
        let key = self.keys.capabilities();
        let (started, asked_ms) = (Instant::now(), now_unix_ms());
        let (answers, _) = self.ask(&key, &[], MOST_ANSWER, timeout)?;
        let answered_ms = now_unix_ms();
        let (journal, body) = match answers.as_slice() {
            [] => {
                return Err(CellError::NoAnswer {
                    key,
                    endpoint: self.endpoint.clone(),
                    access: self.access.clone(),
                    waited: started.elapsed(),
                });
            }
            [Answer::Signed { journal, body }] => (journal, body),
            [answer] => {
                // A cell of another version signs otherwise.
                if let Answer::Unsigned(bytes) = answer {
                    self.check_version(bytes)?;
                }
                return Err(CellError::Unsigned {
                    key,
                    endpoint: self.endpoint.clone(),
                    who: answer.who(),
                });
            }
            several => {
                return Err(CellError::SeveralCells {
                    key,
                    endpoint: self.endpoint.clone(),
                    count: several.len(),
                    who: who(several),
                });
            }
        };
        self.check_version(body)?;
        let unreadable = |source: WireError| CellError::Answer {
            key: key.clone(),
            source,
        };
        let (found, _): (Capabilities, _) =
            wire::split_line("capabilities", body).map_err(unreadable)?;
        if found.journal != *journal {
            return Err(unreadable(WireError::Json {
                part: "capabilities",
                message: "they name another journal than the one that signs them".to_owned(),
            }));
        }
        if found.cell != self.keys.name() {
            return Err(CellError::OtherName {
                endpoint: self.endpoint.clone(),
                expected: self.keys.name().to_owned(),
                found: found.cell,
            });
        }
        check_clock(found.clock_unix_ms, asked_ms, answered_ms)?;
        let known = self.journal.get_or_init(|| journal.clone());
        if known == journal {
            return Ok(found);
        }
        Err(CellError::OtherCell {
            endpoint: self.endpoint.clone(),
            expected: known.clone(),
            found: journal.clone(),
        })
    }

    /// Sends a goal and waits for its report: `answer` for the cell's word that it takes the goal,
    /// then `result` for the end of the motion. Meanwhile the cell hears a heartbeat. `robot` are the
    /// joints of the robot as the goal calls them, by which the report is checked.
    ///
    /// The same goal is sent again while nothing is heard: a cell moves once for one goal. Where nothing is
    /// heard to the end, somebody else answers, or what the cell says cannot be read or believed, the robot
    /// may have moved, and only the cell or a person can tell. Ask again with [`CellClient::recover`]; never
    /// send the motion as another goal.
    ///
    /// # Errors
    ///
    /// Fails if the goal cannot be sent: nothing of it has moved.
    pub fn execute(
        &self,
        goal: &Goal,
        robot: &[Joint],
        answer: Duration,
        result: Duration,
    ) -> Result<Executed, CellError> {
        if self.journal.get().is_none() {
            self.capabilities(answer)?;
        }
        // A goal that comes later than anybody waits for its answer does not start.
        let sealed = goal.seal().sent(Sending::now(&self.dispatcher, answer));
        let _heartbeat = self.beat()?;
        let sent = self.send(goal, &sealed, robot, answer, result);
        Ok(sent.unwrap_or_else(|doubt| Executed::Unknown(doubt.message())))
    }

    /// Asks what came of a goal that was sent before, perhaps by a dispatcher that has gone; waits up
    /// to `result` for the end of its motion.
    pub fn recover(
        &self,
        goal: &Goal,
        robot: &[Joint],
        answer: Duration,
        result: Duration,
    ) -> Recovered {
        let asked = || {
            if self.journal.get().is_none() {
                self.capabilities(answer)?;
            }
            self.beat()
        };
        let _heartbeat = match asked() {
            Ok(heartbeat) => heartbeat,
            Err(err) => return Recovered::Unheard(with_causes(&err)),
        };
        let id = goal.seal().goal_id;
        match self.report(goal, &id, robot, answer, result) {
            Ok(recovered) => recovered,
            Err(Doubt::Unheard(message)) => Recovered::Unheard(message),
            Err(Doubt::Unbelieved(message)) => Recovered::Report(Report::unknown(&id, message)),
        }
    }

    /// Has a goal broken off; returns when nothing of it moves any more.
    ///
    /// # Errors
    ///
    /// Fails if the session is broken, others answer too or the answer cannot be read.
    pub fn cancel(&self, goal_id: &str, answer: Duration) -> Result<Halt, CellError> {
        self.halt(self.keys.cancel(goal_id), answer)
    }

    /// Has whatever moves broken off, and every goal refused until [`CellClient::resume`].
    ///
    /// # Errors
    ///
    /// Fails if the session is broken, others answer too or the answer cannot be read.
    pub fn stop(&self, answer: Duration) -> Result<Halt, CellError> {
        self.halt(self.keys.stop(), answer)
    }

    /// Has goals taken again after a stop.
    ///
    /// # Errors
    ///
    /// Fails if the session is broken, others answer too or the answer cannot be read.
    pub fn resume(&self, answer: Duration) -> Result<Halt, CellError> {
        self.halt(self.keys.resume(), answer)
    }

    fn halt(&self, key: String, answer: Duration) -> Result<Halt, CellError> {
        let (answers, _) = self.ask(&key, &[], MOST_ANSWER, answer)?;
        let body = self.sole(&answers).map_err(|who| CellError::Strangers {
            key: key.clone(),
            endpoint: self.endpoint.clone(),
            who,
        })?;
        let Some(body) = body else {
            return Ok(Halt::Unheard);
        };
        let (word, _) =
            wire::split_line("answer", body).map_err(|source| CellError::Answer { key, source })?;
        Ok(match word {
            Word::Done => Halt::Done,
            Word::Over => Halt::Over,
            Word::NeverTaken => Halt::NeverTaken,
        })
    }

    fn beat(&self) -> Result<Heartbeat, CellError> {
        Heartbeat::start(&self.session, self.keys.heartbeat(), &self.dispatcher)
    }

    /// Sends a goal: from here on the robot may move.
    fn send(
        &self,
        goal: &Goal,
        sealed: &SealedGoal,
        robot: &[Joint],
        answer: Duration,
        result: Duration,
    ) -> Result<Executed, Doubt> {
        let key = self.keys.goal();
        let id = sealed.goal_id.as_str();
        let (answers, tries) = self
            .ask(&key, &sealed.bytes, MOST_ANSWER, answer)
            .map_err(|err| Doubt::Unheard(with_causes(&err)))?;
        let Some(body) = self.only(&key, &answers)? else {
            return Err(silence("goal", answer));
        };
        let (word, _): (GoalAnswer, _) =
            wire::split_line("answer", body).map_err(|err| unreadable(&key, &err))?;
        let is_old = match word {
            GoalAnswer::Rejected(rejection) => {
                return Ok(Executed::Over(Report::rejected(id, rejection)));
            }
            // A goal that was sent more than once may be known by its first sending.
            GoalAnswer::Accepted { known } => known && tries == 1,
        };
        if !is_old {
            self.show(sealed);
        }
        match self.report(goal, id, robot, answer, result)? {
            Recovered::Report(report) if is_old => Ok(Executed::Known(report)),
            Recovered::Report(report) => Ok(Executed::Over(report)),
            Recovered::NeverTaken => Err(Doubt::Unbelieved(
                "the cell took it and says that it never did".to_owned(),
            )),
            Recovered::Unheard(message) => Err(Doubt::Unheard(message)),
        }
    }

    /// Asks for a report until it comes: in pieces, because a question may be lost as well as its
    /// answer, and gives up early if the cell does not even say what it is.
    fn report(
        &self,
        goal: &Goal,
        goal_id: &str,
        robot: &[Joint],
        answer: Duration,
        result: Duration,
    ) -> Result<Recovered, Doubt> {
        let key = self.keys.result(goal_id);
        let deadline = Instant::now() + result;
        let mut heard = Instant::now();
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(silence("result", result));
            }
            if heard.elapsed() > answer {
                return Err(silence("result", answer));
            }
            let until = Instant::now() + left.min(PIECE);
            let unheard = |err: CellError| Doubt::Unheard(with_causes(&err));
            let answers = self
                .ask_once(&key, &[], MOST_REPORT, until)
                .map_err(unheard)?;
            if let Some(body) = self.only(&key, &answers)? {
                if let Ok((Word::NeverTaken, _)) = wire::split_line("answer", body) {
                    return Ok(Recovered::NeverTaken);
                }
                let report =
                    UncheckedReport::from_bytes(body).map_err(|err| unreadable(&key, &err))?;
                let checked = report.check(goal, robot);
                return checked.map(Recovered::Report).map_err(|contradiction| {
                    Doubt::Unbelieved(format!("its report contradicts itself: {contradiction}"))
                });
            }
            let key = self.keys.capabilities();
            let until = Instant::now() + left.min(PIECE);
            let there = self
                .ask_once(&key, &[], MOST_ANSWER, until)
                .map_err(unheard)?;
            if self.only(&key, &there)?.is_some() {
                heard = Instant::now();
            } else {
                thread::sleep(PAUSE.min(left));
            }
        }
    }

    /// Publishes a goal that the cell took, for those who watch: they may lose it.
    fn show(&self, goal: &SealedGoal) {
        let _shown = self
            .session
            .put(self.keys.motion(), goal.bytes.as_slice())
            .congestion_control(CongestionControl::Block)
            .wait();
    }

    fn only<'a>(&self, key: &str, answers: &'a [Answer]) -> Result<Option<&'a [u8]>, Doubt> {
        self.sole(answers).map_err(|who| {
            Doubt::Unheard(format!(
                "not the cell alone answers to key `{key}`, but {who}"
            ))
        })
    }

    /// Returns the one answer of the cell, if there is one; fails with who answered where somebody else
    /// did.
    fn sole<'a>(&self, answers: &'a [Answer]) -> Result<Option<&'a [u8]>, String> {
        let is_the_cell = |found: &str| self.journal.get().is_none_or(|known| known == found);
        match answers {
            [] => Ok(None),
            [Answer::Signed { journal, body }] if is_the_cell(journal) => Ok(Some(body)),
            others => Err(who(others)),
        }
    }

    fn check_version(&self, body: &[u8]) -> Result<(), CellError> {
        let found = wire::split_line::<Version>("capabilities", body);
        match found {
            Ok((Version { protocol }, _)) if protocol != PROTOCOL => Err(CellError::Protocol {
                endpoint: self.endpoint.clone(),
                expected: PROTOCOL,
                found: protocol,
            }),
            Ok(_) | Err(_) => Ok(()),
        }
    }

    /// Asks a question until something is answered, or `timeout` is over; returns how often, too.
    fn ask(
        &self,
        key: &str,
        payload: &[u8],
        most: usize,
        timeout: Duration,
    ) -> Result<(Vec<Answer>, u32), CellError> {
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
            let answers = self.ask_once(key, payload, most, until)?;
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
        most: usize,
        deadline: Instant,
    ) -> Result<Vec<Answer>, CellError> {
        let question = Question::new(key).map_err(CellError::Random)?;
        let replies = self
            .session
            .get(question.selector(None))
            .payload(payload)
            // Whoever would answer is asked: the one nearest need not be the cell.
            .target(QueryTarget::All)
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
        Ok(question.collect(&replies, most, deadline))
    }
}

impl Doubt {
    fn message(self) -> String {
        match self {
            Self::Unheard(message) | Self::Unbelieved(message) => message,
        }
    }
}

/// Checks that a cell's clock says a time between that at which it was asked and that at which its answer
/// came.
fn check_clock(cell_ms: u64, asked_ms: u64, answered_ms: u64) -> Result<(), CellError> {
    let seconds = |ms: u64| ms as f64 / 1000.0;
    let wrong = |ahead_s: f64| Err(CellError::Clock { ahead_s });
    if cell_ms > answered_ms.saturating_add(CLOCKS_MS) {
        return wrong(seconds(cell_ms - answered_ms));
    }
    if cell_ms < asked_ms.saturating_sub(CLOCKS_MS) {
        return wrong(-seconds(asked_ms - cell_ms));
    }
    Ok(())
}

/// Returns who answered, as people read it.
fn who(answers: &[Answer]) -> String {
    let names: Vec<String> = answers.iter().map(Answer::who).collect();
    names.join(" and ")
}

fn silence(about: &str, waited: Duration) -> Doubt {
    Doubt::Unheard(format!("no answer about the {about} within {waited:.1?}"))
}

fn unreadable(key: &str, err: &WireError) -> Doubt {
    Doubt::Unbelieved(format!("its answer to key `{key}` cannot be read: {err}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clock_offset_is_what_message_delay_cannot_explain() {
        let ahead = |cell_ms: u64| match check_clock(cell_ms, 100_000, 103_000) {
            Err(CellError::Clock { ahead_s }) => Some(ahead_s),
            _ => None,
        };
        for right in [99_000, 100_000, 102_000, 103_000, 104_000] {
            assert_eq!(ahead(right), None, "{right}");
        }
        assert_eq!(ahead(98_999), Some(-1.001));
        assert_eq!(ahead(104_001), Some(1.001));
        assert_eq!(ahead(0), Some(-100.0));
        assert!(ahead(u64::MAX).is_some());
    }
}
