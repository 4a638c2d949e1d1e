//! Acceptance of answers by their signature.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
    time::Duration,
};

use cell::{
    CellClient, CellError, ControlReply, GoalResult, Keys, ModelMismatch, PROTOCOL, Patience,
    RejectionCode, Router, ServiceConfig, SimulatedCell, SimulatedCellConfig, WatchEvent, Watcher,
    execute_offline,
};
use schemas::executions::Outcome;
use serde_json::{Value, json};

use crate::{
    impostor::{Key, RogueParty, capabilities, line},
    lab::{
        GRIPPER, LISTEN, PATIENT, SOON, body, config, connect, cube, execute, goal, robot, scene,
        start, terms,
    },
};

/// Timeout for an answer that does not come.
const SHORT: Duration = Duration::from_millis(500);

/// Waits for a result no longer than that.
const IMPATIENT: Patience = Patience {
    answer: SOON,
    result: SHORT,
};

/// Sends the goal.
fn run(client: &CellClient, patience: Patience) -> Result<GoalResult, CellError> {
    client.execute(&goal(0.04), &terms(client), &robot(), patience, &())
}

fn keys() -> Keys {
    Keys::new("simulated").unwrap()
}

fn router() -> Router {
    Router::start(LISTEN, None).unwrap()
}

/// A router, and at it a cell that says of itself what is right, and answers nothing else yet.
fn known_cell() -> (Router, RogueParty, Arc<Key>) {
    let router = router();
    let key = Key::new(1);
    let mut cell = RogueParty::at(router.endpoint());
    let signer = Arc::clone(&key);
    cell.says(keys().capabilities(), &key, move || {
        line(&capabilities(&signer))
    });
    (router, cell, key)
}

fn client(router: &Router) -> CellClient {
    CellClient::connect(router.endpoint(), "simulated", SOON).unwrap()
}

/// Returns a cell's report on a goal that succeeded.
fn success() -> Vec<u8> {
    let service = ServiceConfig::default();
    let report = execute_offline(&config(service), GRIPPER, &cube(), &goal(0.04), &mut |_| {
        None
    })
    .unwrap();
    assert_eq!(report.outcome, Outcome::Succeeded);
    report.to_bytes()
}

/// Returns, for a query of each kind, its key and an answer that the client hopes for.
fn bodies() -> Vec<(String, Vec<u8>)> {
    let id = goal(0.04).encode().goal_id;
    let word = |word: &str| line(&json!({ "answer": word }));
    vec![
        (
            keys().goal(),
            line(&json!({ "answer": "accepted", "known": true })),
        ),
        (keys().result(&id), success()),
        (keys().cancel(&id), word("over")),
        (keys().stop(), word("done")),
        (keys().resume(), word("done")),
    ]
}

/// Sends a cell this key's query; returns the reason for which its answer is not accepted.
fn refused(client: &CellClient, key: &str) -> Option<String> {
    let id = goal(0.04).encode().goal_id;
    let halted = |halt: Result<ControlReply, CellError>| halt.err().map(|err| err.to_string());
    if key.ends_with("/stop") {
        return halted(client.stop(SOON));
    }
    if key.ends_with("/resume") {
        return halted(client.resume(SOON));
    }
    if key.ends_with("/cancel") {
        return halted(client.cancel(&id, SOON));
    }
    match run(client, PATIENT).unwrap() {
        GoalResult::Unknown(why) => Some(why),
        GoalResult::Report(_) | GoalResult::EarlierReport(_) | GoalResult::TooLong { .. } => None,
    }
}

#[test]
fn answers_of_other_peers_are_ignored_and_named() {
    let liar = Key::new(7);
    for (key, glad) in bodies() {
        for way in ["unsigned", "signed by another", "said before"] {
            let cell = start();
            let mut stranger = RogueParty::at(cell.endpoint());
            let before = match way {
                "said before" => stranger.ask(&format!("{}?nonce=1", keys().capabilities())),
                _ => Vec::new(),
            };
            let (signer, glad) = (Arc::clone(&liar), glad.clone());
            stranger.answers(key.clone(), move |query| {
                vec![match way {
                    "unsigned" => glad.clone(),
                    "signed by another" => signer.sign(query, &glad),
                    _ => before.clone(),
                }]
            });
            let client = connect(&cell);
            client.capabilities(SOON).unwrap();
            let why = refused(&client, &key);
            let why = why.unwrap_or_else(|| panic!("{key}, {way}: it was taken"));
            let named = match way {
                "signed by another" => format!("journal {}", &liar.name()[..16]),
                _ => "without a valid signature".to_owned(),
            };
            assert!(why.contains(&named), "{key}, {way}: {why}");
            assert!(why.contains(&key), "{key}, {way}: {why}");
        }
    }
}

#[test]
fn unsigned_responder_is_not_accepted_as_cell() {
    // The router is not a cell of this name.
    let router = router();
    for (key, glad) in bodies() {
        let known = Key::new(1);
        let mut cell = RogueParty::at(router.endpoint());
        let signer = Arc::clone(&known);
        cell.says(keys().capabilities(), &known, move || {
            line(&capabilities(&signer))
        });
        // It accepts the goal, and answers nothing more.
        if key != keys().goal() {
            cell.says(keys().goal(), &known, || {
                line(&json!({ "answer": "accepted", "known": false }))
            });
        }
        let mut stranger = RogueParty::at(router.endpoint());
        stranger.answers(key.clone(), move |_| vec![glad.clone()]);
        let client = client(&router);
        client.capabilities(SOON).unwrap();
        let why = refused(&client, &key).unwrap();
        assert!(why.contains("without a valid signature"), "{key}: {why}");
    }
}

#[test]
fn cell_that_follows_the_protocol_page_passes_every_check() {
    let (router, mut cell, key) = known_cell();
    for (asked, body) in bodies() {
        cell.says(asked, &key, move || body.clone());
    }
    let client = client(&router);
    assert_eq!(client.capabilities(SOON).unwrap().journal, key.name());
    let executed = run(&client, PATIENT).unwrap();
    assert!(
        matches!(&executed, GoalResult::EarlierReport(report) if report.outcome == Outcome::Succeeded),
        "{executed:?}"
    );
    assert_eq!(client.stop(SOON).unwrap(), ControlReply::Done);
    assert_eq!(
        client.cancel(&goal(0.04).encode().goal_id, SOON).unwrap(),
        ControlReply::AlreadyEnded
    );
}

/// Returns a client's error about a cell that answers the capabilities query like this.
fn capabilities_of(answer: impl Fn(&Key) -> Value + Send + Sync + 'static) -> CellError {
    let router = router();
    let key = Key::new(1);
    let mut cell = RogueParty::at(router.endpoint());
    let signer = Arc::clone(&key);
    cell.says(keys().capabilities(), &key, move || line(&answer(&signer)));
    client(&router).capabilities(SOON).unwrap_err()
}

#[test]
fn capabilities_are_checked_before_any_goal_is_sent() {
    fn with(key: &Key, name: &str, value: Value) -> Value {
        let mut said = capabilities(key);
        said[name] = value;
        said
    }
    let named = capabilities_of(|key| with(key, "cell", json!("other")));
    assert!(matches!(named, CellError::OtherName { .. }), "{named}");
    let journal = capabilities_of(|key| with(key, "journal", json!("00")));
    assert!(matches!(journal, CellError::Answer { .. }), "{journal}");
    let version = capabilities_of(|key| with(key, "protocol", json!(6)));
    assert!(
        matches!(version, CellError::Protocol { found: 6, .. }),
        "{version}"
    );
    for (ms, word) in [(0, "behind"), (u64::MAX / 4, "ahead")] {
        let clock = capabilities_of(move |key| with(key, "clock_unix_ms", json!(ms)));
        assert!(matches!(clock, CellError::Clock { .. }), "{clock}");
        assert!(clock.to_string().contains(word), "{clock}");
    }
    for err in [named, version] {
        assert!(err.hint().is_some(), "{err}");
    }
}

#[test]
fn previous_protocol_version_is_told_apart_from_an_unknown_peer() {
    let answered = |text: &'static str| {
        let router = router();
        let mut cell = RogueParty::at(router.endpoint());
        cell.answers(keys().capabilities(), move |_| {
            vec![text.as_bytes().to_vec()]
        });
        client(&router).capabilities(SOON).unwrap_err()
    };
    let old = answered("{\"protocol\":3,\"cell\":\"simulated\"}\n");
    assert!(matches!(old, CellError::Protocol { found: 3, .. }), "{old}");
    // As version 4 signed.
    let old = answered(
        "{\"journal\":\"00\",\"signature\":\"00\"}\n{\"protocol\":4,\"cell\":\"simulated\"}\n",
    );
    assert!(matches!(old, CellError::Protocol { found: 4, .. }), "{old}");
    assert!(old.hint().unwrap().starts_with("update the cell"));
    let now = format!("{{\"protocol\":{PROTOCOL}}}\n");
    let stranger = answered(now.leak());
    assert!(matches!(stranger, CellError::Unsigned { .. }), "{stranger}");
    assert!(
        stranger.to_string().contains("nothing was sent"),
        "{stranger}"
    );
}

#[test]
fn two_cells_that_answer_to_one_name_are_refused() {
    let cell = start();
    // Another program on the same router has the same name.
    let mut other = RogueParty::at(cell.endpoint());
    let key = Key::new(1);
    let signer = Arc::clone(&key);
    other.says(keys().capabilities(), &key, move || {
        line(&capabilities(&signer))
    });
    let err = connect(&cell).capabilities(SOON).unwrap_err();
    assert!(
        matches!(err, CellError::SeveralCells { count: 2, .. }),
        "{err}"
    );
    let text = err.to_string();
    assert!(
        text.contains("nothing was sent") && text.contains(&key.name()[..16]),
        "{text}"
    );
}

#[test]
fn replaced_cell_is_refused() {
    let router = router();
    let exchanged = Arc::new(AtomicBool::new(false));
    let pair = [Key::new(1), Key::new(2)];
    let (now, signers) = (Arc::clone(&exchanged), pair.clone());
    let signer = move || Arc::clone(&signers[usize::from(now.load(Ordering::SeqCst))]);
    let mut cell = RogueParty::at(router.endpoint());
    let of_capabilities = signer.clone();
    cell.answers(keys().capabilities(), move |query| {
        let key = of_capabilities();
        vec![key.sign(query, &line(&capabilities(&key)))]
    });
    cell.answers(keys().stop(), move |query| {
        vec![signer().sign(query, &line(&json!({ "answer": "done" })))]
    });
    let client = client(&router);
    client.capabilities(SOON).unwrap();
    assert_eq!(client.stop(SOON).unwrap(), ControlReply::Done);
    exchanged.store(true, Ordering::SeqCst);
    let err = client.capabilities(SOON).unwrap_err();
    assert!(matches!(err, CellError::OtherCell { .. }), "{err}");
    let err = client.stop(SOON).unwrap_err();
    assert!(matches!(err, CellError::Strangers { .. }), "{err}");
    assert!(err.to_string().contains("may be moving"), "{err}");
}

#[test]
fn a_second_cell_of_the_name_does_not_start() {
    let router = router();
    let config = |name: &str| SimulatedCellConfig {
        name: name.to_owned(),
        listen: String::new(),
        scene: scene(),
        arm: None,
        mismatch: ModelMismatch::default(),
        service: ServiceConfig {
            router: Some(router.endpoint().to_owned()),
            ..ServiceConfig::default()
        },
    };
    let first = SimulatedCell::start(config("simulated"), GRIPPER).unwrap();
    first.put_object("cube", cube());
    let refused = SimulatedCell::start(config("simulated"), GRIPPER);
    let err = refused.map(drop).unwrap_err();
    assert!(matches!(err, CellError::NameTaken { .. }), "{err}");
    assert!(
        err.to_string().contains("`simulated`") && err.hint().is_some(),
        "{err}"
    );
    let _other = SimulatedCell::start(config("other"), GRIPPER).unwrap();
    // The first is as it was.
    let report = execute(&client(&router), &goal(0.04));
    assert_eq!(report.outcome, Outcome::Succeeded);
    first.stop();
    let _again = SimulatedCell::start(config("simulated"), GRIPPER).unwrap();
}

#[test]
fn oversized_answer_is_refused() {
    let (router, mut cell, key) = known_cell();
    cell.says(keys().goal(), &key, || {
        line(&json!({ "answer": "accepted", "known": false }))
    });
    cell.says(keys().stop(), &key, || vec![b' '; 1 << 20]);
    // A message longer than any report does not arrive at all.
    cell.answers(keys().result("*"), |_| vec![vec![b' '; 66 << 20]]);
    let client = client(&router);
    let err = client.stop(SOON).unwrap_err();
    assert!(err.to_string().contains("which were not read"), "{err}");
    let executed = run(&client, IMPATIENT).unwrap();
    assert!(
        matches!(&executed, GoalResult::Unknown(why) if why.contains("no answer about the result within 500")),
        "{executed:?}"
    );
}

/// A cell that has accepted a goal, and one answer for each query of its report.
fn with_report(
    answer: impl Fn(&zenoh::query::Query, &Key) -> Vec<u8> + Send + Sync + 'static,
) -> (Router, RogueParty) {
    let (router, mut cell, key) = known_cell();
    cell.says(keys().goal(), &key, || {
        line(&json!({ "answer": "accepted", "known": false }))
    });
    cell.answers(keys().result("*"), move |query| vec![answer(query, &key)]);
    (router, cell)
}

#[test]
fn report_beyond_the_limit_is_asked_for_a_few_times_and_taken_without_samples() {
    let asked_n = Arc::new(AtomicUsize::new(0));
    let counted = Arc::clone(&asked_n);
    let head = |samples_n: u64| {
        line(&json!({
            "goal_id": goal(0.04).encode().goal_id, "outcome": "succeeded", "message": "held",
            "lift_m": 0.1, "joints": ["slide_left", "slide_right"], "samples_n": samples_n,
        }))
    };
    let (router, _cell) = with_report(move |query, key| {
        if query.parameters().get("samples") == Some("none") {
            return key.sign(query, &head(500_000));
        }
        counted.fetch_add(1, Ordering::SeqCst);
        vec![b' '; 66 << 20]
    });
    let executed = run(&client(&router), PATIENT).unwrap();
    let GoalResult::Report(report) = executed else {
        panic!("{executed:?}");
    };
    assert_eq!(report.outcome, Outcome::Succeeded);
    assert!(report.samples.is_empty());
    let said = report.message;
    for part in ["held (", "of 76 MB", "no sample confirms it", "64 MiB"] {
        assert!(said.contains(part), "{said}");
    }
    // A cell that sends so much may be late with an answer in between.
    let asked_n = asked_n.load(Ordering::SeqCst);
    assert!((3..=6).contains(&asked_n), "{asked_n}");
    // Samples that are few enough and do not arrive are no such case.
    let (router, _cell) = with_report(move |query, key| {
        if query.parameters().get("samples") == Some("none") {
            return key.sign(query, &head(5));
        }
        vec![b' '; 66 << 20]
    });
    let executed = run(&client(&router), PATIENT).unwrap();
    assert!(
        matches!(&executed, GoalResult::Unknown(why) if why.contains("do not arrive")),
        "{executed:?}"
    );
}

#[test]
fn genuine_answer_to_other_bytes_is_no_answer() {
    let cell = start();
    let mut between = RogueParty::at(cell.endpoint());
    let key = Key::new(1);
    // What a party in the path gets for nonsense, under the same nonce.
    let refusal = line(&json!({ "answer": "rejected", "code": "malformed", "reason": "" }));
    between.answers(keys().goal(), move |query| {
        vec![key.sign_for(query, b"nonsense", &refusal)]
    });
    let why = refused(&connect(&cell), &keys().goal()).unwrap();
    assert!(why.contains("altered on the way"), "{why}");
}

#[test]
fn one_cell_that_gives_two_answers_is_named_as_such() {
    let (router, mut cell, key) = known_cell();
    let signer = Arc::clone(&key);
    cell.answers(keys().goal(), move |query| {
        [true, false]
            .map(|known| {
                let word = line(&json!({ "answer": "accepted", "known": known }));
                signer.sign(query, &word)
            })
            .into()
    });
    let why = refused(&client(&router), &keys().goal()).unwrap();
    assert!(
        why.contains("the cell contradicts itself: 2 different answers"),
        "{why}"
    );
    assert!(!why.contains("a party other than the cell"), "{why}");
    cell.answers(keys().capabilities(), move |query| {
        let mut other = capabilities(&key);
        other["simulated"] = json!(false);
        vec![key.sign(query, &line(&other))]
    });
    let err = client(&router).capabilities(SOON).unwrap_err();
    assert!(
        matches!(err, CellError::DifferentAnswers { count: 2, .. }),
        "{err}"
    );
    assert!(err.hint().is_some());
}

#[test]
fn unlisted_refusal_is_a_refusal() {
    let (router, mut cell, key) = known_cell();
    cell.says(keys().goal(), &key, || {
        line(&json!({ "answer": "rejected", "code": "estop", "reason": "\u{202e}pots" }))
    });
    let done = run(&client(&router), PATIENT).unwrap();
    let GoalResult::Report(report) = done else {
        panic!("{done:?}");
    };
    let rejection = report.rejection.unwrap();
    assert_eq!(rejection.code, RejectionCode::Unlisted);
    assert_eq!(rejection.reason, "estop: \\u{202e}pots");
}

#[test]
fn unreadable_answers_leave_the_outcome_unknown() {
    for (asked, wrong) in [
        (keys().goal(), "{}\n"),
        (keys().goal(), ""),
        (keys().goal(), "{\"answer\":\"perhaps\"}\n"),
        (keys().result("*"), "{}\n"),
        (keys().result("*"), "\u{0}"),
        (keys().result("*"), "{\"answer\":\"done\"}\n"),
        (keys().result("*"), "{\"answer\":\"never_taken\"}\n"),
    ] {
        let (router, mut cell, key) = known_cell();
        if asked != keys().goal() {
            cell.says(keys().goal(), &key, || {
                line(&json!({ "answer": "accepted", "known": false }))
            });
        }
        cell.says(asked.clone(), &key, move || wrong.as_bytes().to_vec());
        let client = client(&router);
        let executed = run(&client, PATIENT).unwrap();
        let GoalResult::Unknown(why) = executed else {
            panic!("{asked} {wrong}: {executed:?}");
        };
        assert!(
            why.contains("cannot be read") || why.contains("now denies it"),
            "{asked} {wrong}: {why}"
        );
    }
}

#[test]
fn silent_cell_leaves_the_outcome_unknown() {
    let router = router();
    let key = Key::new(1);
    let mut mute = RogueParty::at(router.endpoint());
    let signer = Arc::clone(&key);
    mute.says(keys().capabilities(), &key, move || {
        line(&capabilities(&signer))
    });
    mute.says(keys().goal(), &key, || {
        line(&json!({ "answer": "accepted", "known": false }))
    });
    let client = client(&router);
    let executed = run(&client, IMPATIENT).unwrap();
    assert!(
        matches!(&executed, GoalResult::Unknown(why) if why.contains("no answer about the result within 500")),
        "{executed:?}"
    );
}

#[test]
fn watcher_refuses_two_cells_of_one_name() {
    let cell = start();
    let mut stranger = RogueParty::at(cell.endpoint());
    let key = Key::new(7);
    let signer = Arc::clone(&key);
    let made_up = Arc::new(AtomicBool::new(true));
    let lies = Arc::clone(&made_up);
    let line_of = json!({ "journal": key.name(), "results_n": 1 });
    let lie = json!({
        "journal": key.name(), "result_n": 0, "goal_id": "00", "outcome": "succeeded",
        "message": "", "lift_m": 0.1,
    });
    stranger.answers(keys().results(), move |query| {
        let body = [line(&line_of), line(&lie)].concat();
        let answer = signer.sign(query, &body);
        if lies.load(Ordering::SeqCst) {
            vec![answer]
        } else {
            Vec::new()
        }
    });
    let mut watcher = Watcher::start(None, cell.endpoint(), "simulated", SOON).unwrap();
    let goal = goal(0.04);
    execute(&connect(&cell), &goal);
    let mut seen = |wait: Duration| {
        let mut outcomes = Vec::new();
        while let Some(next) = watcher.next(wait) {
            if let WatchEvent::Outcome(outcome) = next {
                outcomes.push(outcome.goal_id);
            }
        }
        (outcomes, watcher.counts().foreign_n)
    };
    let (outcomes, foreign_n) = seen(SHORT);
    assert!(outcomes.is_empty() && foreign_n > 0, "{outcomes:?}");
    made_up.store(false, Ordering::SeqCst);
    let (outcomes, _) = seen(Duration::from_secs(2));
    assert_eq!(outcomes, [goal.encode().goal_id]);
    // Its answer is signed, and has the format of the protocol's page.
    let answer = stranger.ask(&format!("{}?from=0;nonce=1", keys().results()));
    assert!(body(&answer).starts_with(b"{\"journal\":"));
}
