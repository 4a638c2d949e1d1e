//! What a cell measures, for those who watch: numbered over its whole life, the newest part kept for
//! whoever joins late or lost some.

use std::{
    collections::VecDeque,
    sync::{
        Mutex,
        atomic::{AtomicBool, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

use nalgebra::Isometry3;
use spatial::Pose;
use zenoh::{
    Session, Wait,
    pubsub::Publisher,
    qos::{CongestionControl, Priority},
};

use super::{Robot, lock};
use crate::{
    Keys,
    report::Sample,
    wire::{self, StateHeader},
};

/// Time between two samples.
pub(super) const PERIOD: Duration = Duration::from_millis(10);

/// How late the stream may be before what it missed is left out.
const STOOD_STILL: Duration = Duration::from_secs(1);

/// Samples that are kept: thirty seconds of them.
const KEPT: usize = 3000;

/// Samples in one answer to a question for those before: about 200 kB.
const CHUNK: usize = 512;

/// The stream of a cell.
pub(super) struct Stream {
    epoch: String,
    joints: Vec<String>,
    /// Whoever watches may lose samples: a motion's are all in its report.
    publisher: Publisher<'static>,
    shown: Mutex<Shown>,
}

struct Shown {
    /// Number of the next sample.
    seq: u64,
    /// The goal in execution; empty if nothing moves.
    goal_id: String,
    /// What was measured last, as a row.
    measured: Vec<f64>,
    kept: VecDeque<Kept>,
}

struct Kept {
    seq: u64,
    goal_id: String,
    row: Vec<f64>,
}

impl Stream {
    /// Begins the stream `epoch` of a cell that stands `at_rest`.
    pub(super) fn new(
        session: &Session,
        keys: &Keys,
        epoch: String,
        joints: Vec<String>,
        at_rest: &Sample,
    ) -> Result<Self, zenoh::Error> {
        Ok(Self {
            epoch,
            joints,
            // The next sample is as good as one that would have to wait, and none waits behind bulk data.
            publisher: session
                .declare_publisher(keys.state())
                .congestion_control(CongestionControl::Drop)
                .priority(Priority::InteractiveHigh)
                .wait()?,
            shown: Mutex::new(Shown {
                seq: 0,
                goal_id: String::new(),
                measured: at_rest.to_row(),
                kept: VecDeque::with_capacity(KEPT),
            }),
        })
    }

    /// Notes what was measured while a goal was executed.
    pub(super) fn measure(&self, goal_id: &str, sample: &Sample) {
        let mut shown = lock(&self.shown);
        if shown.goal_id != goal_id {
            goal_id.clone_into(&mut shown.goal_id);
        }
        shown.measured = sample.to_row();
    }

    /// Notes that nothing moves any more.
    pub(super) fn rest(&self) {
        lock(&self.shown).goal_id.clear();
    }

    /// Publishes what was measured last.
    pub(super) fn publish(&self) {
        let mut shown = lock(&self.shown);
        let next = Kept {
            seq: shown.seq,
            goal_id: shown.goal_id.clone(),
            row: shown.measured.clone(),
        };
        let bytes = self.chunk(next.seq, &next.goal_id, std::iter::once(&next));
        shown.seq += 1;
        if shown.kept.len() == KEPT {
            shown.kept.pop_front();
        }
        shown.kept.push_back(next);
        // In the order of the numbers, hence with the lock.
        let _published = self.publisher.put(bytes).wait();
    }

    /// Publishes what was measured last, at its rate until the cell ends.
    pub(super) fn run(&self, ended: &AtomicBool) {
        let mut next = Instant::now();
        while !ended.load(Ordering::Relaxed) {
            self.publish();
            next += PERIOD;
            let now = Instant::now();
            thread::sleep(next.saturating_duration_since(now));
            // A machine that is busy catches up, so that numbers tell the time; one that stood still
            // does not.
            if now.saturating_duration_since(next) > STOOD_STILL {
                next = now;
            }
        }
    }

    /// Returns samples from a number on: as many as one answer holds, of one goal; none if there is
    /// none yet.
    pub(super) fn since(&self, from: u64) -> Vec<u8> {
        let shown = lock(&self.shown);
        let begin = shown.kept.partition_point(|kept| kept.seq < from);
        let mut rows = shown.kept.range(begin..).peekable();
        let Some(first) = rows.peek() else {
            return self.chunk(shown.seq, &shown.goal_id, std::iter::empty());
        };
        let (seq, goal_id) = (first.seq, first.goal_id.as_str());
        let rows = rows.take_while(|kept| kept.goal_id == goal_id).take(CHUNK);
        self.chunk(seq, goal_id, rows)
    }

    fn chunk<'a>(&self, seq: u64, goal_id: &str, rows: impl Iterator<Item = &'a Kept>) -> Vec<u8> {
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

/// Returns what is measured before the first motion: the palm is nowhere in particular, and the joints
/// are at zero or as close to it as they come.
pub(super) fn at_rest(robot: &Robot) -> Sample {
    let joints = robot.joints();
    let q_rad: Vec<f64> = joints
        .map(|joint| 0.0_f64.max(joint.lower).min(joint.upper))
        .collect();
    Sample {
        time_s: 0.0,
        table_from_palm: Pose::new(Isometry3::identity()),
        table_from_object: Pose::new(Isometry3::identity()),
        q_command_rad: q_rad.clone(),
        q_rad,
    }
}
