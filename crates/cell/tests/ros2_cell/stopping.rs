//! Motions that are broken off: by a word, by silence, by the cell's death. Stops are measured by the
//! emulated controllers' own clock, from their own updates.
//!
//! A bound on a time cannot hold on a machine that is too busy to run what is timed. So a thread of
//! the test's own measures by how much this machine wakes threads too late meanwhile: each stop may
//! take as much longer, once for each of the threads through which it passes.

use std::{
    sync::{
        Mutex,
        atomic::{AtomicBool, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

use cell::{
    Address, ControlReply, Goal, GoalMessage, GoalResult, Keys, Patience, RecoveryResult,
    SigningKey, ros2_now_ns, subscribe,
};
use schemas::executions::Outcome;
use zenoh::Wait;

use crate::{
    emulated::Emulated,
    lab::{Lab, PATIENT, SOON, SOUND, execute, goal, joints, send},
};

/// Stops of each kind.
const TRIALS: u32 = 3;
/// Threads that a stop passes through: zenoh's three, the cell's, the controllers'.
const THREADS: f64 = 5.0;
/// Longest stop after a cancel, and after the last sign of life, in seconds.
const CANCELED_S: f64 = 0.05;
const SILENT_S: f64 = 0.3;
/// The shipped cell's patience with a dispatcher that sends no heartbeat, in seconds.
const SHIPPED_SILENCE_S: f64 = 0.2;
/// A change of a joint in an update that is no motion, in radians.
const NO_MOTION_RAD: f64 = 1e-7;

/// A stop: how long it took, and how much later than due this machine ran threads meanwhile.
struct Stop {
    after_s: f64,
    late_s: f64,
}

/// Ends a thread even where the test fails.
struct SetWhenDropped<'a>(&'a AtomicBool);

impl Drop for SetWhenDropped<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Runs `stop`, which returns a time from which on the joints should stop, and waits until they rest.
fn measure(emulated: &Emulated, stop: impl FnOnce() -> i64) -> Stop {
    let (over, latest) = (AtomicBool::new(false), Mutex::new(Vec::new()));
    let asked_ns = thread::scope(|scope| {
        let _ends = SetWhenDropped(&over);
        scope.spawn(|| {
            while !over.load(Ordering::Relaxed) {
                let due = Instant::now() + Duration::from_millis(1);
                thread::sleep(Duration::from_millis(1));
                let late_s = due.elapsed().as_secs_f64();
                latest.lock().unwrap().push((ros2_now_ns(), late_s));
            }
        });
        stop()
    });
    let steps = emulated.log().steps;
    let moving = steps.iter().filter(|(_, change)| *change > NO_MOTION_RAD);
    let &(stopped_ns, _) = moving.clone().next_back().unwrap();
    assert!(
        moving
            .clone()
            .any(|(at_ns, _)| *at_ns > asked_ns - 50_000_000),
        "nothing moved before"
    );
    let late_s = latest.into_inner().unwrap().into_iter();
    let late_s = late_s.filter(|(at_ns, _)| (asked_ns..stopped_ns + 20_000_000).contains(at_ns));
    Stop {
        after_s: (stopped_ns - asked_ns).max(0) as f64 * 1e-9,
        late_s: late_s.map(|(_, late_s)| late_s).fold(0.0, f64::max),
    }
}

/// Checks each stop against what this machine allows.
fn check(kind: &str, most_s: f64, stops: &[Stop]) {
    for Stop { after_s, late_s } in stops {
        println!("{kind}: joints stood {after_s:.3} s later; threads ran up to {late_s:.3} s late");
        assert!(
            *after_s <= most_s + THREADS * late_s,
            "{kind}: {after_s} s, threads {late_s} s late"
        );
    }
}

#[test]
fn joints_stand_50_ms_after_a_cancel_or_a_stop() {
    let lab = Lab::new();
    let emulated = lab.emulate(SOUND);
    let _cell = lab.serve();
    let (client, watcher) = (lab.connect(), lab.connect());
    let mut stops = Vec::new();
    for attempt in 1..=2 * TRIALS {
        let goal = goal(&lab, attempt);
        let id = goal.encode().goal_id;
        let report = thread::scope(|scope| {
            let executing = scope.spawn(|| execute(&client, &goal));
            lab.wait_for_motion(&goal);
            stops.push(measure(&emulated, || {
                let asked_ns = ros2_now_ns();
                let reply = if attempt <= TRIALS {
                    watcher.cancel(&id, SOON)
                } else {
                    watcher.stop(SOON)
                };
                assert_eq!(reply.unwrap(), ControlReply::Done);
                asked_ns
            }));
            executing.join().unwrap()
        });
        let said = if attempt <= TRIALS {
            "canceled"
        } else {
            "stopped"
        };
        assert_eq!(
            (report.outcome, report.message.as_str()),
            (Outcome::Stopped, said)
        );
        // What was answered is so: nothing moved after the answer.
        let last = report.samples.last().unwrap();
        let there = report.samples.iter().rev().take(10);
        for sample in there {
            for (then, at_last) in sample.q_rad.iter().zip(&last.q_rad) {
                assert!((then - at_last).abs() < 1e-3);
            }
        }
        watcher.resume(SOON).unwrap();
    }
    check("canceled or stopped", CANCELED_S, &stops);
}

/// Sends a goal in the name of a dispatcher whose heartbeats end in the middle of the motion.
fn fall_silent(lab: &Lab, goal: &Goal) -> i64 {
    let keys = Keys::new(&lab.config.cell).unwrap();
    let (session, _) = subscribe(lab.endpoint(), "nothing", SOON).unwrap();
    let there = lab.connect().capabilities(SOON).unwrap();
    let address = Address::now(&there.cell, &there.journal, "one", false, SOON);
    let sealed = GoalMessage::new(goal.encode(), address, &SigningKey::fresh().unwrap());
    let beating = AtomicBool::new(true);
    thread::scope(|scope| {
        let last_ns = scope.spawn(|| {
            let mut last_ns = 0;
            while beating.load(Ordering::Relaxed) {
                last_ns = ros2_now_ns();
                let beat = "{\"dispatcher\":\"one\"}\n";
                session.put(keys.heartbeat(), beat).wait().unwrap();
                thread::sleep(Duration::from_millis(20));
            }
            last_ns
        });
        let replies = session.get(keys.goal()).payload(sealed.bytes).timeout(SOON);
        let answer = replies.wait().unwrap().recv().unwrap().into_result();
        let answer = answer.unwrap().payload().to_bytes().into_owned();
        assert!(String::from_utf8_lossy(&answer).contains("accepted"));
        lab.wait_for_motion(goal);
        beating.store(false, Ordering::Relaxed);
        last_ns.join().unwrap()
    })
}

#[test]
fn joints_stand_within_300_ms_of_the_last_heartbeat() {
    let mut lab = Lab::new();
    lab.config.silence_s = SHIPPED_SILENCE_S;
    let emulated = lab.emulate(SOUND);
    let _cell = lab.serve();
    let client = lab.connect();
    client.capabilities(SOON).unwrap();
    let mut stops = Vec::new();
    for attempt in 1..=TRIALS {
        let goal = goal(&lab, attempt);
        stops.push(measure(&emulated, || {
            let last_ns = fall_silent(&lab, &goal);
            // The report comes when nothing moves.
            let report = match client.recover(&goal.encode().goal_id, &goal, &joints(), PATIENT) {
                RecoveryResult::Report(report) => report,
                other => panic!("{other:?}"),
            };
            assert_eq!(report.outcome, Outcome::Aborted, "{}", report.message);
            assert!(
                report.message.contains("no heartbeat"),
                "{}",
                report.message
            );
            last_ns
        }));
    }
    check("silent", SILENT_S, &stops);
}

#[test]
fn joints_stand_within_300_ms_of_the_death_of_the_cell() {
    let lab = Lab::new();
    let emulated = lab.emulate(SOUND);
    let mut stops = Vec::new();
    for attempt in 1..=TRIALS {
        let mut cell = lab.serve_apart(&[]);
        let client = lab.connect();
        let goal = goal(&lab, attempt);
        let wait = Duration::from_secs(3);
        let patience = Patience {
            answer: wait,
            result: wait,
        };
        thread::scope(|scope| {
            let sent = scope.spawn(|| send(&client, &goal, patience));
            lab.wait_for_motion(&goal);
            stops.push(measure(&emulated, || {
                let killed_ns = ros2_now_ns();
                cell.kill();
                assert!(matches!(sent.join().unwrap(), GoalResult::Unknown(_)));
                killed_ns
            }));
        });
        // The one that is started after it says so, and moves nothing for it.
        let moved = emulated.log().motions_n;
        let _next = lab.serve_apart(&[]);
        let report = execute(&lab.connect(), &goal);
        assert_eq!(report.outcome, Outcome::Unknown, "{}", report.message);
        assert_eq!(emulated.log().motions_n, moved);
    }
    check("killed", SILENT_S, &stops);
}
