//! A party in the path between dispatcher and cell, which alters, drops, repeats, delays, replays and forges.

use std::{
    collections::BTreeMap,
    fs,
    sync::{Arc, Mutex},
    time::Duration,
};

use cell::{
    Address, CellClient, GoalMessage, GoalResult, Keys, Patience, PublicKey, Router, ServiceConfig,
    SigningKey, Terms, UncheckedReport, subscribe,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use schemas::executions::Outcome;
use zenoh::{
    Session, Wait,
    query::{Query, Queryable},
};

use crate::{
    instant::Instant,
    lab::{LISTEN, SOON, body, goal, robot},
};

/// Goals sent through the party in the path, unless `PIPELINE_GOALS` says otherwise.
const GOALS: u32 = 60;
/// Short, because many answers do not come.
const IMPATIENT: Patience = Patience {
    answer: Duration::from_millis(1500),
    result: Duration::from_millis(1500),
};

/// The party: a session on each side, and all that went past it.
struct Between {
    to_cell: Session,
    state: Mutex<State>,
    /// Its own key, for goals that it makes itself.
    key: SigningKey,
}

struct State {
    rng: ChaCha8Rng,
    /// Goals that the dispatcher sent.
    goals: Vec<Vec<u8>>,
    /// Answers of the cell, by key.
    answers: BTreeMap<String, Vec<Vec<u8>>>,
}

impl Between {
    /// Answers the dispatcher's query: mostly as the cell does, and else in one of its ways.
    fn pass(&self, query: &Query) {
        let payload = query
            .payload()
            .map(|payload| payload.to_bytes().into_owned());
        let payload = payload.unwrap_or_default();
        let key = query.key_expr().as_str().to_owned();
        let is_goal = key.ends_with("/goal");
        let (way, sent) = {
            let mut state = self.state.lock().unwrap();
            if is_goal {
                state.goals.push(payload.clone());
            }
            let way = state.rng.random_range(0..18);
            (way, self.meddled(&mut state, way, &key, payload.clone()))
        };
        let Some(sent) = sent else { return };
        let selector = format!("{key}?{}", query.parameters().as_str());
        let mut answer = self.ask(&selector, &sent);
        match way {
            // The answer is lost, although the cell has it.
            7 => return,
            // The goal arrives a second time.
            8 => drop(self.ask(&selector, &sent)),
            // The answer is altered.
            9 => {
                if let Some(byte) = answer.as_mut().and_then(|answer| answer.last_mut()) {
                    *byte ^= 1;
                }
            }
            // An old answer to the same key.
            10 => {
                let state = self.state.lock().unwrap();
                answer = state.answers.get(&key).and_then(|all| all.first().cloned());
            }
            // A genuine answer to nonsense, under the same nonce.
            11 => answer = self.ask(&selector, b"nonsense"),
            _ => {}
        }
        let Some(answer) = answer else { return };
        let mut state = self.state.lock().unwrap();
        state.answers.entry(key).or_default().push(answer.clone());
        drop(state);
        let _sent = query.reply(query.key_expr(), answer).wait();
    }

    /// Returns the payload that it passes on; nothing if it drops the query.
    fn meddled(
        &self,
        state: &mut State,
        way: u32,
        key: &str,
        mut payload: Vec<u8>,
    ) -> Option<Vec<u8>> {
        let is_goal = key.ends_with("/goal");
        match way {
            0 => return None,
            // A byte is changed.
            1 if is_goal => {
                let at = state.rng.random_range(0..payload.len());
                payload[at] ^= 1 << state.rng.random_range(0..8);
            }
            // Another motion under this address, sealed by its own key.
            2 if is_goal => {
                let (message, mut goal) = GoalMessage::decode(&payload).unwrap();
                goal.attempt += 1000;
                let address = Address {
                    simulated_only: false,
                    ..message.address
                };
                payload = GoalMessage::new(goal.encode(), address, &self.key).bytes;
            }
            // The same motion, addressed anew and sealed by its own key.
            3 if is_goal => {
                let (message, _) = GoalMessage::decode(&payload).unwrap();
                payload = GoalMessage::new(message.encoded, message.address, &self.key).bytes;
            }
            // An earlier goal instead.
            4 if is_goal => payload.clone_from(&state.goals[0]),
            // It is late.
            5 => std::thread::sleep(Duration::from_millis(700)),
            // Something else besides.
            6 => {
                for goal in state.goals.iter().rev().take(3) {
                    drop(self.ask("cgf/cell/simulated/goal?nonce=0", goal));
                }
            }
            _ => {}
        }
        Some(payload)
    }

    /// Asks the cell.
    fn ask(&self, selector: &str, payload: &[u8]) -> Option<Vec<u8>> {
        let replies = self.to_cell.get(selector).payload(payload).timeout(SOON);
        let reply = replies.wait().ok()?.recv().ok()?.into_result().ok()?;
        Some(reply.payload().to_bytes().into_owned())
    }
}

#[test]
fn nothing_moves_or_is_reported_that_was_not_sent_or_said() {
    let goals_n = std::env::var("PIPELINE_GOALS").map_or(GOALS, |n| n.parse().unwrap());
    let dispatcher = SigningKey::fresh().unwrap();
    let journal = tempfile::tempdir().unwrap();
    let machine = Instant::new(true);
    let cell = machine.serve(ServiceConfig {
        journal: Some(journal.path().to_owned()),
        dispatchers: vec![dispatcher.name().parse::<PublicKey>().unwrap()],
        ..ServiceConfig::default()
    });
    let other = Instant::new(true);
    let other_cell = other.serve(ServiceConfig::default());
    // The dispatcher's side, where the party in the path is all that answers.
    let router = Router::start(LISTEN, None).unwrap();
    let between = Arc::new(Between {
        to_cell: subscribe(cell.endpoint(), "nothing", SOON).unwrap().0,
        state: Mutex::new(State {
            rng: ChaCha8Rng::seed_from_u64(44),
            goals: Vec::new(),
            answers: BTreeMap::new(),
        }),
        key: SigningKey::fresh().unwrap(),
    });
    let (side, _) = subscribe(router.endpoint(), "nothing", SOON).unwrap();
    let keys = Keys::new("simulated").unwrap();
    let passing: Vec<Queryable<()>> = [keys.capabilities(), keys.goal(), keys.result("*")]
        .map(|key| {
            let between = Arc::clone(&between);
            let queryable = side.declare_queryable(key).callback(move |query| {
                between.pass(&query);
            });
            queryable.wait().unwrap()
        })
        .into();
    let client = CellClient::connect(router.endpoint(), "simulated", SOON).unwrap();
    let client = client.signing_with(dispatcher);
    let mut ended: BTreeMap<&str, u32> = BTreeMap::new();
    let mut ids = Vec::new();
    for attempt in 1..=goals_n {
        let goal = cell::Goal {
            attempt,
            ..goal(0.04)
        };
        let id = goal.encode().goal_id;
        ids.push(id.clone());
        let Ok(there) = client.capabilities(IMPATIENT.answer) else {
            *ended.entry("not sent").or_default() += 1;
            continue;
        };
        let terms = Terms::new(there, false);
        let done = client.execute(&goal, &terms, &robot(), IMPATIENT, &());
        let times = machine.executed().iter().filter(|&it| *it == id).count();
        assert!(times <= 1, "{id} moved {times} times");
        let word = match done {
            Err(_) => {
                assert_eq!(times, 0, "{id} moved and was not sent");
                "not sent"
            }
            Ok(GoalResult::Unknown(_)) => "unknown",
            Ok(GoalResult::Report(report) | GoalResult::EarlierReport(report)) => {
                let is_refused = report.outcome == Outcome::Rejected;
                assert_eq!(times, usize::from(!is_refused), "{report:?}");
                if !is_refused {
                    let kept = fs::read(journal.path().join(format!("{id}.report"))).unwrap();
                    let kept = UncheckedReport::from_bytes(&kept).unwrap();
                    assert_eq!(kept.check(&id, &goal, &robot()).unwrap(), report);
                }
                report.outcome.as_str()
            }
            Ok(GoalResult::TooLong { .. }) => panic!("too long"),
        };
        *ended.entry(word).or_default() += 1;
    }
    println!("{ended:?}, {} executed", machine.executed().len());
    // What the party replays once all is over moves nothing either, here or at another cell.
    let before = machine.executed();
    let (to_other, _) = subscribe(other_cell.endpoint(), "nothing", SOON).unwrap();
    let goals = between.state.lock().unwrap().goals.clone();
    for sent in &goals {
        drop(between.ask("cgf/cell/simulated/goal?nonce=0", sent));
        let replies = to_other.get(keys.goal()).payload(sent).timeout(SOON);
        let reply = replies
            .wait()
            .unwrap()
            .recv()
            .unwrap()
            .into_result()
            .unwrap();
        let said = String::from_utf8_lossy(body(&reply.payload().to_bytes())).into_owned();
        assert!(
            said.contains("\"rejected\"") && said.contains("\"address\""),
            "{said}"
        );
    }
    assert!(other.executed().is_empty());
    let known = |id: &String| before.contains(id) || ids.contains(id);
    assert!(machine.executed().iter().all(known));
    // What was executed was sent, byte for byte.
    for id in machine.executed() {
        let taken = fs::read(journal.path().join(format!("{id}.goal"))).unwrap();
        assert!(goals.contains(&taken), "{id} was not sent so");
    }
    assert!(
        ended.get("succeeded").is_some_and(|&n| n > goals_n / 10),
        "{ended:?}"
    );
    assert!(ended.get("unknown").is_some_and(|&n| n > 0), "{ended:?}");
    drop(passing);
}
