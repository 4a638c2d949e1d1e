//! Aborted motions: by a request, or by a heartbeat timeout.

use std::{
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::{Duration, Instant},
};

use cell::{
    CellError, ControlReply, Keys, Rejection, RejectionCode, Report, ServiceConfig, State,
    subscribe,
};
use schemas::executions::Outcome;
use zenoh::Wait;

use crate::lab::{
    PATIENT, SOON, addressed, body, connect, execute, goal, report, robot, start, start_with, terms,
};

/// Time for which the hand is watched after it stopped, in seconds.
const HOLD_S: f64 = 0.5;
/// Seconds after which the gripper lifts, and after which it has lifted.
const LIFT_S: [f64; 2] = [0.9, 1.3];

fn in_real_time() -> ServiceConfig {
    ServiceConfig {
        real_time: true,
        ..ServiceConfig::default()
    }
}

/// Heartbeat timeout that a busy machine keeps; the motions take longer.
const SILENCE: Duration = Duration::from_secs(1);

fn patient() -> ServiceConfig {
    ServiceConfig {
        silence: Some(SILENCE),
        ..in_real_time()
    }
}

/// Checks that the cube stayed in the hand where the motion was aborted; returns the time of the
/// abort.
fn held_s(report: &Report) -> f64 {
    let stopped_s = report.duration_s() - HOLD_S;
    let height = |time_s: f64| {
        let mut samples = report.samples.iter();
        let sample = samples
            .find(|sample| sample.time_s > time_s - 1e-6)
            .unwrap();
        sample.table_from_object.translation.z
    };
    let (then, at_last) = (height(stopped_s), height(report.duration_s()));
    assert!((then - at_last).abs() < 0.002, "{then} m, then {at_last} m");
    let moved = |sample: &cell::Sample| sample.table_from_palm.translation.vector;
    let last = report.samples.last().unwrap();
    let mut after = report.samples.iter();
    let first = after
        .find(|sample| sample.time_s > stopped_s - 1e-6)
        .unwrap();
    assert!((moved(last) - moved(first)).norm() < 1e-4);
    stopped_s
}

#[test]
fn canceled_motion_halts_and_fingers_keep_pressing() {
    let cell = start_with(patient());
    let keys = Keys::new("simulated").unwrap();
    let (_session, states) = subscribe(cell.endpoint(), &keys.state(), SOON).unwrap();
    let (client, watcher) = (connect(&cell), connect(&cell));
    assert!(client.capabilities(SOON).unwrap().silence_s.is_some());
    let goal = goal(0.04);
    let id = goal.encode().goal_id;
    let report = thread::scope(|scope| {
        let executing = scope.spawn(|| execute(&client, &goal));
        // In the middle of the lift.
        while let Ok(Some(sample)) = states.recv_timeout(SOON) {
            let state = State::from_bytes(&sample.payload().to_bytes()).unwrap();
            if state[0].goal_id == id && state[0].sample.time_s >= 1.1 {
                break;
            }
        }
        let asked = Instant::now();
        assert_eq!(watcher.cancel(&id, SOON).unwrap(), ControlReply::Done);
        println!(
            "the palm stood {:?} after it was asked for",
            asked.elapsed()
        );
        executing.join().unwrap()
    });
    assert_eq!(
        (report.outcome, report.message.as_str()),
        (Outcome::Stopped, "canceled")
    );
    let stopped_s = held_s(&report);
    assert!(
        stopped_s > LIFT_S[0] && stopped_s < LIFT_S[1] + HOLD_S,
        "{stopped_s} s"
    );
    assert_eq!(
        watcher.cancel(&id, SOON).unwrap(),
        ControlReply::AlreadyEnded
    );
    assert_eq!(
        watcher.cancel("00", SOON).unwrap(),
        ControlReply::UnknownGoal
    );
}

#[test]
fn motion_stops_within_300_ms_of_a_lost_heartbeat() {
    let cell = start_with(in_real_time());
    let keys = Keys::new("simulated").unwrap();
    // A dispatcher that sends a goal and then falls silent, and others that send heartbeats.
    let (session, _) = subscribe(cell.endpoint(), "nothing", SOON).unwrap();
    let goal = goal(0.04);
    let sealed = addressed(&connect(&cell), &goal, "one");
    let ask = |key: String, payload: &[u8]| {
        let replies = session
            .get(key)
            .payload(payload)
            .timeout(SOON)
            .wait()
            .unwrap();
        let reply = replies.recv().unwrap().into_result().unwrap();
        reply.payload().to_bytes().into_owned()
    };
    let over = AtomicBool::new(false);
    let report = thread::scope(|scope| {
        scope.spawn(|| {
            let others = ["", "{}\n", "{\"dispatcher\":\"another\"}\n", "one"];
            while !over.load(Ordering::Relaxed) {
                for beat in others {
                    session.put(keys.heartbeat(), beat).wait().unwrap();
                }
                thread::sleep(Duration::from_millis(20));
            }
        });
        ask(keys.goal(), &sealed.bytes);
        let report = report(&ask(keys.result(&sealed.encoded.goal_id), &[]), &goal);
        over.store(true, Ordering::Relaxed);
        report
    });
    assert_eq!(report.outcome, Outcome::Aborted);
    assert!(
        report.message.contains("no heartbeat"),
        "{}",
        report.message
    );
    // The motion is never ahead of the clock.
    let stopped_s = held_s(&report);
    println!("broken off after {stopped_s} s of silence");
    assert!(stopped_s > 0.0 && stopped_s < 0.3, "{stopped_s} s");
}

#[test]
fn heartbeats_let_a_real_time_motion_finish() {
    let cell = start_with(patient());
    let started = Instant::now();
    let report = execute(&connect(&cell), &goal(0.04));
    assert_eq!(report.outcome, Outcome::Succeeded, "{}", report.message);
    assert!(report.duration_s() > SILENCE.as_secs_f64());
    assert!(started.elapsed().as_secs_f64() > report.duration_s() - 0.05);
}

#[test]
fn stopped_cell_rejects_goals_until_resumed() {
    let cell = start();
    let client = connect(&cell);
    assert_eq!(client.stop(SOON).unwrap(), ControlReply::Done);
    // A dispatcher sees it before it sends anything, and one that sends all the same is refused.
    let refused = client.execute(&goal(0.04), &terms(&client), &robot(), PATIENT, &());
    assert!(
        matches!(refused, Err(CellError::Stopped { .. })),
        "{refused:?}"
    );
    let (session, _) = subscribe(cell.endpoint(), "nothing", SOON).unwrap();
    let sent = addressed(&client, &goal(0.04), "me").bytes;
    let keys = Keys::new("simulated").unwrap();
    let replies = session.get(keys.goal()).payload(sent).timeout(SOON).wait();
    let reply = replies.unwrap().recv().unwrap().into_result().unwrap();
    let refused = serde_json::from_slice::<Rejection>(body(&reply.payload().to_bytes()));
    assert_eq!(refused.unwrap().code, RejectionCode::Stopped);
    assert_eq!(cell.executed_count(), 0);
    assert_eq!(client.resume(SOON).unwrap(), ControlReply::Done);
    let report = execute(&client, &goal(0.04));
    assert_eq!(report.outcome, Outcome::Succeeded);
}
