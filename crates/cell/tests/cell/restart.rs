//! A restarted cell's memory of earlier goals.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use cell::{
    Address, CellError, GoalMessage, Keys, Patience, RecoveryResult, ServiceConfig, SigningKey,
    SimulatedCell, SimulatedCellConfig, subscribe,
};
use schemas::executions::Outcome;
use zenoh::Wait;

use crate::lab::{
    GRIPPER, LISTEN, PATIENT, SOON, connect, execute, goal, robot, scene, start, start_with,
};

#[test]
fn restarted_cell_reports_past_goals_and_repeats_none() {
    let folder = tempfile::tempdir().unwrap();
    let service = || ServiceConfig {
        journal: Some(folder.path().join("journal")),
        ..ServiceConfig::default()
    };
    let cell = start_with(service());
    let report = execute(&connect(&cell), &goal(0.04));
    cell.stop();
    let cell = start_with(service());
    assert_eq!(execute(&connect(&cell), &goal(0.04)), report);
    assert_eq!(cell.executed_count(), 1);
    let found =
        connect(&cell).recover(&goal(0.04).encode().goal_id, &goal(0.04), &robot(), PATIENT);
    assert_eq!(found, RecoveryResult::Report(report));
}

#[test]
fn unknown_goal_is_answered_with_never_taken() {
    let cell = start();
    let asked =
        connect(&cell).recover(&goal(0.04).encode().goal_id, &goal(0.04), &robot(), PATIENT);
    assert_eq!(asked, RecoveryResult::NeverTaken);
    let client = connect(&cell);
    client.capabilities(SOON).unwrap();
    cell.stop();
    let soon = Duration::from_millis(300);
    let soon = Patience {
        answer: soon,
        result: soon,
    };
    let asked = client.recover(&goal(0.04).encode().goal_id, &goal(0.04), &robot(), soon);
    assert!(
        matches!(&asked, RecoveryResult::NoAnswer(why) if why.contains("no answer about the result")),
        "{asked:?}"
    );
}

#[test]
fn expired_goal_is_refused_and_known_goal_is_answered() {
    let cell = start();
    let (session, _) = subscribe(cell.endpoint(), "nothing", SOON).unwrap();
    let keys = Keys::new("simulated").unwrap();
    let there = connect(&cell).capabilities(SOON).unwrap();
    let dispatcher = SigningKey::fresh().unwrap();
    // By a clock that is right, or hours behind or ahead of the cell's.
    let sending = |offset_s: i64| {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
        let now_ms = u64::try_from(since.as_millis()).unwrap();
        let sent_unix_ms = now_ms.saturating_add_signed(1000 * offset_s);
        let address = Address {
            sent_unix_ms,
            valid_until_unix_ms: sent_unix_ms + 10_000,
            ..Address::now("simulated", &there.journal, "me", true, SOON)
        };
        GoalMessage::new(goal(0.04).encode(), address, &dispatcher)
    };
    let send = |offset_s: i64| {
        let replies = session
            .get(keys.goal())
            .payload(sending(offset_s).bytes)
            .timeout(SOON)
            .wait()
            .unwrap();
        let reply = replies.recv().unwrap().into_result().unwrap();
        String::from_utf8(reply.payload().to_bytes().into_owned()).unwrap()
    };
    for (offset_s, code) in [(-11, "expired"), (-3600, "clock"), (3600, "clock")] {
        let answer = send(offset_s);
        assert!(answer.contains(&format!("\"{code}\"")), "{answer}");
    }
    assert_eq!(cell.executed_count(), 0);
    let report = execute(&connect(&cell), &goal(0.04));
    assert_eq!(report.outcome, Outcome::Succeeded);
    for offset_s in [-11, -3600, 3600] {
        let answer = send(offset_s);
        assert!(answer.contains("\"known\":true"), "{answer}");
    }
}

#[test]
fn known_goal_is_answered_after_its_object_is_removed() {
    let folder = tempfile::tempdir().unwrap();
    let config = || SimulatedCellConfig {
        name: "simulated".to_owned(),
        listen: LISTEN.to_owned(),
        scene: scene(),
        arm: None,
        mismatch: cell::ModelMismatch::default(),
        service: ServiceConfig {
            journal: Some(folder.path().to_owned()),
            ..ServiceConfig::default()
        },
    };
    let cell = start_with(config().service);
    let report = execute(&connect(&cell), &goal(0.04));
    cell.stop();
    // No cube lies before this one.
    let cell = SimulatedCell::start(config(), GRIPPER).unwrap();
    assert_eq!(execute(&connect(&cell), &goal(0.04)), report);
    assert_eq!(cell.executed_count(), 1);
}

#[test]
fn a_journal_that_cannot_be_used_is_an_error_that_names_it() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, b"").unwrap();
    let config = SimulatedCellConfig {
        name: "simulated".to_owned(),
        listen: LISTEN.to_owned(),
        scene: scene(),
        arm: None,
        mismatch: cell::ModelMismatch::default(),
        service: ServiceConfig {
            journal: Some(file.join("journal")),
            ..ServiceConfig::default()
        },
    };
    let err = SimulatedCell::start(config, GRIPPER).map(drop).unwrap_err();
    assert!(matches!(err, CellError::Journal { .. }), "{err}");
    assert!(err.to_string().contains("journal") && err.hint().is_some());
}
