//! The dispatcher's side: asks a cell what it can do, sends it goals, fetches the reports.

use std::{
    thread,
    time::{Duration, Instant},
};

use zenoh::{
    Session, Wait,
    qos::{CongestionControl, Priority},
    query::{ConsolidationMode, QueryTarget},
};

use crate::{
    CellError, Goal, Keys, PROTOCOL, SealedGoal,
    report::{Answer, Capabilities, Report},
    session, wire,
};

/// How often a question is repeated that no cell has heard: right after a cell reconnects, routers
/// may not know it yet and answer for nobody.
const TRIES: u32 = 3;
/// Pause between repetitions.
const PAUSE: Duration = Duration::from_millis(100);

/// A connection to one cell.
pub struct CellClient {
    session: Session,
    endpoint: String,
    keys: Keys,
}

impl CellClient {
    /// Connects to the endpoint of the cell `name`, e.g. `tcp/127.0.0.1:7447`.
    ///
    /// # Errors
    ///
    /// Fails if nothing listens there within `timeout`, or the name or endpoint is not one.
    pub fn connect(endpoint: &str, name: &str, timeout: Duration) -> Result<Self, CellError> {
        Ok(Self {
            keys: Keys::new(name)?,
            session: session::connect(endpoint, timeout)?,
            endpoint: endpoint.to_owned(),
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
        let answers = self.ask(&key, &[], QueryTarget::All, timeout)?;
        let [answer] = answers.as_slice() else {
            return Err(if answers.is_empty() {
                CellError::NoAnswer {
                    key,
                    endpoint: self.endpoint.clone(),
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
    /// then `result` for the end of the motion.
    ///
    /// Silence is reported as `Unknown`: the cell may have moved, and only a person can tell.
    ///
    /// # Errors
    ///
    /// Fails if the session is broken or an answer cannot be read.
    pub fn execute(
        &self,
        goal: &Goal,
        answer: Duration,
        result: Duration,
    ) -> Result<Report, CellError> {
        let sealed = goal.seal();
        let id = sealed.goal_id.as_str();
        let silence = |about: &str, waited: Duration| {
            let message = format!(
                "no answer about the {about} within {waited:.1?}; the robot may have moved"
            );
            Ok(Report::unknown(id, message))
        };
        let key = self.keys.goal();
        let answers = self.ask(&key, &sealed.bytes, QueryTarget::BestMatching, answer)?;
        let Some(bytes) = answers.first() else {
            return silence("goal", answer);
        };
        let (word, _): (Answer, _) = wire::split_line("answer", bytes)
            .map_err(|source| CellError::Answer { key, source })?;
        if let Answer::Rejected(rejection) = word {
            return Ok(Report::rejected(id, rejection));
        }
        self.show(&sealed)?;
        let key = self.keys.result(id);
        let answers = self.ask(&key, &[], QueryTarget::BestMatching, result)?;
        let Some(bytes) = answers.first() else {
            return silence("result", result);
        };
        Report::from_bytes(bytes).map_err(|source| CellError::Answer { key, source })
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

    /// Asks a question; returns what was answered within `timeout`, which may be nothing.
    fn ask(
        &self,
        key: &str,
        payload: &[u8],
        target: QueryTarget,
        timeout: Duration,
    ) -> Result<Vec<Vec<u8>>, CellError> {
        let deadline = Instant::now() + timeout;
        for _ in 0..TRIES {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            let replies = self
                .session
                .get(key)
                .payload(payload)
                .target(target)
                .consolidation(ConsolidationMode::None)
                // Commands wait for room rather than being dropped, and never behind bulk data.
                .congestion_control(CongestionControl::Block)
                .priority(Priority::RealTime)
                .timeout(left)
                .wait()
                .map_err(|source| CellError::Zenoh {
                    action: "ask the robot cell",
                    source: source.into(),
                })?;
            let mut answers = Vec::new();
            while let Ok(Some(reply)) = replies.recv_deadline(deadline) {
                // An error is a timeout told by a router, or a cell that knows no such goal.
                if let Ok(sample) = reply.into_result() {
                    answers.push(sample.payload().to_bytes().into_owned());
                }
            }
            if !answers.is_empty() {
                return Ok(answers);
            }
            thread::sleep(PAUSE.min(deadline.saturating_duration_since(Instant::now())));
        }
        Ok(Vec::new())
    }
}
