//! The motion in execution, for graceful shutdown: a robot is not left unattended.

use std::{
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError},
    thread,
    time::{Duration, Instant},
};

use cell::{CellClient, ControlReply, with_causes};

/// Pause before canceling again at a cell that has not accepted the motion yet.
const PAUSE: Duration = Duration::from_millis(50);

static IN_FLIGHT: Mutex<InFlight> = Mutex::new(InFlight {
    is_ending: false,
    motions: Vec::new(),
});
static CHANGED: Condvar = Condvar::new();

/// Motions in flight, and whether more may be sent.
struct InFlight {
    /// Whether the program is shutting down: nothing more is sent.
    is_ending: bool,
    motions: Vec<MotionInFlight>,
}

/// A motion that was sent to a cell and may move its robot.
#[derive(Clone)]
pub struct MotionInFlight {
    client: Arc<CellClient>,
    candidate_id: String,
    cell: String,
    goal_id: String,
    answer: Duration,
}

/// The outcome of a cancel request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Cancellation {
    /// The cell has confirmed that the motion has stopped.
    Stopped,
    /// The motion had already ended.
    Over,
    /// Unknown for this reason: the robot may be moving.
    Unknown(String),
}

/// Returns this process's motions in execution and blocks all further sending, for shutdown.
pub fn stop_sending() -> Vec<MotionInFlight> {
    let mut in_flight = in_flight();
    in_flight.is_ending = true;
    in_flight.motions.clone()
}

impl MotionInFlight {
    /// Describes a motion that is about to be sent; `answer` is the cell's answer timeout.
    pub(crate) fn new(
        client: &Arc<CellClient>,
        candidate_id: &str,
        cell: &str,
        goal_id: &str,
        answer: Duration,
    ) -> Self {
        Self {
            client: Arc::clone(client),
            candidate_id: candidate_id.to_owned(),
            cell: cell.to_owned(),
            goal_id: goal_id.to_owned(),
            answer,
        }
    }

    /// Runs `send_and_wait`, which sends this motion and waits for its end. Blocks before or after
    /// it during shutdown, which waits for this motion alone.
    pub(crate) fn execute<T>(self, send_and_wait: impl FnOnce() -> T) -> T {
        let id = self.goal_id.clone();
        unless_ending(|in_flight| in_flight.motions.push(self));
        let done = send_and_wait();
        in_flight().motions.retain(|motion| motion.goal_id != id);
        CHANGED.notify_all();
        unless_ending(|_| {});
        done
    }

    /// Returns the motion's name.
    pub fn candidate_id(&self) -> &str {
        &self.candidate_id
    }

    /// Returns the cell's name.
    pub fn cell(&self) -> &str {
        &self.cell
    }

    /// Returns the goal's id.
    pub fn goal_id(&self) -> &str {
        &self.goal_id
    }

    /// Returns the timeout of a cancellation.
    pub fn answer_timeout(&self) -> Duration {
        self.answer
    }

    /// Cancels the motion, waits for the cell's answer, and then until the outcome is recorded, if
    /// that is in time.
    pub fn cancel(&self) -> Cancellation {
        let deadline = Instant::now() + self.answer;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            let halt = self.client.cancel(&self.goal_id, left);
            match halt {
                Ok(ControlReply::Done) => {
                    self.wait(deadline);
                    return Cancellation::Stopped;
                }
                Ok(ControlReply::AlreadyEnded) => {
                    self.wait(deadline);
                    return Cancellation::Over;
                }
                // The goal may be in transit, and the cell may refuse it.
                Ok(ControlReply::UnknownGoal) => {
                    if self.wait(Instant::now() + PAUSE) {
                        return Cancellation::Over;
                    }
                    if Instant::now() > deadline {
                        let message = "the cell has not said whether it takes it".to_owned();
                        return Cancellation::Unknown(message);
                    }
                }
                Ok(ControlReply::NoAnswer) => {
                    let message = format!("no answer within {:.1?}", self.answer);
                    return Cancellation::Unknown(message);
                }
                Err(err) => return Cancellation::Unknown(with_causes(&err)),
            }
        }
    }

    /// Waits until the motion has ended and its outcome is recorded; returns whether it has.
    fn wait(&self, deadline: Instant) -> bool {
        let mut in_flight = in_flight();
        while in_flight
            .motions
            .iter()
            .any(|motion| motion.goal_id == self.goal_id)
        {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return false;
            }
            let waited = CHANGED.wait_timeout(in_flight, left);
            in_flight = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
        true
    }
}

/// Runs `then`; during shutdown, the thread sleeps instead.
fn unless_ending(then: impl FnOnce(&mut InFlight)) {
    let mut in_flight = in_flight();
    if !in_flight.is_ending {
        then(&mut in_flight);
        return;
    }
    drop(in_flight);
    loop {
        thread::park();
    }
}

fn in_flight() -> MutexGuard<'static, InFlight> {
    IN_FLIGHT.lock().unwrap_or_else(PoisonError::into_inner)
}
