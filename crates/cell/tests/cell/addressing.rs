//! Goals that a cell must not execute, because they are for another, without permission, or from a stranger.

use cell::{
    Address, CellClient, CellError, CellServer, Goal, GoalMessage, Keys, PublicKey, Rejection,
    RejectionCode, ServiceConfig, SigningKey, Terms, subscribe,
};
use schemas::executions::Outcome;
use zenoh::Wait;

use crate::{
    instant::Instant,
    lab::{PATIENT, SOON, body, goal, robot},
};

fn client(cell: &CellServer) -> CellClient {
    CellClient::connect(cell.endpoint(), cell.name(), SOON).unwrap()
}

/// Sends a message as it is; returns why it is refused, if it is.
fn refused(cell: &CellServer, message: &[u8]) -> Option<RejectionCode> {
    let (session, _) = subscribe(cell.endpoint(), "nothing", SOON).unwrap();
    let keys = Keys::new(cell.name()).unwrap();
    let replies = session.get(keys.goal()).payload(message).timeout(SOON);
    let reply = replies.wait().unwrap().recv().unwrap();
    let reply = reply.into_result().unwrap();
    let rejection = serde_json::from_slice::<Rejection>(body(&reply.payload().to_bytes()));
    rejection.ok().map(|rejection| rejection.code)
}

/// A goal for a journal, as the dispatcher with this key addresses it.
fn message(goal: &Goal, journal: &str, simulated_only: bool, key: &SigningKey) -> GoalMessage {
    let address = Address::now("simulated", journal, "me", simulated_only, SOON);
    GoalMessage::new(goal.encode(), address, key)
}

#[test]
fn a_goal_for_another_cell_or_journal_moves_nothing() {
    let machine = Instant::new(true);
    let cell = machine.serve(ServiceConfig::default());
    let journal = client(&cell).capabilities(SOON).unwrap().journal;
    let key = SigningKey::fresh().unwrap();
    let address = Address::now("other", &journal, "me", true, SOON);
    let elsewhere = [
        GoalMessage::new(goal(0.04).encode(), address, &key),
        message(&goal(0.04), &"0".repeat(64), true, &key),
        message(&goal(0.04), "", true, &key),
    ];
    for elsewhere in elsewhere {
        let code = refused(&cell, &elsewhere.bytes);
        assert_eq!(code, Some(RejectionCode::Address));
    }
    assert!(machine.executed().is_empty());
    // A goal that was executed under one journal is for no other: a cell that comes back without its goals.
    let sent = message(&goal(0.04), &journal, true, &key);
    assert_eq!(refused(&cell, &sent.bytes), None);
    drop(cell);
    let again = Instant::new(true);
    let cell = again.serve(ServiceConfig::default());
    assert_eq!(refused(&cell, &sent.bytes), Some(RejectionCode::Address));
    assert!(again.executed().is_empty());
}

#[test]
fn a_real_cell_refuses_a_goal_without_permission() {
    let machine = Instant::new(false);
    let cell = machine.serve(ServiceConfig::default());
    let client = client(&cell);
    let there = client.capabilities(SOON).unwrap();
    let key = SigningKey::fresh().unwrap();
    let sent = message(&goal(0.04), &there.journal, true, &key);
    assert_eq!(refused(&cell, &sent.bytes), Some(RejectionCode::Permission));
    // The dispatcher does not even send it.
    let run = |execute: bool| {
        let terms = Terms::new(there.clone(), execute);
        client.execute(&goal(0.04), &terms, &robot(), PATIENT, &())
    };
    let asked = run(false);
    assert!(
        matches!(asked, Err(CellError::NotPermitted { .. })),
        "{asked:?}"
    );
    assert!(machine.executed().is_empty());
    let cell::GoalResult::Report(report) = run(true).unwrap() else {
        panic!("no report");
    };
    assert_eq!(report.outcome, Outcome::Succeeded);
    assert_eq!(machine.executed().len(), 1);
}

#[test]
fn a_cell_with_dispatchers_takes_goals_of_their_keys_alone() {
    let [known, stranger] = [(); 2].map(|()| SigningKey::fresh().unwrap());
    let machine = Instant::new(true);
    let cell = machine.serve(ServiceConfig {
        dispatchers: vec![known.name().parse::<PublicKey>().unwrap()],
        ..ServiceConfig::default()
    });
    let journal = client(&cell).capabilities(SOON).unwrap().journal;
    let sent = message(&goal(0.04), &journal, true, &stranger);
    assert_eq!(refused(&cell, &sent.bytes), Some(RejectionCode::Dispatcher));
    assert!(machine.executed().is_empty());
    let sent = message(&goal(0.04), &journal, true, &known);
    assert_eq!(refused(&cell, &sent.bytes), None);
}

#[test]
fn a_goal_of_version_4_is_refused_with_what_to_update() {
    let machine = Instant::new(true);
    let cell = machine.serve(ServiceConfig::default());
    let encoded = goal(0.04).encode();
    let seal = format!(
        "{{\"protocol\":4,\"goal_id\":\"{}\",\"digest\":\"{}\"}}\n",
        encoded.goal_id, encoded.digest
    );
    let old = [seal.as_bytes(), &encoded.bytes].concat();
    assert_eq!(refused(&cell, &old), Some(RejectionCode::Protocol));
    assert!(machine.executed().is_empty());
}
