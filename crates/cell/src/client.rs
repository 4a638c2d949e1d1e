//! The dispatcher's side: queries capabilities, sends goals, fetches reports.

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
    Access, CellError, EncodedGoal, Goal, Keys, PROTOCOL, UncheckedReport,
    capabilities::{Acknowledgment, Capabilities, GoalAnswer},
    error::with_causes,
    goal::{CLOCKS_MS, SendInfo, now_unix_ms},
    heartbeat::Heartbeat,
    report::Report,
    session,
    signature::{Answer, Question, random_name},
    wire::{self, WireError},
};

/// Pause before an unanswered query is repeated: right after a cell reconnects, routers may not
/// know it yet and answer in nobody's name.
const PAUSE: Duration = Duration::from_millis(100);
/// Wait for an answer before a query is repeated.
const QUERY_TIMEOUT: Duration = Duration::from_secs(1);
/// Longest report accepted, in bytes: ten minutes of 22 joints at 200 Hz.
pub(crate) const MAX_REPORT_BYTES: usize = 64 * 1024 * 1024;
/// Longest other answer accepted, in bytes.
pub(crate) const MAX_ANSWER_BYTES: usize = 1024 * 1024;

/// Result of sending a goal.
#[derive(Debug, Clone, PartialEq)]
pub enum GoalResult {
    /// The goal's report.
    Report(Report),
    /// The report of a goal that the cell had accepted before; nothing has moved now.
    EarlierReport(Report),
    /// The outcome is unknown for this reason: the robot may have moved.
    Unknown(String),
}

/// A cell's answer about a goal that was sent before.
#[derive(Debug, Clone, PartialEq)]
pub enum Recovered {
    /// The goal's report; if it fails its checks, its outcome is unknown.
    Report(Report),
    /// The cell never accepted the goal: nothing has moved.
    NeverTaken,
    /// The outcome is unknown for this reason.
    NoAnswer(String),
}

/// A cell's answer to a cancel, stop or resume request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ControlReply {
    /// The request was carried out: nothing moves any more, or goals are accepted again.
    Done,
    /// The motion had already ended.
    AlreadyEnded,
    /// The cell never accepted that goal.
    UnknownGoal,
    /// No answer: the robot may be moving.
    NoAnswer,
}

/// Why a goal's outcome is unknown.
enum UnknownOutcome {
    /// No answer, or answers from other parties too.
    NoAnswer(String),
    /// The cell's answer failed its checks.
    Untrusted(String),
}

/// The protocol version, which is readable in answers of every version.
#[derive(Deserialize)]
struct Version {
    protocol: u32,
}

/// A connection to one cell: the first that answers the capabilities query.
pub struct CellClient {
    session: Session,
    endpoint: String,
    /// Access file with this client's credentials.
    access: Option<PathBuf>,
    keys: Keys,
    /// This client's name in goals and heartbeats.
    dispatcher: String,
    /// The cell's journal, whose key signs all of its answers.
    journal: OnceLock<String>,
}

impl CellClient {
    /// Connects to the endpoint of the cell `name`, e.g. `tcp/127.0.0.1:7447`.
    ///
    /// # Errors
    ///
    /// Fails if nothing listens there within `timeout`, or the name or endpoint is invalid.
    pub fn connect(endpoint: &str, name: &str, timeout: Duration) -> Result<Self, CellError> {
        Self::connect_as(None, endpoint, name, timeout)
    }

    /// Connects as [`CellClient::connect`] does, with the credentials of an access file: required
    /// where the endpoint is `tls/HOST:PORT`.
    ///
    /// # Errors
    ///
    /// As [`CellClient::connect`], and if the peer does not accept the credentials.
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

    /// Queries the cell's capabilities. From then on only this cell is trusted.
    ///
    /// # Errors
    ///
    /// Fails if not exactly one cell answers within `timeout`, if it is another cell than before,
    /// if its answer cannot be read, or if its clock differs.
    pub fn capabilities(&self, timeout: Duration) -> Result<Capabilities, CellError> {
        let key = self.keys.capabilities();
        let (started, asked_ms) = (Instant::now(), now_unix_ms());
        let (answers, _) = self.ask(&key, &[], MAX_ANSWER_BYTES, timeout)?;
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
                // A cell of another version signs differently.
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

    /// Sends a goal and waits for its report: up to `answer` for the acknowledgment, then up to
    /// `result` for the end of the motion. Sends heartbeats meanwhile. `robot` are the robot's
    /// joints under the goal's names; the report is checked against them.
    ///
    /// The same goal is sent again while there is no answer: a cell moves once per goal. If no
    /// answer comes at all, another party answers, or an answer cannot be read or fails its checks,
    /// the robot may have moved, and only the cell or a person can tell. Ask again with
    /// [`CellClient::recover`]; never send the motion as another goal.
    ///
    /// # Errors
    ///
    /// Fails if the goal cannot be sent: nothing has moved.
    pub fn execute(
        &self,
        goal: &Goal,
        robot: &[Joint],
        answer: Duration,
        result: Duration,
    ) -> Result<GoalResult, CellError> {
        if self.journal.get().is_none() {
            self.capabilities(answer)?;
        }
        // A goal that arrives after its answer timeout must not start.
        let encoded = goal.encode().sent(SendInfo::now(&self.dispatcher, answer));
        let _heartbeat = self.beat()?;
        let sent = self.send(goal, &encoded, robot, answer, result);
        Ok(sent.unwrap_or_else(|unknown| GoalResult::Unknown(unknown.message())))
    }

    /// Queries the outcome of a goal that was sent before, perhaps by a dispatcher that has exited;
    /// waits up to `result` for the end of its motion.
    pub fn recover(
        &self,
        goal: &Goal,
        robot: &[Joint],
        answer: Duration,
        result: Duration,
    ) -> Recovered {
        let query = || {
            if self.journal.get().is_none() {
                self.capabilities(answer)?;
            }
            self.beat()
        };
        let _heartbeat = match query() {
            Ok(heartbeat) => heartbeat,
            Err(err) => return Recovered::NoAnswer(with_causes(&err)),
        };
        let id = goal.encode().goal_id;
        match self.report(goal, &id, robot, answer, result) {
            Ok(recovered) => recovered,
            Err(UnknownOutcome::NoAnswer(message)) => Recovered::NoAnswer(message),
            Err(UnknownOutcome::Untrusted(message)) => {
                Recovered::Report(Report::unknown(&id, message))
            }
        }
    }

    /// Cancels a goal; returns when its motion has stopped.
    ///
    /// # Errors
    ///
    /// Fails if the session is broken, another party answers too or the answer cannot be read.
    pub fn cancel(&self, goal_id: &str, answer: Duration) -> Result<ControlReply, CellError> {
        self.control(self.keys.cancel(goal_id), answer)
    }

    /// Aborts the current motion and has every goal refused until [`CellClient::resume`].
    ///
    /// # Errors
    ///
    /// Fails if the session is broken, another party answers too or the answer cannot be read.
    pub fn stop(&self, answer: Duration) -> Result<ControlReply, CellError> {
        self.control(self.keys.stop(), answer)
    }

    /// Lets the cell accept goals again after a stop.
    ///
    /// # Errors
    ///
    /// Fails if the session is broken, another party answers too or the answer cannot be read.
    pub fn resume(&self, answer: Duration) -> Result<ControlReply, CellError> {
        self.control(self.keys.resume(), answer)
    }

    fn control(&self, key: String, answer: Duration) -> Result<ControlReply, CellError> {
        let (answers, _) = self.ask(&key, &[], MAX_ANSWER_BYTES, answer)?;
        let body = self.sole(&answers).map_err(|who| CellError::Strangers {
            key: key.clone(),
            endpoint: self.endpoint.clone(),
            who,
        })?;
        let Some(body) = body else {
            return Ok(ControlReply::NoAnswer);
        };
        let (word, _) =
            wire::split_line("answer", body).map_err(|source| CellError::Answer { key, source })?;
        Ok(match word {
            Acknowledgment::Done => ControlReply::Done,
            Acknowledgment::Over => ControlReply::AlreadyEnded,
            Acknowledgment::NeverTaken => ControlReply::UnknownGoal,
        })
    }

    fn beat(&self) -> Result<Heartbeat, CellError> {
        Heartbeat::start(&self.session, self.keys.heartbeat(), &self.dispatcher)
    }

    /// Sends a goal: from here on the robot may move.
    fn send(
        &self,
        goal: &Goal,
        encoded: &EncodedGoal,
        robot: &[Joint],
        answer: Duration,
        result: Duration,
    ) -> Result<GoalResult, UnknownOutcome> {
        let key = self.keys.goal();
        let id = encoded.goal_id.as_str();
        let (answers, tries) = self
            .ask(&key, &encoded.bytes, MAX_ANSWER_BYTES, answer)
            .map_err(|err| UnknownOutcome::NoAnswer(with_causes(&err)))?;
        let Some(body) = self.only(&key, &answers)? else {
            return Err(silence("goal", answer));
        };
        let (word, _): (GoalAnswer, _) =
            wire::split_line("answer", body).map_err(|err| unreadable(&key, &err))?;
        let is_old = match word {
            GoalAnswer::Rejected(rejection) => {
                return Ok(GoalResult::Report(Report::rejected(id, rejection)));
            }
            // A goal sent more than once may be known from its first transmission.
            GoalAnswer::Accepted { known } => known && tries == 1,
        };
        if !is_old {
            self.show(encoded);
        }
        match self.report(goal, id, robot, answer, result)? {
            Recovered::Report(report) if is_old => Ok(GoalResult::EarlierReport(report)),
            Recovered::Report(report) => Ok(GoalResult::Report(report)),
            Recovered::NeverTaken => Err(UnknownOutcome::Untrusted(
                "the cell accepted the goal and now denies it".to_owned(),
            )),
            Recovered::NoAnswer(message) => Err(UnknownOutcome::NoAnswer(message)),
        }
    }

    /// Queries a report until it arrives: with a short timeout per query, because query and answer
    /// may both be lost. Gives up early if the cell does not even answer the capabilities query.
    fn report(
        &self,
        goal: &Goal,
        goal_id: &str,
        robot: &[Joint],
        answer: Duration,
        result: Duration,
    ) -> Result<Recovered, UnknownOutcome> {
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
            let until = Instant::now() + left.min(QUERY_TIMEOUT);
            let unheard = |err: CellError| UnknownOutcome::NoAnswer(with_causes(&err));
            let answers = self
                .ask_once(&key, &[], MAX_REPORT_BYTES, until)
                .map_err(unheard)?;
            if let Some(body) = self.only(&key, &answers)? {
                if let Ok((Acknowledgment::NeverTaken, _)) = wire::split_line("answer", body) {
                    return Ok(Recovered::NeverTaken);
                }
                let report =
                    UncheckedReport::from_bytes(body).map_err(|err| unreadable(&key, &err))?;
                let checked = report.check(goal, robot);
                return checked.map(Recovered::Report).map_err(|contradiction| {
                    UnknownOutcome::Untrusted(format!(
                        "its report contradicts itself: {contradiction}"
                    ))
                });
            }
            let key = self.keys.capabilities();
            let until = Instant::now() + left.min(QUERY_TIMEOUT);
            let there = self
                .ask_once(&key, &[], MAX_ANSWER_BYTES, until)
                .map_err(unheard)?;
            if self.only(&key, &there)?.is_some() {
                heard = Instant::now();
            } else {
                thread::sleep(PAUSE.min(left));
            }
        }
    }

    /// Publishes an accepted goal for watchers, who may miss it.
    fn show(&self, goal: &EncodedGoal) {
        let _shown = self
            .session
            .put(self.keys.motion(), goal.bytes.as_slice())
            .congestion_control(CongestionControl::Block)
            .wait();
    }

    fn only<'a>(
        &self,
        key: &str,
        answers: &'a [Answer],
    ) -> Result<Option<&'a [u8]>, UnknownOutcome> {
        self.sole(answers).map_err(|who| {
            UnknownOutcome::NoAnswer(format!(
                "a party other than the cell answers to key `{key}`: {who}"
            ))
        })
    }

    /// Returns the cell's answer, if there is one; fails with the names of all parties that
    /// answered if there are others.
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

    /// Repeats a query until it is answered or `timeout` elapses; returns the number of tries too.
    fn ask(
        &self,
        key: &str,
        payload: &[u8],
        most: usize,
        timeout: Duration,
    ) -> Result<(Vec<Answer>, u32), CellError> {
        let deadline = Instant::now() + timeout;
        let mut tries = 0;
        // The first try gets most of the time, because an answer may only be late.
        let mut piece = timeout / 2;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok((Vec::new(), tries));
            }
            tries += 1;
            let until = Instant::now() + left.min(piece.max(QUERY_TIMEOUT));
            let answers = self.ask_once(key, payload, most, until)?;
            if !answers.is_empty() {
                return Ok((answers, tries));
            }
            piece /= 2;
            thread::sleep(PAUSE.min(deadline.saturating_duration_since(Instant::now())));
        }
    }

    /// Sends a query once; returns the answers that arrived in time, possibly none.
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
            // Ask all queryables: the nearest one need not be the cell.
            .target(QueryTarget::All)
            .consolidation(ConsolidationMode::None)
            // Commands block for buffer space rather than being dropped, and never queue behind
            // bulk data.
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

impl UnknownOutcome {
    fn message(self) -> String {
        match self {
            Self::NoAnswer(message) | Self::Untrusted(message) => message,
        }
    }
}

/// Checks that the cell's clock lies between the times of the query and of its answer.
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

/// Returns who answered, as text for people.
fn who(answers: &[Answer]) -> String {
    let names: Vec<String> = answers.iter().map(Answer::who).collect();
    names.join(" and ")
}

fn silence(about: &str, waited: Duration) -> UnknownOutcome {
    UnknownOutcome::NoAnswer(format!("no answer about the {about} within {waited:.1?}"))
}

fn unreadable(key: &str, err: &WireError) -> UnknownOutcome {
    UnknownOutcome::Untrusted(format!("its answer to key `{key}` cannot be read: {err}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clock_offset_is_distinguished_from_message_delay() {
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
