//! Events that a watcher receives, with late starts and lost messages.

use std::{
    sync::{Arc, Mutex},
    thread,
    time::Duration,
};

use cell::{
    Counts, GoalOutcome, Keys, ModelMismatch, Router, ServiceConfig, SimulatedCell,
    SimulatedCellConfig, State, WatchEvent, Watcher, subscribe,
};
use schemas::executions::Outcome;
use zenoh::Wait;

use crate::{
    impostor::Key,
    lab::{GRIPPER, LISTEN, SOON, connect, execute, goal, scene, start, start_with},
};

/// Longest wait for an event of a cell that publishes some.
const LONG: Duration = Duration::from_secs(5);

fn watch(endpoint: &str) -> Watcher {
    Watcher::start(None, endpoint, "simulated", SOON).unwrap()
}

/// Watches until `n` samples were received, and returns them.
fn states(watcher: &mut Watcher, n: usize) -> Vec<State> {
    let mut states = Vec::new();
    while states.len() < n {
        if let WatchEvent::State(state) = watcher.next(LONG).expect("the cell says something") {
            states.push(state);
        }
    }
    states
}

/// Watches until `n` goals have ended, and returns their outcomes.
fn outcomes(watcher: &mut Watcher, n: usize) -> Vec<GoalOutcome> {
    let mut outcomes = Vec::new();
    while outcomes.len() < n {
        if let WatchEvent::Outcome(outcome) = watcher.next(LONG).expect("the cell says something") {
            outcomes.push(outcome);
        }
    }
    outcomes
}

/// Checks that each sample follows the one before.
fn follow_each_other(states: &[State]) {
    for pair in states.windows(2) {
        assert_eq!(pair[0].seq + 1, pair[1].seq);
        assert_eq!(pair[0].epoch, pair[1].epoch);
    }
}

#[test]
fn late_subscriber_sees_past_outcomes() {
    let cell = start_with(ServiceConfig {
        real_time: true,
        silence: Some(SOON),
        ..ServiceConfig::default()
    });
    let mut first = watch(cell.endpoint());
    let seen = states(&mut first, 100);
    assert_eq!(seen[0].seq, 0);
    follow_each_other(&seen);
    // Nothing moves: the hand is where it was.
    assert!(seen.iter().all(|state| state.goal_id.is_empty()));
    assert!(seen.iter().all(|state| state.sample == seen[0].sample));

    let report = execute(&connect(&cell), &goal(0.04));
    let mut late = watch(cell.endpoint());
    let outcome = outcomes(&mut late, 1).remove(0);
    assert_eq!((outcome.result_n, &outcome.goal_id), (0, &report.goal_id));
    let seen = states(&mut watch(cell.endpoint()), 250);
    assert_eq!(seen[0].seq, 0);
    follow_each_other(&seen);
    let moving = seen.iter().filter(|state| state.goal_id == report.goal_id);
    // Of 1.8 s at 100 a second, on a machine that may be busy.
    assert!(moving.count() > 20);
    assert_eq!(late.counts().gaps_n, 0);
}

#[test]
fn outcomes_keep_their_order_across_a_restart() {
    let folder = tempfile::tempdir().unwrap();
    let service = || ServiceConfig {
        journal: Some(folder.path().to_owned()),
        ..ServiceConfig::default()
    };
    let cell = start_with(service());
    let mut seen_at_once = watch(cell.endpoint());
    let ids: Vec<String> = [0.04, 0.0, 0.03]
        .iter()
        .map(|&closed_m| execute(&connect(&cell), &goal(closed_m)).goal_id)
        .collect();
    let names = |outcomes: &[GoalOutcome]| -> Vec<String> {
        outcomes.iter().map(|o| o.goal_id.clone()).collect()
    };
    let seen = outcomes(&mut seen_at_once, 3);
    assert_eq!(names(&seen), ids);
    assert_eq!(
        (seen[0].outcome, seen[1].outcome),
        (Outcome::Succeeded, Outcome::Failed)
    );
    cell.stop();
    let cell = start_with(service());
    assert_eq!(outcomes(&mut watch(cell.endpoint()), 3), seen);
    // A cell that keeps no journal counts anew, under another name.
    let in_memory = start();
    execute(&connect(&in_memory), &goal(0.04));
    let other = outcomes(&mut watch(in_memory.endpoint()), 1).remove(0);
    assert_eq!(other.result_n, 0);
    assert_ne!(other.journal, seen[0].journal);
}

#[test]
fn lost_messages_are_requested_again_and_counted() {
    // The simulated cell only forwards here: another program is the cell `scripted`.
    let forwards = start();
    let (session, _) = subscribe(forwards.endpoint(), "nothing", SOON).unwrap();
    let keys = Keys::new("scripted").unwrap();
    let row = |seq: u64| -> Vec<u8> {
        let mut numbers = [0.0; 15];
        numbers[0] = seq as f64;
        (numbers[7], numbers[14]) = (1.0, 1.0);
        numbers
            .iter()
            .flat_map(|number| number.to_le_bytes())
            .collect()
    };
    let header = |seq: u64| {
        format!("{{\"epoch\":\"e\",\"goal_id\":\"\",\"seq\":{seq},\"joints\":[]}}\n").into_bytes()
    };
    let kept = Arc::new(Mutex::new(Vec::<u64>::new()));
    let _history = {
        let (kept, key) = (Arc::clone(&kept), Key::new(1));
        session
            .declare_queryable(keys.history())
            .callback(move |query| {
                let from: u64 = query.parameters().get("from").unwrap().parse().unwrap();
                let kept = kept.lock().unwrap();
                let rows: Vec<u64> = kept.iter().copied().filter(|&seq| seq >= from).collect();
                let mut bytes = header(rows.first().copied().unwrap_or(99));
                bytes.extend(rows.iter().flat_map(|&seq| row(seq)));
                let answer = key.sign(&query, &bytes);
                query.reply(query.key_expr(), answer).wait().unwrap();
            })
            .wait()
            .unwrap()
    };
    let mut watcher = Watcher::start(None, forwards.endpoint(), "scripted", SOON).unwrap();
    let publish = |seq: u64| {
        let mut bytes = header(seq);
        bytes.extend(row(seq));
        session.put(keys.state(), bytes).wait().unwrap();
    };
    // The queries at the start prove that the subscriptions arrived.
    assert_eq!(watcher.next(Duration::ZERO), None);
    // Watched from 10 on; 11 comes by itself, 12 is lost, and of 13 to 19 the cell still has 16 to 19.
    for seq in [10, 11, 13, 20] {
        kept.lock().unwrap().clear();
        if seq == 20 {
            kept.lock().unwrap().extend(16..=20);
        }
        publish(seq);
        let mut seen = Vec::new();
        while seen.last() != Some(&seq) {
            seen.push(states(&mut watcher, 1).remove(0).seq);
        }
        if seq == 20 {
            assert_eq!(seen, [16, 17, 18, 19, 20]);
        }
    }
    assert_eq!(
        watcher.counts(),
        Counts {
            states_n: 8,
            recovered_n: 4,
            gaps_n: 3,
            ..Counts::default()
        }
    );
}

#[test]
fn samples_that_none_follows_are_requested_too() {
    // Faster than real time: nothing is published after the last motion.
    let cell = start();
    let mut watcher = watch(cell.endpoint());
    let client = connect(&cell);
    let run = |number: u32| {
        let closed_m = 0.04 - 1e-4 * f64::from(number);
        execute(&client, &goal(closed_m)).samples.len()
    };
    let first_n = run(0);
    assert_eq!(states(&mut watcher, 1).len(), 1);
    // More than are buffered for a watcher that does not fetch.
    let published_n = first_n + (1..24).map(run).sum::<usize>();
    assert!(published_n > 4096 + 100, "{published_n}");
    let mut seen_n = 1;
    while let Some(seen) = watcher.next(Duration::from_secs(1)) {
        seen_n += usize::from(matches!(seen, WatchEvent::State(_)));
    }
    assert_eq!((seen_n, watcher.counts().gaps_n), (published_n, 0));
    assert!(watcher.counts().recovered_n > 0);
}

#[test]
fn router_outage_loses_no_message() {
    let router = Router::start(LISTEN, None).unwrap();
    let endpoint = router.endpoint().to_owned();
    let config = SimulatedCellConfig {
        name: "simulated".to_owned(),
        listen: String::new(),
        scene: scene(),
        arm: None,
        mismatch: ModelMismatch::default(),
        service: ServiceConfig {
            real_time: true,
            silence: Some(SOON),
            router: Some(endpoint.clone()),
            ..ServiceConfig::default()
        },
    };
    let cell = SimulatedCell::start(config, GRIPPER).unwrap();
    assert!(cell.router().is_some());
    let mut watcher = watch(&endpoint);
    let mut seen = states(&mut watcher, 50);
    drop(router);
    thread::sleep(Duration::from_millis(300));
    let _router = Router::start(&endpoint, None).unwrap();
    seen.extend(states(&mut watcher, 200));
    follow_each_other(&seen);
    let counts = watcher.counts();
    assert_eq!((counts.gaps_n, counts.restarts_n), (0, 0), "{counts:?}");
    assert!(counts.recovered_n > 0, "{counts:?}");
}
