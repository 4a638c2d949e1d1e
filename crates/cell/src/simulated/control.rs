//! What may break a motion off: a person's word, or silence.

use std::{
    sync::{Mutex, MutexGuard},
    time::{Duration, Instant},
};

use zenoh::query::Query;

use super::lock;

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
    /// When a dispatcher was last heard.
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
                heard: Instant::now(),
                asking: Vec::new(),
            }),
            silence,
        }
    }

    /// A goal was taken: its dispatcher has just been heard.
    pub(super) fn begin(&self) {
        let mut wish = self.wish();
        wish.cancel = None;
        wish.heard = Instant::now();
    }

    /// A dispatcher was heard.
    pub(super) fn beat(&self) {
        self.wish().heard = Instant::now();
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
    pub(super) fn reason(&self, goal_id: &str) -> Option<String> {
        let wish = self.wish();
        if wish.stopped {
            return Some("stopped".to_owned());
        }
        if wish.cancel.as_deref() == Some(goal_id) {
            return Some("canceled".to_owned());
        }
        let silent = wish.heard.elapsed();
        let longest = self.silence?;
        (silent > longest).then(|| {
            format!(
                "no heartbeat of the dispatcher for {:.2} s",
                silent.as_secs_f64()
            )
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
