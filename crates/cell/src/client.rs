//! The dispatcher's side: queries capabilities, sends goals, fetches reports.

use std::{
    path::PathBuf,
    sync::OnceLock,
    thread,
    time::{Duration, Instant},
};

use robot::Joint;
use zenoh::{
    Session, Wait,
    qos::{CongestionControl, Priority},
    query::{ConsolidationMode, QueryTarget},
};

use crate::{
    Acceptance, Access, Address, CellError, Goal, GoalMessage, Keys, PROTOCOL, Rejection,
    SigningKey, Terms, UncheckedReport,
    capabilities::{Acknowledgment, Capabilities, GoalAnswer},
    error::{RecordError, Transmission, with_causes},
    heartbeat::Heartbeat,
    message::{CLOCKS_MS, Version, now_unix_ms},
    report::Report,
    session,
    signature::{Answer, Question, random_name, short},
    text::plain_line,
    wire::{self, WireError},
};

/// Pause before an unanswered query is repeated: right after a cell reconnects, routers may not
/// know it yet and answer in nobody's name.
const PAUSE: Duration = Duration::from_millis(100);
/// Wait for an answer before a query is repeated.
const QUERY_TIMEOUT: Duration = Duration::from_secs(1);
/// Longest report accepted, in bytes: ten minutes of 22 joints at 200 Hz.
pub(crate) const MAX_REPORT_BYTES: usize = 64 * 1024 * 1024;
/// Queries for the report of a motion that is over, before it is taken without its samples.
const REPORT_TRIES: u32 = 3;
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
    /// The message would have more bytes than the cell takes: nothing was sent.
    TooLong {
        /// Its bytes.
        bytes: usize,
        /// The most that the cell takes.
        most: usize,
    },
}

/// How long a client waits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Patience {
    /// For a short answer, in which a cell checks at most.
    pub answer: Duration,
    /// For the end of a motion.
    pub result: Duration,
}

/// Memory of what a dispatcher sends, which is written while it sends.
pub trait SendRecord {
    /// Records a goal, before its first transmission, with the cell's answer that permits it.
    ///
    /// # Errors
    ///
    /// Fails if it cannot be recorded; then it is not sent.
    fn sending(
        &self,
        message: &GoalMessage,
        permitted_by: &Capabilities,
    ) -> Result<(), RecordError>;

    /// Records the cell's acceptance.
    ///
    /// # Errors
    ///
    /// Fails if it cannot be recorded; the goal counts as sent all the same.
    fn accepted(&self, goal_id: &str, acceptance: &Acceptance) -> Result<(), RecordError>;

    /// Records the cell's refusal of a goal's only transmission: nothing has moved, and nothing of it is under
    /// way.
    ///
    /// # Errors
    ///
    /// Fails if it cannot be recorded; the goal counts as sent then.
    fn refused(&self, goal_id: &str, why: &Rejection) -> Result<(), RecordError>;
}

/// No memory.
impl SendRecord for () {
    fn sending(&self, _message: &GoalMessage, _cell: &Capabilities) -> Result<(), RecordError> {
        Ok(())
    }

    fn accepted(&self, _goal_id: &str, _acceptance: &Acceptance) -> Result<(), RecordError> {
        Ok(())
    }

    fn refused(&self, _goal_id: &str, _why: &Rejection) -> Result<(), RecordError> {
        Ok(())
    }
}

/// A cell's answer about a goal that was sent before.
#[derive(Debug, Clone, PartialEq)]
pub enum RecoveryResult {
    /// The goal's report.
    Report(Report),
    /// The cell's answer is not to be believed; as a report its outcome is unknown, for this reason.
    Untrusted(Report),
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

/// A connection to one cell: the first that answers the capabilities query.
pub struct CellClient {
    session: Session,
    endpoint: String,
    /// Access file with this client's credentials.
    access: Option<PathBuf>,
    keys: Keys,
    /// This client's name in goals and heartbeats.
    dispatcher: String,
    /// The key that signs its goals.
    signing_key: SigningKey,
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
            signing_key: SigningKey::fresh().map_err(CellError::Random)?,
            session: session::connect(endpoint, access, timeout)?,
            endpoint: endpoint.to_owned(),
            access: access.map(|access| access.path().to_owned()),
            journal: OnceLock::new(),
        })
    }

    /// Signs goals with this key, by which a cell may know its dispatchers, instead of a new one.
    #[must_use]
    pub fn signing_with(self, signing_key: SigningKey) -> Self {
        Self {
            signing_key,
            ..self
        }
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
        let answers = self.ask(&key, timeout)?;
        let answered_ms = now_unix_ms();
        let (journal, body) = self.sole_signed(&key, &answers, started)?;
        self.check_version(body)?;
        let unreadable = |source: WireError| CellError::Answer {
            key: key.clone(),
            source,
        };
        let (mut found, _): (Capabilities, _) =
            wire::split_line("capabilities", body).map_err(unreadable)?;
        found.gap = plain_line(&found.gap);
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
                found: plain_line(&found.cell),
            });
        }
        if let Some(fault) = found.contradiction() {
            return Err(CellError::Contradiction {
                cell: found.cell,
                fault,
                transmission: Transmission::None,
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

    /// Returns the journal and the body of the one answer about capabilities, asked for at `started`.
    ///
    /// # Errors
    ///
    /// Fails if there is no answer, if it is not signed, or if there are several.
    fn sole_signed<'a>(
        &self,
        key: &str,
        answers: &'a [Answer],
        started: Instant,
    ) -> Result<(&'a String, &'a [u8]), CellError> {
        let (key, endpoint) = (key.to_owned(), self.endpoint.clone());
        let transmission = Transmission::None;
        Err(match answers {
            [] => CellError::NoAnswer {
                key,
                endpoint,
                access: self.access.clone(),
                waited: started.elapsed(),
                transmission,
            },
            [Answer::Signed { journal, body, .. }] => return Ok((journal, body)),
            [answer] => {
                // A cell of another version signs differently.
                if let Answer::Unsigned(bytes) = answer {
                    self.check_version(bytes)?;
                }
                CellError::Unsigned {
                    key,
                    endpoint,
                    who: answer.who(),
                    transmission,
                }
            }
            several => match sole_journal(several) {
                Some(journal) => CellError::DifferentAnswers {
                    key,
                    endpoint,
                    count: several.len(),
                    journal: short(journal).to_owned(),
                    transmission,
                },
                None => CellError::SeveralCells {
                    key,
                    endpoint,
                    count: several.len(),
                    who: who(several),
                    transmission,
                },
            },
        })
    }

    /// Sends a goal under these terms and waits for its report. Sends heartbeats meanwhile. `robot` are the
    /// robot's joints under the goal's names; the report is checked against them.
    ///
    /// The same goal is sent again while there is no answer: a cell moves once per goal. Immediately before
    /// each transmission the cell is asked what it is, and whether it may move. If no answer comes at all,
    /// another party answers, the cell changed after the first transmission, or an answer cannot be read or
    /// fails its checks, the robot may have moved, and only the cell or a person can tell. Ask again with
    /// [`CellClient::recover`]; never send the motion as another goal.
    ///
    /// # Errors
    ///
    /// Fails if the goal cannot be sent: nothing has moved.
    pub fn execute(
        &self,
        goal: &Goal,
        terms: &Terms,
        robot: &[Joint],
        patience: Patience,
        record: &dyn SendRecord,
    ) -> Result<GoalResult, CellError> {
        let first = self.capabilities(patience.answer)?;
        terms.check(&first)?;
        let message = self.addressed(goal, terms, patience.answer);
        let (bytes, most) = (message.bytes.len(), first.max_goal_bytes);
        if bytes > most {
            return Ok(GoalResult::TooLong { bytes, most });
        }
        let _heartbeat = self.beat()?;
        record.sending(&message, &first)?;
        let sent = self.send(goal, &message, terms, robot, patience, record);
        Ok(sent.unwrap_or_else(|unknown| GoalResult::Unknown(unknown.message())))
    }

    /// Addresses a goal to the cell; one that arrives after its answer timeout must not start.
    fn addressed(&self, goal: &Goal, terms: &Terms, answer: Duration) -> GoalMessage {
        let address = Address::now(
            self.keys.name(),
            &terms.capabilities().journal,
            &self.dispatcher,
            terms.simulated_only(),
            answer,
        );
        GoalMessage::new(goal.encode(), address, &self.signing_key)
    }

    /// Queries the outcome of a goal that was sent before under this id, perhaps by a dispatcher that has exited;
    /// waits for the end of its motion.
    pub fn recover(
        &self,
        goal_id: &str,
        goal: &Goal,
        robot: &[Joint],
        patience: Patience,
    ) -> RecoveryResult {
        let query = || {
            if self.journal.get().is_none() {
                self.capabilities(patience.answer)?;
            }
            self.beat()
        };
        let _heartbeat = match query() {
            Ok(heartbeat) => heartbeat,
            Err(err) => return RecoveryResult::NoAnswer(after_sending(err)),
        };
        match self.report(goal, goal_id, robot, patience) {
            Ok(recovered) => recovered,
            Err(UnknownOutcome::NoAnswer(message)) => RecoveryResult::NoAnswer(message),
            Err(UnknownOutcome::Untrusted(message)) => {
                RecoveryResult::Untrusted(Report::unknown(goal_id, message))
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
        let answers = self.ask(&key, answer)?;
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

    /// Sends a goal that the cell's last answer permits: from here on the robot may move.
    fn send(
        &self,
        goal: &Goal,
        message: &GoalMessage,
        terms: &Terms,
        robot: &[Joint],
        patience: Patience,
        record: &dyn SendRecord,
    ) -> Result<GoalResult, UnknownOutcome> {
        let key = self.keys.goal();
        let id = message.encoded.goal_id.as_str();
        let (body, acceptance, tries) = self.transmit(&key, message, terms, patience.answer)?;
        let (word, _): (GoalAnswer, _) =
            wire::split_line("answer", &body).map_err(|err| unreadable(&key, &err))?;
        let is_old = match word {
            GoalAnswer::Rejected(rejection) if tries == 1 => {
                let _recorded = record.refused(id, &rejection);
                return Ok(GoalResult::Report(Report::rejected(id, rejection)));
            }
            // An earlier transmission may have been accepted.
            GoalAnswer::Rejected(rejection) => {
                return match self.report(goal, id, robot, patience)? {
                    RecoveryResult::Report(report) => Ok(GoalResult::Report(report)),
                    RecoveryResult::NeverTaken => {
                        Ok(GoalResult::Report(Report::rejected(id, rejection)))
                    }
                    RecoveryResult::Untrusted(report) => {
                        Err(UnknownOutcome::Untrusted(report.message))
                    }
                    RecoveryResult::NoAnswer(message) => Err(UnknownOutcome::NoAnswer(message)),
                };
            }
            // A goal sent more than once may be known from its first transmission.
            GoalAnswer::Accepted { known } => known && tries == 1,
        };
        // Without this record the goal counts as sent, which frees it no more than an accepted one while the
        // cell knows it.
        let _recorded = record.accepted(id, &acceptance);
        if !is_old {
            self.show(message);
        }
        match self.report(goal, id, robot, patience)? {
            RecoveryResult::Report(report) if is_old => Ok(GoalResult::EarlierReport(report)),
            RecoveryResult::Report(report) => Ok(GoalResult::Report(report)),
            RecoveryResult::NeverTaken => Err(UnknownOutcome::Untrusted(
                "the cell accepted the goal and now denies it".to_owned(),
            )),
            RecoveryResult::Untrusted(report) => Err(UnknownOutcome::Untrusted(report.message)),
            RecoveryResult::NoAnswer(message) => Err(UnknownOutcome::NoAnswer(message)),
        }
    }

    /// Transmits a goal until it is answered; returns the answer, itself and as it is kept, and the number of
    /// transmissions. Before each but the first the terms are checked again.
    fn transmit(
        &self,
        key: &str,
        message: &GoalMessage,
        terms: &Terms,
        timeout: Duration,
    ) -> Result<(Vec<u8>, Acceptance, u32), UnknownOutcome> {
        let unheard = |err: CellError| UnknownOutcome::NoAnswer(after_sending(err));
        let deadline = Instant::now() + timeout;
        for (round, until) in Rounds::new(timeout) {
            let question = Question::new(key, "", &message.bytes).map_err(CellError::Random);
            let question = question.map_err(unheard)?;
            let answers = self.put(&question, &message.bytes, MAX_ANSWER_BYTES, until);
            let answers = answers.map_err(unheard)?;
            if let Some(body) = self.only(key, &answers)? {
                let raw = answers.first().map(Answer::to_bytes).unwrap_or_default();
                return Ok((body.to_vec(), Acceptance::new(&question, raw), round));
            }
            if Instant::now() < until {
                thread::sleep(PAUSE);
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            let now = match self.capabilities(left) {
                Err(CellError::NoAnswer { .. }) => break,
                now => now,
            };
            let checked = now.and_then(|now| terms.check(&now));
            checked.map_err(|err| {
                UnknownOutcome::NoAnswer(format!(
                    "{}; it was not sent a second time",
                    after_sending(err)
                ))
            })?;
        }
        Err(silence("goal", timeout))
    }

    /// Queries a report until it arrives: with a short timeout per query, because query and answer
    /// may both be lost. Gives up early if the cell does not even answer the capabilities query. A report
    /// that does not arrive though the motion is over is taken without its samples.
    fn report(
        &self,
        goal: &Goal,
        goal_id: &str,
        robot: &[Joint],
        patience: Patience,
    ) -> Result<RecoveryResult, UnknownOutcome> {
        let key = self.keys.result(goal_id);
        let deadline = Instant::now() + patience.result;
        let mut heard = Instant::now();
        let mut unread_n = 0;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(silence("result", patience.result));
            }
            if heard.elapsed() > patience.answer {
                return Err(silence("result", patience.answer));
            }
            // A report that is there may take its time.
            let wait = if unread_n > 0 {
                patience.answer
            } else {
                QUERY_TIMEOUT
            };
            if let Some(body) =
                self.ask_report(&key, "", MAX_REPORT_BYTES, Instant::now() + left.min(wait))?
            {
                if let Ok((Acknowledgment::NeverTaken, _)) = wire::split_line("answer", &body) {
                    return Ok(RecoveryResult::NeverTaken);
                }
                let report =
                    UncheckedReport::from_bytes(&body).map_err(|err| unreadable(&key, &err))?;
                let checked = report.check(goal_id, goal, robot);
                return checked
                    .map(RecoveryResult::Report)
                    .map_err(|contradiction| {
                        UnknownOutcome::Untrusted(format!(
                            "its report contradicts itself: {}",
                            plain_line(&contradiction.to_string())
                        ))
                    });
            }
            match self.executing(left.min(QUERY_TIMEOUT))? {
                None => thread::sleep(PAUSE.min(left)),
                Some(executing) => {
                    heard = Instant::now();
                    if executing != goal_id {
                        unread_n += 1;
                        thread::sleep(QUERY_TIMEOUT.min(left));
                    }
                }
            }
            if unread_n == REPORT_TRIES {
                return self.report_without_samples(goal_id, &key, patience.answer);
            }
        }
    }

    /// Returns the goal that the cell executes, if it answers.
    fn executing(&self, timeout: Duration) -> Result<Option<String>, UnknownOutcome> {
        let key = self.keys.capabilities();
        let body = self.ask_report(&key, "", MAX_ANSWER_BYTES, Instant::now() + timeout)?;
        let Some(body) = body else {
            return Ok(None);
        };
        let found = wire::split_line::<Capabilities>("capabilities", &body);
        let (found, _) = found.map_err(|err| unreadable(&key, &err))?;
        Ok(Some(found.executing))
    }

    /// Takes the first line of a report whose samples do not arrive.
    fn report_without_samples(
        &self,
        goal_id: &str,
        key: &str,
        timeout: Duration,
    ) -> Result<RecoveryResult, UnknownOutcome> {
        let body = self.ask_report(
            key,
            "samples=none",
            MAX_ANSWER_BYTES,
            Instant::now() + timeout,
        )?;
        let Some(body) = body else {
            return Err(UnknownOutcome::NoAnswer(format!(
                "its report did not arrive, and its outcome without samples neither; a report longer than {} \
                 MiB is not read",
                MAX_REPORT_BYTES >> 20
            )));
        };
        let report = UncheckedReport::without_samples(&body, goal_id, MAX_REPORT_BYTES);
        report
            .map(RecoveryResult::Report)
            .map_err(|err| unreadable(key, &err))
    }

    /// Sends a query once about a goal that was sent; returns the cell's answer, if there is one.
    fn ask_report(
        &self,
        key: &str,
        parameters: &str,
        most: usize,
        until: Instant,
    ) -> Result<Option<Vec<u8>>, UnknownOutcome> {
        let question = Question::new(key, parameters, &[]).map_err(CellError::Random);
        let answers = question
            .and_then(|question| self.put(&question, &[], most, until))
            .map_err(|err| UnknownOutcome::NoAnswer(after_sending(err)))?;
        Ok(self.only(key, &answers)?.map(ToOwned::to_owned))
    }

    /// Publishes an accepted goal for watchers, who may miss it.
    fn show(&self, goal: &GoalMessage) {
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
        self.sole(answers).map_err(|who| match sole_journal(answers) {
            Some(journal) if self.is_the_cell(journal) && answers.len() > 1 => {
                UnknownOutcome::Untrusted(format!(
                    "the cell contradicts itself: {} different answers to key `{key}` by journal {}",
                    answers.len(),
                    short(journal)
                ))
            }
            _ => UnknownOutcome::NoAnswer(format!(
                "a party other than the cell answers to key `{key}`: {who}"
            )),
        })
    }

    /// Returns the cell's answer, if there is one; fails with the names of all parties that
    /// answered if there are others.
    fn sole<'a>(&self, answers: &'a [Answer]) -> Result<Option<&'a [u8]>, String> {
        match answers {
            [] => Ok(None),
            [Answer::Signed { journal, body, .. }] if self.is_the_cell(journal) => Ok(Some(body)),
            others => Err(who(others)),
        }
    }

    fn is_the_cell(&self, journal: &str) -> bool {
        self.journal.get().is_none_or(|known| known == journal)
    }

    /// Fails if an answer, signed in whatever way, is that of a cell of another version.
    fn check_version(&self, answer: &[u8]) -> Result<(), CellError> {
        let after_signature = answer.splitn(2, |&byte| byte == b'\n').nth(1);
        let lines = [Some(answer), after_signature].into_iter().flatten();
        let mut versions =
            lines.filter_map(|line| wire::split_line::<Version>("capabilities", line).ok());
        match versions.next() {
            Some((Version { protocol }, _)) if protocol != u64::from(PROTOCOL) => {
                Err(CellError::Protocol {
                    endpoint: self.endpoint.clone(),
                    expected: PROTOCOL,
                    found: protocol,
                    transmission: Transmission::None,
                })
            }
            Some(_) | None => Ok(()),
        }
    }

    /// Repeats a query until it is answered or `timeout` elapses.
    fn ask(&self, key: &str, timeout: Duration) -> Result<Vec<Answer>, CellError> {
        for (_, until) in Rounds::new(timeout) {
            let question = Question::new(key, "", &[]).map_err(CellError::Random)?;
            let answers = self.put(&question, &[], MAX_ANSWER_BYTES, until)?;
            if !answers.is_empty() {
                return Ok(answers);
            }
            thread::sleep(PAUSE);
        }
        Ok(Vec::new())
    }

    /// Sends a query once; returns the answers that arrived in time, possibly none.
    fn put(
        &self,
        question: &Question,
        payload: &[u8],
        most: usize,
        deadline: Instant,
    ) -> Result<Vec<Answer>, CellError> {
        let replies = self
            .session
            .get(question.selector())
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

/// The rounds of a repeated query, each with its number from 1 and the time until which it waits: the first one
/// gets most of the time, because an answer may only be late.
struct Rounds {
    deadline: Instant,
    piece: Duration,
    round: u32,
}

impl Rounds {
    fn new(timeout: Duration) -> Self {
        Self {
            deadline: Instant::now() + timeout,
            piece: timeout / 2,
            round: 0,
        }
    }
}

impl Iterator for Rounds {
    type Item = (u32, Instant);

    fn next(&mut self) -> Option<(u32, Instant)> {
        let left = self.deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return None;
        }
        let until = Instant::now() + left.min(self.piece.max(QUERY_TIMEOUT));
        self.piece /= 2;
        self.round += 1;
        Some((self.round, until))
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
    let wrong = |ahead_s: f64| {
        Err(CellError::Clock {
            ahead_s,
            transmission: Transmission::None,
        })
    };
    if cell_ms > answered_ms.saturating_add(CLOCKS_MS) {
        return wrong(seconds(cell_ms - answered_ms));
    }
    if cell_ms < asked_ms.saturating_sub(CLOCKS_MS) {
        return wrong(-seconds(asked_ms - cell_ms));
    }
    Ok(())
}

/// Returns the one journal that signs all these answers, if there is one.
fn sole_journal(answers: &[Answer]) -> Option<&str> {
    let mut journals = answers.iter().map(|answer| match answer {
        Answer::Signed { journal, .. } => Some(journal.as_str()),
        Answer::OfOtherBytes { .. } | Answer::Unsigned(_) | Answer::Long(_) => None,
    });
    let first = journals.next()??;
    journals
        .all(|journal| journal == Some(first))
        .then_some(first)
}

/// Returns an error of a query after a goal was sent, with its causes on one line.
fn after_sending(err: CellError) -> String {
    with_causes(&err.after_transmission())
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
            Err(CellError::Clock { ahead_s, .. }) => Some(ahead_s),
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
