//! A cell's answers.

use std::{sync::mpsc, time::Instant};

use zenoh::{Wait, query::Query};

use super::{
    Fault, Shared,
    fault::GARBLED,
    journal::{Job, Lookup},
    lock,
};
use crate::{
    Goal, GoalMessage, PROTOCOL, PublicKey, Rejection, RejectionCode,
    acceptance::{MAX_GOAL_BYTES, check_length},
    capabilities::{Acknowledgment, Capabilities, GoalAnswer},
    keys::goal_id_of,
    message::now_unix_ms,
    signature::Question,
    text::plain_line,
    wire,
};

/// Returns the first number of a query: `?from=N`, 0 if absent.
pub(super) fn requested_from(query: &Query) -> u64 {
    let from = query.parameters().get("from").unwrap_or_default();
    from.parse().unwrap_or_default()
}

impl Shared {
    /// Answers a query; errors are ignored because the asker may be gone.
    pub(super) fn reply(&self, query: &Query, body: &[u8]) {
        let bytes = self.key.answer(&Question::of(query), body);
        let _sent = query.reply(query.key_expr(), bytes).wait();
    }

    /// Answers with a report: with its first line alone where the query has `samples=none`.
    pub(super) fn reply_report(&self, query: &Query, report: &[u8]) {
        let is_short = query.parameters().get("samples") == Some("none");
        let line = report.split_inclusive(|&byte| byte == b'\n').next();
        match line.filter(|_| is_short) {
            Some(line) => self.reply(query, line),
            None => self.reply(query, report),
        }
    }

    /// Answers with a word.
    pub(super) fn acknowledge(&self, query: &Query, acknowledgment: Acknowledgment) {
        self.reply(query, &wire::line(&acknowledgment));
    }

    pub(super) fn capabilities(&self) -> Capabilities {
        let machine = &self.description;
        Capabilities {
            protocol: PROTOCOL,
            cell: self.keys.name().to_owned(),
            journal: self.key.name().to_owned(),
            clock_unix_ms: now_unix_ms(),
            simulated: machine.simulated,
            stopped: self.control.is_stopped(),
            executing: lock(&self.journal)
                .executing()
                .unwrap_or_default()
                .to_owned(),
            robot: machine.robot.clone(),
            controllers: machine.controllers.clone(),
            palm: machine.palm,
            table_from_base: machine.table_from_base,
            max_goal_bytes: MAX_GOAL_BYTES,
            gap: machine.gap.clone(),
            real_time: self.real_time,
            silence_s: machine.silence.map(|silence| silence.as_secs_f64()),
        }
    }

    /// Answers a goal.
    pub(super) fn goal(&self, query: &Query, jobs: &mpsc::Sender<Job>) {
        self.faults.goal();
        let payload = query.payload().map(|payload| payload.to_bytes());
        let (answer, job) = self.take(&payload.unwrap_or_default());
        self.faults.die(Fault::DieBeforeAnswer);
        self.faults.delay();
        let answer = if self.faults.strikes(Fault::GarbledAnswer) {
            GARBLED.to_vec()
        } else {
            wire::line(&answer)
        };
        let silent = self.faults.lasts(Fault::NeverAnswer);
        if silent {
            lock(&self.unanswered).push(query.clone());
        } else if !self.faults.strikes(Fault::LoseAnswer) {
            self.reply(query, &answer);
        }
        if !silent && self.faults.strikes(Fault::DoubleAnswer) {
            self.reply(query, &answer);
        }
        self.faults.die(Fault::DieAfterAnswer);
        if let Some(job) = job {
            // The worker ends only after the last queryable, whose callback this is.
            let _queued = jobs.send(job);
        }
    }

    /// Accepts or refuses a goal; a goal accepted before stays known, whatever has changed since.
    fn take(&self, bytes: &[u8]) -> (GoalAnswer, Option<Job>) {
        let received = Instant::now();
        let opened = check_length(bytes).and_then(|()| GoalMessage::decode(bytes));
        let admitted = opened.and_then(|(message, goal)| {
            let (digest, until) = (message.digest.clone(), message.address.valid_until_unix_ms);
            self.admit(message, goal, received).inspect_err(|refusal| {
                // These do not change while the cell runs, and any party can cause them.
                let is_fixed = matches!(
                    refusal.code,
                    RejectionCode::Address | RejectionCode::Dispatcher
                );
                if !is_fixed {
                    lock(&self.refused).keep(digest, until, refusal);
                }
            })
        });
        match admitted {
            Ok(Some(job)) => (GoalAnswer::Accepted { known: false }, Some(job)),
            Ok(None) => (GoalAnswer::Accepted { known: true }, None),
            Err(rejection) => (GoalAnswer::Rejected(rejection), None),
        }
    }

    /// Checks that a new goal comes from a dispatcher of this cell, and that it may move what the cell moves.
    fn check_permission(&self, message: &GoalMessage) -> Result<(), Rejection> {
        let key = &message.dispatcher_key;
        let is_known = |known: &PublicKey| known.as_str() == key;
        if !self.dispatchers.is_empty() && !self.dispatchers.iter().any(is_known) {
            return Err(Rejection::new(
                RejectionCode::Dispatcher,
                format!("the cell takes no goals from the dispatcher with key {key}"),
            ));
        }
        if message.address.simulated_only && !self.description.simulated {
            let reason = "nothing real may move for this goal, and this cell is not simulated";
            return Err(Rejection::new(RejectionCode::Permission, reason.to_owned()));
        }
        Ok(())
    }

    /// Checks that a goal is for this cell and journal.
    fn check_address(&self, message: &GoalMessage) -> Result<(), Rejection> {
        let address = &message.address;
        let here = (self.keys.name(), self.key.name());
        if (address.cell.as_str(), address.journal.as_str()) != here {
            return Err(Rejection::new(
                RejectionCode::Address,
                format!(
                    "the goal is for cell `{}` with journal {}, this is `{}` with {}",
                    plain_line(&address.cell),
                    plain_line(&address.journal),
                    here.0,
                    here.1
                ),
            ));
        }
        Ok(())
    }

    /// Journals a goal; returns it if it is to be executed now.
    fn admit(
        &self,
        message: GoalMessage,
        goal: Goal,
        received: Instant,
    ) -> Result<Option<Job>, Rejection> {
        self.check_address(&message)?;
        if lock(&self.journal).knows(&message.encoded.goal_id) {
            return Ok(None);
        }
        lock(&self.refused).check(&message)?;
        self.check_permission(&message)?;
        // Refuse before the checks, so that they cannot delay a motion.
        lock(&self.journal).is_free()?;
        self.machine.check(&goal)?;
        let mut journal = lock(&self.journal);
        // Of two copies the other may have been refused meanwhile.
        lock(&self.refused).check(&message)?;
        if self.control.is_stopped() {
            let reason = "the cell was stopped and has not been resumed";
            return Err(Rejection::new(RejectionCode::Stopped, reason.to_owned()));
        }
        message.address.check_time(now_unix_ms())?;
        if !journal.admit(&message)? {
            return Ok(None);
        }
        self.control.begin(&message.address.dispatcher);
        Ok(Some(Job {
            encoded: message.encoded,
            goal,
            received,
        }))
    }

    /// Answers with a goal's report, now or when its motion ends.
    pub(super) fn result(&self, query: Query) {
        if self.faults.lasts(Fault::NeverAnswer) {
            lock(&self.unanswered).push(query);
            return;
        }
        if self.faults.strikes(Fault::LoseResult) {
            return;
        }
        let id = goal_id_of(query.key_expr().as_str()).map(ToOwned::to_owned);
        let answer = lock(&self.journal).ask(id.as_deref().unwrap_or_default(), query);
        match answer {
            Lookup::Kept => {}
            Lookup::Over(query, report) => self.reply_report(&query, &report),
            Lookup::NeverTaken(query) => self.acknowledge(&query, Acknowledgment::NeverTaken),
        }
    }

    /// Cancels a goal, and answers when its motion has stopped.
    pub(super) fn cancel(&self, query: Query) {
        let id = goal_id_of(query.key_expr().as_str()).map(ToOwned::to_owned);
        let id = id.unwrap_or_default();
        let journal = lock(&self.journal);
        if journal.executing() == Some(&id) {
            self.control.cancel(&id, query);
        } else if journal.knows(&id) {
            self.acknowledge(&query, Acknowledgment::Over);
        } else {
            self.acknowledge(&query, Acknowledgment::NeverTaken);
        }
    }

    /// Aborts the current motion and refuses further goals.
    pub(super) fn stop(&self, query: Query) {
        let journal = lock(&self.journal);
        if let Some(query) = self.control.stop(query, journal.executing()) {
            self.acknowledge(&query, Acknowledgment::Done);
        }
    }
}
