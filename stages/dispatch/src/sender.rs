//! Sends goals, each at most once even if this process is killed, options change or the cell forgets.

use std::{cell::RefCell, collections::BTreeSet, sync::Arc};

use cell::{
    Acceptance, CLOCKS_MS, Capabilities, CellClient, CellError, Goal, GoalMessage, GoalResult,
    PalmTrajectory, Patience, RecordError, RecoveryResult, Rejection, RejectionCode, Report,
    SendRecord, Terms, check_palm, with_causes,
};
use dataflow::BoxedDiagnostic;
use robot::Joint;
use schemas::executions::Outcome;

use crate::{
    DispatchConfig, DispatchError,
    config::AfterUnknown,
    in_flight::MotionInFlight,
    ledger::{CellFacts, GoalHistory, Ledger, OpenGoal},
    refusal::Refusal,
};

/// Time of a goal's execution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ExecutedDuring {
    /// During this process.
    Now,
    /// Before.
    Before,
}

/// A goal that was sent, and its end.
#[derive(Debug)]
pub(crate) struct SentGoal {
    pub(crate) goal: Goal,
    pub(crate) report: Report,
    pub(crate) during: ExecutedDuring,
    /// What the cell said of itself when it was sent.
    pub(crate) cell: CellFacts,
}

/// The ledger, for a goal that was sent before: a refusal does not free it, for an earlier transmission may still
/// be under way.
struct Repetition<'a>(&'a Ledger);

impl SendRecord for Repetition<'_> {
    fn sending(
        &self,
        message: &GoalMessage,
        permitted_by: &Capabilities,
    ) -> Result<(), RecordError> {
        self.0.sending(message, permitted_by)
    }

    fn accepted(&self, goal_id: &str, acceptance: &Acceptance) -> Result<(), RecordError> {
        self.0.accepted(goal_id, acceptance)
    }

    fn refused(&self, _goal_id: &str, _why: &Rejection) -> Result<(), RecordError> {
        Ok(())
    }
}

/// Sends goals to one cell.
pub(crate) struct Sender<'a> {
    pub(crate) config: &'a DispatchConfig,
    pub(crate) client: &'a Arc<CellClient>,
    /// The terms under which goals may be sent.
    pub(crate) terms: &'a Terms,
    /// The robot's joints under the goals' names.
    pub(crate) joints: &'a [Joint],
    pub(crate) ledger: Ledger,
    /// Goals of earlier runs of which this run has learned that a person stopped them.
    pub(crate) stopped: RefCell<BTreeSet<String>>,
}

impl Sender<'_> {
    /// Learns the end of every goal that was sent to this cell, before anything is sent. A higher `attempt` than
    /// a goal's says that a person has looked: it may stay without an end.
    pub(crate) fn settle(&self) -> Result<(), BoxedDiagnostic> {
        for open in self.ledger.open_goals()? {
            let id = open.goal_id.clone();
            let candidate_id = open.goal.as_ref().map_or("?", |goal| &goal.candidate_id);
            let answer = self.config.answer_timeout();
            let motion = MotionInFlight::new(self.client, candidate_id, self.cell(), &id, answer);
            motion.execute(|| match &open.goal {
                Some(goal) if goal.attempt < self.config.attempt => {
                    let is_here = open.journal.as_ref() == Some(&self.terms.capabilities().journal);
                    let recover = || self.client.recover(&id, goal, self.joints, self.patience());
                    match is_here.then(recover) {
                        Some(RecoveryResult::Report(report)) => {
                            Ok(self.ledger.conclude(&report)?)
                        }
                        Some(_) | None => Ok(()),
                    }
                }
                goal => self.recover(goal.as_ref(), &open).map(drop),
            })?;
        }
        Ok(())
    }

    /// As [`Sender::execute`]; a motion stopped before this run is sent again as a new goal if
    /// the options say so. Returns the goal that ended.
    pub(crate) fn execute_or_resume(
        &self,
        goal: &Goal,
    ) -> Result<Result<SentGoal, Refusal>, BoxedDiagnostic> {
        let mut goal = goal.clone();
        loop {
            let sent = match self.execute(&goal)? {
                Ok(sent) => sent,
                refused => return Ok(refused),
            };
            if sent.report.outcome != Outcome::Stopped {
                return Ok(Ok(sent));
            }
            if sent.during == ExecutedDuring::Now {
                return Err(DispatchError::Stopped {
                    cell: self.cell().to_owned(),
                    candidate_id: goal.candidate_id,
                    goal_id: sent.report.goal_id,
                    message: sent.report.message,
                }
                .into());
            }
            if !self.config.resume_stopped {
                return Ok(Ok(sent));
            }
            goal.resumed += 1;
        }
    }

    /// Executes a goal, or queries its outcome if it was sent before.
    ///
    /// Without an answer, or with one that fails its checks, the run ends: nothing more is sent to
    /// this robot until a person has looked, and the next run queries the cell again.
    fn execute(&self, goal: &Goal) -> Result<Result<SentGoal, Refusal>, BoxedDiagnostic> {
        let id = goal.encode().goal_id;
        if let GoalHistory::Ended { report, cell } = self.ledger.history(&id)? {
            // One that a person stopped while this run waited for it is not sent again by this run.
            let during = if self.stopped.borrow().contains(&id) {
                ExecutedDuring::Now
            } else {
                ExecutedDuring::Before
            };
            return Ok(Ok(SentGoal {
                goal: goal.clone(),
                report: *report,
                during,
                cell,
            }));
        }
        if let Some(refusal) = self.refusal(goal) {
            return Ok(Err(refusal));
        }
        let answer = self.config.answer_timeout();
        let motion = MotionInFlight::new(self.client, &goal.candidate_id, self.cell(), &id, answer);
        motion.execute(|| self.send_or_recover(goal))
    }

    /// Returns why the cell's own limits forbid a motion, if they do.
    fn refusal(&self, goal: &Goal) -> Option<Refusal> {
        let limits = self.terms.capabilities().palm.as_ref()?;
        let PalmTrajectory::Palm(points) = &goal.carrier else {
            return None;
        };
        check_palm(points, limits).err().map(Refusal::Limits)
    }

    fn send_or_recover(&self, goal: &Goal) -> Result<Result<SentGoal, Refusal>, BoxedDiagnostic> {
        let id = goal.encode().goal_id;
        let sent = |report: Report, during: ExecutedDuring, cell: CellFacts| SentGoal {
            goal: goal.clone(),
            report,
            during,
            cell,
        };
        let repetition = Repetition(&self.ledger);
        let mut record: &dyn SendRecord = &self.ledger;
        if let GoalHistory::Open(open) = self.ledger.history(&id)? {
            if let Some(report) = self.recover(Some(goal), &open)? {
                let during = match report.outcome {
                    Outcome::Stopped => ExecutedDuring::Now,
                    _ => ExecutedDuring::Before,
                };
                return Ok(Ok(sent(report, during, open.cell)));
            }
            record = &repetition;
        }
        let result = self
            .client
            .execute(goal, self.terms, self.joints, self.patience(), record);
        let done = match result.map_err(|err| self.not_sent(goal, err))? {
            GoalResult::Report(report) => (report, ExecutedDuring::Now),
            GoalResult::EarlierReport(report) => (report, ExecutedDuring::Before),
            GoalResult::TooLong { bytes, most } => {
                return Ok(Err(Refusal::Long { bytes, most }));
            }
            GoalResult::Unknown(message) => {
                return Err(self
                    .record_unknown(&goal.candidate_id, &id, message)?
                    .into());
            }
        };
        let (report, during) = done;
        match &report.rejection {
            // One that leaves the goal open is not the last word on it.
            Some(rejection) if is_about_now(rejection) || self.is_open(&id)? => {
                return Err(DispatchError::NotNow {
                    cell: self.cell().to_owned(),
                    candidate_id: goal.candidate_id.clone(),
                    reason: rejection.reason.clone(),
                }
                .into());
            }
            Some(_) => {}
            None => self.conclude(goal, &report, false)?,
        }
        let facts = CellFacts::of(self.terms.capabilities());
        Ok(Ok(sent(report, during, facts)))
    }

    /// Asks the cell for the end of a goal that was sent before; nothing if it may be sent again, to this journal.
    fn recover(
        &self,
        goal: Option<&Goal>,
        open: &OpenGoal,
    ) -> Result<Option<Report>, BoxedDiagnostic> {
        let id = open.goal_id.as_str();
        let Some(goal) = goal else {
            let message = format!(
                "its record `effects/dispatch/cells/{}/{id}.goal` in the lake cannot be read; once a person has \
                 looked at the robot, remove it",
                self.cell()
            );
            return Err(self.record_unknown("?", id, message)?.into());
        };
        let here = &self.terms.capabilities().journal;
        // Another cell's `never_taken` says nothing about the cell that received the goal.
        if let Some(to) = open.journal.as_ref().filter(|to| *to != here) {
            let message = format!(
                "it was sent to the cell with journal `{to}`, the one that answers has `{here}`"
            );
            return Err(self.record_unknown(&goal.candidate_id, id, message)?.into());
        }
        match self.client.recover(id, goal, self.joints, self.patience()) {
            RecoveryResult::Report(report) => {
                self.conclude(goal, &report, open.told)?;
                if report.outcome == Outcome::Stopped {
                    self.stopped.borrow_mut().insert(id.to_owned());
                }
                Ok(Some(report))
            }
            // A person has been told, and asks again: it stays unknown.
            RecoveryResult::Untrusted(report) if open.told => {
                self.ledger.conclude(&report)?;
                Ok(Some(report))
            }
            RecoveryResult::Untrusted(report) => Err(self
                .record_unknown(&goal.candidate_id, id, report.message)?
                .into()),
            RecoveryResult::NeverTaken if !open.accepted => {
                let asked_ms = self.terms.capabilities().clock_unix_ms;
                // Until it expires it may still be under way to this journal.
                if asked_ms > open.valid_until_unix_ms.saturating_add(CLOCKS_MS) {
                    self.ledger.free(id)?;
                }
                Ok(None)
            }
            RecoveryResult::NeverTaken => {
                let message = match &open.earlier {
                    Some(outcome) => format!(
                        "version 4 of the protocol recorded it as `{outcome}`, and this cell does not know it"
                    ),
                    None => "the cell accepted it and now denies it".to_owned(),
                };
                Err(self.record_unknown(&goal.candidate_id, id, message)?.into())
            }
            RecoveryResult::NoAnswer(message) => {
                Err(self.record_unknown(&goal.candidate_id, id, message)?.into())
            }
        }
    }

    /// Records a report. One that says `unknown` ends the run instead, unless a run has ended because of it
    /// before, so that a person has been told, or the options say otherwise.
    fn conclude(&self, goal: &Goal, report: &Report, told: bool) -> Result<(), BoxedDiagnostic> {
        let goes_on = told || self.config.after_unknown == AfterUnknown::Continue;
        if report.outcome == Outcome::Unknown && !goes_on {
            let message = format!("the cell says so: {}", report.message);
            return Err(self
                .record_unknown(&goal.candidate_id, &report.goal_id, message)?
                .into());
        }
        Ok(self.ledger.conclude(report)?)
    }

    fn is_open(&self, goal_id: &str) -> Result<bool, BoxedDiagnostic> {
        Ok(matches!(
            self.ledger.history(goal_id)?,
            GoalHistory::Open(_)
        ))
    }

    /// Records that this run ends because an outcome is unknown, and returns the error.
    fn record_unknown(
        &self,
        candidate_id: &str,
        goal_id: &str,
        message: String,
    ) -> Result<DispatchError, BoxedDiagnostic> {
        self.ledger.mark_unknown(goal_id)?;
        Ok(unknown(
            self.cell(),
            candidate_id,
            goal_id.to_owned(),
            message,
        ))
    }

    /// Returns the error of a goal that could not be sent: nothing moved.
    fn not_sent(&self, goal: &Goal, err: CellError) -> DispatchError {
        match err {
            CellError::Stopped { .. } => DispatchError::NotNow {
                cell: self.cell().to_owned(),
                candidate_id: goal.candidate_id.clone(),
                reason: with_causes(&err),
            },
            err => err.into(),
        }
    }

    fn patience(&self) -> Patience {
        Patience {
            answer: self.config.answer_timeout(),
            result: self.config.result_timeout(),
        }
    }

    fn cell(&self) -> &str {
        &self.terms.capabilities().cell
    }
}

/// Returns the error for a motion with an unknown outcome.
pub(crate) fn unknown(
    cell: &str,
    candidate_id: &str,
    goal_id: String,
    message: String,
) -> DispatchError {
    DispatchError::Unknown {
        cell: cell.to_owned(),
        candidate_id: candidate_id.to_owned(),
        goal_id,
        message,
    }
}

/// Whether a refusal is about the cell's present state, or about anything but the motion: then the run ends, and
/// the motion may be accepted later.
fn is_about_now(rejection: &Rejection) -> bool {
    match rejection.code {
        RejectionCode::Busy
        | RejectionCode::Stopped
        | RejectionCode::Expired
        | RejectionCode::Clock
        | RejectionCode::Storage
        | RejectionCode::Dispatcher
        | RejectionCode::Address
        | RejectionCode::Permission
        | RejectionCode::Protocol
        | RejectionCode::Unlisted => true,
        RejectionCode::TooLarge
        | RejectionCode::Malformed
        | RejectionCode::Digest
        | RejectionCode::Robot
        | RejectionCode::Joints
        | RejectionCode::Limits
        | RejectionCode::Times
        | RejectionCode::Object => false,
    }
}
