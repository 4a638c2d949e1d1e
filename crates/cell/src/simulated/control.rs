//! Causes for aborting a motion: a request, or a heartbeat timeout.

use std::{
    sync::{Mutex, MutexGuard},
    time::{Duration, Instant},
};

use schemas::executions::Outcome;
use zenoh::query::Query;

use super::lock;

/// Why a motion is aborted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Abort {
    /// The resulting outcome: `stopped` by a person's request, `aborted` by the cell.
    pub outcome: Outcome,
    /// The reason.
    pub message: String,
}

impl Abort {
    fn by_a_person(message: &str) -> Self {
        Self {
            outcome: Outcome::Stopped,
            message: message.to_owned(),
        }
    }
}

/// Requests concerning the current motion.
pub(super) struct Control {
    wish: Mutex<Wish>,
    silence: Option<Duration>,
}

struct Wish {
    /// The goal to cancel.
    cancel: Option<String>,
    /// Whether the cell is stopped until a person resumes it.
    stopped: bool,
    /// The dispatcher of the current goal: only its heartbeats count.
    dispatcher: Option<String>,
    /// Time of its last heartbeat.
    heard: Instant,
    /// Queries to answer when nothing moves any more.
    asking: Vec<Query>,
}

impl Control {
    /// Creates a control with a heartbeat timeout, if any.
    pub(super) fn new(silence: Option<Duration>) -> Self {
        Self {
            wish: Mutex::new(Wish {
                cancel: None,
                stopped: false,
                dispatcher: None,
                heard: Instant::now(),
                asking: Vec::new(),
            }),
            silence,
        }
    }

    /// Starts a goal's heartbeat timeout.
    pub(super) fn begin(&self, dispatcher: Option<&str>) {
        let mut wish = self.wish();
        wish.cancel = None;
        wish.dispatcher = dispatcher.map(ToOwned::to_owned);
        wish.heard = Instant::now();
    }

    /// Records a heartbeat.
    pub(super) fn beat(&self, dispatcher: &str) {
        let mut wish = self.wish();
        if wish.dispatcher.as_deref() == Some(dispatcher) {
            wish.heard = Instant::now();
        }
    }

    /// Cancels a goal; `query` is answered when its motion has stopped.
    pub(super) fn cancel(&self, goal_id: &str, query: Query) {
        let mut wish = self.wish();
        wish.cancel = Some(goal_id.to_owned());
        wish.asking.push(query);
    }

    /// Aborts the current motion and refuses further goals; returns the query to be answered now if
    /// nothing moves.
    pub(super) fn stop(&self, query: Query, executing: Option<&str>) -> Option<Query> {
        let mut wish = self.wish();
        wish.stopped = true;
        if let Some(goal_id) = executing {
            // Holds even if a resume comes before the motion's next check.
            wish.cancel = Some(goal_id.to_owned());
            wish.asking.push(query);
            return None;
        }
        Some(query)
    }

    /// Accepts goals again.
    pub(super) fn resume(&self) {
        self.wish().stopped = false;
    }

    /// Returns whether the cell is stopped.
    pub(super) fn is_stopped(&self) -> bool {
        self.wish().stopped
    }

    /// Returns why a goal must be aborted now, if it must.
    pub(super) fn reason(&self, goal_id: &str) -> Option<Abort> {
        let wish = self.wish();
        if wish.stopped {
            return Some(Abort::by_a_person("stopped"));
        }
        if wish.cancel.as_deref() == Some(goal_id) {
            return Some(Abort::by_a_person("canceled"));
        }
        let silent = wish.heard.elapsed();
        let longest = self.silence?;
        (silent > longest).then(|| Abort {
            outcome: Outcome::Aborted,
            message: format!(
                "no heartbeat of the dispatcher for {:.2} s",
                silent.as_secs_f64()
            ),
        })
    }

    /// Takes the queries to answer when nothing moves any more.
    pub(super) fn asking(&self) -> Vec<Query> {
        std::mem::take(&mut self.wish().asking)
    }

    fn wish(&self) -> MutexGuard<'_, Wish> {
        lock(&self.wish)
    }
}
