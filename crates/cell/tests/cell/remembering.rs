//! What a cell knows of goals that came before.

use std::time::{Duration, SystemTime};

use cell::{CellError, Keys, Recovered, Service, SimulatedCell, SimulatedCellConfig, subscribe};
use schemas::executions::Outcome;
use zenoh::Wait;

use crate::lab::{GRIPPER, LISTEN, SOON, connect, execute, goal, scene, start, start_with};

#[test]
fn a_cell_started_again_tells_what_it_did_and_does_not_do_it_again() {
    let folder = tempfile::tempdir().unwrap();
    let service = || Service {
        journal: Some(folder.path().join("journal")),
        ..Service::default()
    };
    let cell = start_with(service());
    let report = execute(&connect(&cell), &goal(0.04));
    cell.stop();
    let cell = start_with(service());
    assert_eq!(execute(&connect(&cell), &goal(0.04)), report);
    assert_eq!(cell.executed_n(), 1);
    let found = connect(&cell).recover(&report.goal_id, SOON, SOON).unwrap();
    assert_eq!(found, Recovered::Report(report));
}

#[test]
fn a_goal_that_was_never_taken_is_known_to_be_none() {
    let cell = start();
    let asked = connect(&cell).recover("00ff", SOON, SOON).unwrap();
    assert_eq!(asked, Recovered::NeverTaken);
    let client = connect(&cell);
    cell.stop();
    let soon = Duration::from_millis(300);
    let asked = client.recover("00ff", soon, soon).unwrap();
    assert_eq!(asked, Recovered::Silent);
}

#[test]
fn a_goal_that_comes_too_late_is_refused_and_one_that_was_taken_is_answered() {
    let cell = start();
    let (session, _) = subscribe(cell.endpoint(), "nothing", SOON).unwrap();
    let keys = Keys::new("simulated").unwrap();
    let sealed = goal(0.04).seal();
    let late = sealed.valid_until(SystemTime::now() - Duration::from_secs(1));
    let send = || {
        let replies = session
            .get(keys.goal())
            .payload(late.bytes.as_slice())
            .timeout(SOON)
            .wait()
            .unwrap();
        let reply = replies.recv().unwrap().into_result().unwrap();
        String::from_utf8(reply.payload().to_bytes().into_owned()).unwrap()
    };
    assert!(send().contains("\"expired\""), "{}", send());
    assert_eq!(cell.executed_n(), 0);
    let report = execute(&connect(&cell), &goal(0.04));
    assert_eq!(report.outcome, Outcome::Succeeded);
    assert!(send().contains("\"known\":true"), "{}", send());
}

#[test]
fn a_goal_that_was_taken_is_known_even_where_its_object_has_gone() {
    let folder = tempfile::tempdir().unwrap();
    let config = || SimulatedCellConfig {
        name: "simulated".to_owned(),
        listen: LISTEN.to_owned(),
        scene: scene(),
        arm: None,
        gap: cell::Gap::default(),
        service: Service {
            journal: Some(folder.path().to_owned()),
            ..Service::default()
        },
    };
    let cell = start_with(config().service);
    let report = execute(&connect(&cell), &goal(0.04));
    cell.stop();
    // No cube lies before this one.
    let cell = SimulatedCell::start(config(), GRIPPER).unwrap();
    assert_eq!(execute(&connect(&cell), &goal(0.04)), report);
    assert_eq!(cell.executed_n(), 1);
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
        gap: cell::Gap::default(),
        service: Service {
            journal: Some(file.join("journal")),
            ..Service::default()
        },
    };
    let err = SimulatedCell::start(config, GRIPPER).map(drop).unwrap_err();
    assert!(matches!(err, CellError::Journal { .. }), "{err}");
    assert!(err.to_string().contains("journal") && err.hint().is_some());
}
