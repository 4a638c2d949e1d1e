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
    requests: Mutex<Requests>,
    heartbeat_timeout: Option<Duration>,
}

struct Requests {
    /// The goal to cancel.
    cancel: Option<String>,
    /// Whether the cell is stopped until a person resumes it.
    stopped: bool,
    /// The dispatcher of the current goal: only its heartbeats count.
    dispatcher: String,
    /// Time of its last heartbeat.
    heard: Instant,
    /// Queries to answer when nothing moves any more.
    awaiting_stop: Vec<Query>,
}

impl Control {
    /// Creates a control with a heartbeat timeout, if any.
    pub(super) fn new(heartbeat_timeout: Option<Duration>) -> Self {
        Self {
            requests: Mutex::new(Requests {
                cancel: None,
                stopped: false,
                dispatcher: String::new(),
                heard: Instant::now(),
                awaiting_stop: Vec::new(),
            }),
            heartbeat_timeout,
        }
    }

    /// Starts a goal's heartbeat timeout.
    pub(super) fn begin(&self, dispatcher: &str) {
        let mut requests = self.requests();
        requests.cancel = None;
        dispatcher.clone_into(&mut requests.dispatcher);
        requests.heard = Instant::now();
    }

    /// Records a heartbeat.
    pub(super) fn beat(&self, dispatcher: &str) {
        let mut requests = self.requests();
        if requests.dispatcher == dispatcher {
            requests.heard = Instant::now();
        }
    }

    /// Cancels a goal; `query` is answered when its motion has stopped.
    pub(super) fn cancel(&self, goal_id: &str, query: Query) {
        let mut requests = self.requests();
        requests.cancel = Some(goal_id.to_owned());
        requests.awaiting_stop.push(query);
    }

    /// Aborts the current motion and refuses further goals; returns the query to be answered now if
    /// nothing moves.
    pub(super) fn stop(&self, query: Query, executing: Option<&str>) -> Option<Query> {
        let mut requests = self.requests();
        requests.stopped = true;
        if let Some(goal_id) = executing {
            // Holds even if a resume comes before the motion's next check.
            requests.cancel = Some(goal_id.to_owned());
            requests.awaiting_stop.push(query);
            return None;
        }
        Some(query)
    }

    /// Accepts goals again.
    pub(super) fn resume(&self) {
        self.requests().stopped = false;
    }

    /// Returns whether the cell is stopped.
    pub(super) fn is_stopped(&self) -> bool {
        self.requests().stopped
    }

    /// Returns why a goal must be aborted now, if it must.
    pub(super) fn reason(&self, goal_id: &str) -> Option<Abort> {
        let requests = self.requests();
        if requests.stopped {
            return Some(Abort::by_a_person("stopped"));
        }
        if requests.cancel.as_deref() == Some(goal_id) {
            return Some(Abort::by_a_person("canceled"));
        }
        let silent = requests.heard.elapsed();
        let timeout = self.heartbeat_timeout?;
        (silent > timeout).then(|| Abort {
            outcome: Outcome::Aborted,
            message: format!(
                "no heartbeat of the dispatcher for {:.2} s",
                silent.as_secs_f64()
            ),
        })
    }

    /// Takes the queries to answer when nothing moves any more.
    pub(super) fn awaiting_stop(&self) -> Vec<Query> {
        std::mem::take(&mut self.requests().awaiting_stop)
    }

    fn requests(&self) -> MutexGuard<'_, Requests> {
        lock(&self.requests)
    }
}
