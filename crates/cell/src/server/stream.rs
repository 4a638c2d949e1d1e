//! The stream of a cell's measurements: numbered over its whole life, the newest part kept for
//! watchers that join late or lose samples.

use std::{
    collections::VecDeque,
    sync::{
        Mutex,
        atomic::{AtomicBool, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

use zenoh::{
    Session, Wait,
    pubsub::Publisher,
    qos::{CongestionControl, Priority},
};

use super::lock;
use crate::{
    Keys, Machine,
    report::Sample,
    wire::{self, StateHeader},
};

/// Sampling period.
pub(super) const PERIOD: Duration = Duration::from_millis(10);

/// Longest delay that the stream catches up.
const MAX_CATCH_UP: Duration = Duration::from_secs(1);

/// Number of samples kept: thirty seconds of them.
const KEPT: usize = 3000;

/// Samples per answer to a history query: about 200 kB.
const CHUNK: usize = 512;

/// The stream of a cell.
pub(super) struct Stream {
    epoch: String,
    joints: Vec<String>,
    /// Watchers may lose samples: a motion's are all in its report.
    publisher: Publisher<'static>,
    state: Mutex<StreamState>,
}

struct StreamState {
    /// Number of the next sample.
    seq: u64,
    /// The executing goal; empty if nothing moves.
    goal_id: String,
    /// The latest measurement, as a row; empty before the first.
    measured: Vec<f64>,
    kept: VecDeque<KeptSample>,
}

struct KeptSample {
    seq: u64,
    goal_id: String,
    row: Vec<f64>,
}

impl Stream {
    /// Starts the stream `epoch` of a cell.
    pub(super) fn new(
        session: &Session,
        keys: &Keys,
        epoch: String,
        joints: Vec<String>,
    ) -> Result<Self, zenoh::Error> {
        Ok(Self {
            epoch,
            joints,
            // Drop a sample that would have to wait: the next one is as good, and none queues
            // behind bulk data.
            publisher: session
                .declare_publisher(keys.state())
                .congestion_control(CongestionControl::Drop)
                .priority(Priority::InteractiveHigh)
                .wait()?,
            state: Mutex::new(StreamState {
                seq: 0,
                goal_id: String::new(),
                measured: Vec::new(),
                kept: VecDeque::with_capacity(KEPT),
            }),
        })
    }

    /// Records a measurement during a goal.
    pub(super) fn measure(&self, goal_id: &str, sample: &Sample) {
        let mut state = lock(&self.state);
        if state.goal_id != goal_id {
            goal_id.clone_into(&mut state.goal_id);
        }
        state.measured = sample.to_row();
    }

    /// Records that nothing moves any more.
    pub(super) fn rest(&self) {
        lock(&self.state).goal_id.clear();
    }

    /// Measures a machine that executes nothing, and publishes; nothing if it has no measurement.
    fn publish_idle(&self, machine: &dyn Machine) {
        let executes = !lock(&self.state).goal_id.is_empty();
        if executes {
            return self.publish();
        }
        let Some(measured) = machine.measure() else {
            return;
        };
        {
            let mut state = lock(&self.state);
            if state.goal_id.is_empty() {
                state.measured = measured.to_row();
            }
        }
        self.publish();
    }

    /// Publishes the latest measurement.
    pub(super) fn publish(&self) {
        let mut state = lock(&self.state);
        let next = KeptSample {
            seq: state.seq,
            goal_id: state.goal_id.clone(),
            row: state.measured.clone(),
        };
        let bytes = self.chunk(next.seq, &next.goal_id, std::iter::once(&next));
        state.seq += 1;
        if state.kept.len() == KEPT {
            state.kept.pop_front();
        }
        state.kept.push_back(next);
        // Publish under the lock, to keep the order of the numbers.
        let _published = self.publisher.put(bytes).wait();
    }

    /// Publishes the latest measurement at the stream's rate until the cell ends.
    pub(super) fn run(&self, machine: &dyn Machine, ended: &AtomicBool) {
        let mut next = Instant::now();
        while !ended.load(Ordering::Relaxed) {
            self.publish_idle(machine);
            next += PERIOD;
            let now = Instant::now();
            thread::sleep(next.saturating_duration_since(now));
            // A busy machine catches up, so that numbers follow the time; a suspended one does not.
            if now.saturating_duration_since(next) > MAX_CATCH_UP {
                next = now;
            }
        }
    }

    /// Returns samples of one goal from a number on: at most one answer's worth, possibly none.
    pub(super) fn since(&self, from: u64) -> Vec<u8> {
        let state = lock(&self.state);
        let begin = state.kept.partition_point(|kept| kept.seq < from);
        let mut rows = state.kept.range(begin..).peekable();
        let Some(first) = rows.peek() else {
            return self.chunk(state.seq, &state.goal_id, std::iter::empty());
        };
        let (seq, goal_id) = (first.seq, first.goal_id.as_str());
        let rows = rows.take_while(|kept| kept.goal_id == goal_id).take(CHUNK);
        self.chunk(seq, goal_id, rows)
    }

    fn chunk<'a>(
        &self,
        seq: u64,
        goal_id: &str,
        rows: impl Iterator<Item = &'a KeptSample>,
    ) -> Vec<u8> {
        let mut bytes = wire::line(&StateHeader {
            epoch: self.epoch.clone(),
            goal_id: goal_id.to_owned(),
            seq,
            joints: self.joints.clone(),
        });
        for kept in rows {
            wire::push_numbers(&mut bytes, kept.row.iter().copied());
        }
        bytes
    }
}
