//! What may break a motion off: a person's word, or silence.

use std::{
    sync::{Mutex, MutexGuard},
    time::{Duration, Instant},
};

use schemas::executions::Outcome;
use zenoh::query::Query;

use super::lock;

/// Why a motion is broken off.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BrokenOff {
    /// What that makes of it: `stopped` if a person wants it, `aborted` if the cell does.
    pub outcome: Outcome,
    /// The reason.
    pub message: String,
}

impl BrokenOff {
    fn by_a_person(message: &str) -> Self {
        Self {
            outcome: Outcome::Stopped,
            message: message.to_owned(),
        }
    }
}

/// What was asked of the motion in execution.
pub(super) struct Control {
    wish: Mutex<Wish>,
    silence: Option<Duration>,
}

struct Wish {
    /// The goal to be broken off.
    cancel: Option<String>,
    /// Whether nothing may move until a person says so.
    stopped: bool,
    /// The name in the heartbeats that count: that of the goal in execution.
    dispatcher: Option<String>,
    /// When that dispatcher was last heard.
    heard: Instant,
    /// Who wants to know that nothing moves any more.
    asking: Vec<Query>,
}

impl Control {
    /// Breaks motions off after so much silence, or never.
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

    /// A goal was taken: its dispatcher has just been heard.
    pub(super) fn begin(&self, dispatcher: Option<&str>) {
        let mut wish = self.wish();
        wish.cancel = None;
        wish.dispatcher = dispatcher.map(ToOwned::to_owned);
        wish.heard = Instant::now();
    }

    /// A dispatcher was heard.
    pub(super) fn beat(&self, dispatcher: &str) {
        let mut wish = self.wish();
        if wish.dispatcher.as_deref() == Some(dispatcher) {
            wish.heard = Instant::now();
        }
    }

    /// Has a goal broken off; `query` is answered when it is.
    pub(super) fn cancel(&self, goal_id: &str, query: Query) {
        let mut wish = self.wish();
        wish.cancel = Some(goal_id.to_owned());
        wish.asking.push(query);
    }

    /// Has whatever moves broken off and nothing more taken; returns the query to be answered now
    /// if nothing moves.
    pub(super) fn stop(&self, query: Query, executing: Option<&str>) -> Option<Query> {
        let mut wish = self.wish();
        wish.stopped = true;
        if let Some(goal_id) = executing {
            // Even if goals are taken again before this one looks.
            wish.cancel = Some(goal_id.to_owned());
            wish.asking.push(query);
            return None;
        }
        Some(query)
    }

    /// Has goals taken again.
    pub(super) fn resume(&self) {
        self.wish().stopped = false;
    }

    /// Returns whether nothing may move.
    pub(super) fn is_stopped(&self) -> bool {
        self.wish().stopped
    }

    /// Returns why a goal is to be broken off now, if it is.
    pub(super) fn reason(&self, goal_id: &str) -> Option<BrokenOff> {
        let wish = self.wish();
        if wish.stopped {
            return Some(BrokenOff::by_a_person("stopped"));
        }
        if wish.cancel.as_deref() == Some(goal_id) {
            return Some(BrokenOff::by_a_person("canceled"));
        }
        let silent = wish.heard.elapsed();
        let longest = self.silence?;
        (silent > longest).then(|| BrokenOff {
            outcome: Outcome::Aborted,
            message: format!(
                "no heartbeat of the dispatcher for {:.2} s",
                silent.as_secs_f64()
            ),
        })
    }

    /// Returns who wants to know that nothing moves any more.
    pub(super) fn asking(&self) -> Vec<Query> {
        std::mem::take(&mut self.wish().asking)
    }

    fn wish(&self) -> MutexGuard<'_, Wish> {
        lock(&self.wish)
    }
}
