//! A cell implemented from the protocol's page alone, and impostors that only claim to be a cell.

use std::{
    sync::Arc,
    time::{SystemTime, UNIX_EPOCH},
};

use cell::{PROTOCOL, robot_digest, subscribe};
use ring::signature::{Ed25519KeyPair, KeyPair};
use serde_json::{Value, json};
use zenoh::{
    Session, Wait,
    query::{Query, Queryable},
};

use crate::lab::{GRIPPER, SOON, joints};

/// The key of a journal.
pub(crate) struct Key(Ed25519KeyPair);

impl Key {
    pub(crate) fn new(seed: u8) -> Arc<Self> {
        Arc::new(Self(
            Ed25519KeyPair::from_seed_unchecked(&[seed; 32]).unwrap(),
        ))
    }

    pub(crate) fn name(&self) -> String {
        hex(self.0.public_key().as_ref())
    }

    /// Returns a signed answer to a query.
    pub(crate) fn sign(&self, query: &Query, body: &[u8]) -> Vec<u8> {
        let payload = query.payload().map(|payload| payload.to_bytes());
        self.sign_for(query, &payload.unwrap_or_default(), body)
    }

    /// As [`Key::sign`], in answer to other bytes than those of the query.
    pub(crate) fn sign_for(&self, query: &Query, payload: &[u8], body: &[u8]) -> Vec<u8> {
        let [asked, digest] = [payload, body].map(|bytes| blake3::hash(bytes).to_hex().to_string());
        let (key, parameters) = (query.key_expr(), query.parameters().as_str());
        let text = format!("cgf cell answer\n{key}\n{parameters}\n{asked}\n{digest}");
        let signature = hex(self.0.sign(text.as_bytes()).as_ref());
        let line = json!({ "journal": self.name(), "asked": asked, "signature": signature });
        [format!("{line}\n").as_bytes(), body].concat()
    }
}

fn hex(bytes: &[u8]) -> String {
    let digits = bytes.iter().map(|byte| format!("{byte:02x}"));
    digits.collect::<Vec<_>>().concat()
}

/// Returns the capabilities of the cell `simulated` with this journal.
pub(crate) fn capabilities(key: &Key) -> Value {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    json!({
        "protocol": PROTOCOL,
        "cell": "simulated",
        "journal": key.name(),
        "clock_unix_ms": u64::try_from(since.as_millis()).unwrap(),
        "simulated": true,
        "stopped": false,
        "executing": "",
        "robot": robot_digest(GRIPPER),
        "controllers": [
            { "controller": "palm", "rate_hz": 100.0 },
            { "controller": "hand", "joints": joints(), "rate_hz": 100.0 },
        ],
        "max_goal_bytes": 1_000_000,
        "gap": "it is somebody else's",
        "real_time": false,
    })
}

pub(crate) fn line(value: &Value) -> Vec<u8> {
    format!("{value}\n").into_bytes()
}

/// A party with a session.
pub(crate) struct RogueParty {
    session: Session,
    queryables: Vec<Queryable<()>>,
}

impl RogueParty {
    pub(crate) fn at(endpoint: &str) -> Self {
        Self {
            session: subscribe(endpoint, "nothing", SOON).unwrap().0,
            queryables: Vec::new(),
        }
    }

    /// Answers queries for `key` with the messages that `answers` returns.
    pub(crate) fn answers(
        &mut self,
        key: String,
        answers: impl Fn(&Query) -> Vec<Vec<u8>> + Send + Sync + 'static,
    ) {
        let queryable = self.session.declare_queryable(key).callback(move |query| {
            for answer in answers(&query) {
                let _sent = query.reply(query.key_expr(), answer).wait();
            }
        });
        self.queryables.push(queryable.wait().unwrap());
    }

    /// Answers as a cell with this journal does.
    pub(crate) fn says(
        &mut self,
        asked: String,
        key: &Arc<Key>,
        body: impl Fn() -> Vec<u8> + Send + Sync + 'static,
    ) {
        let key = Arc::clone(key);
        self.answers(asked, move |query| vec![key.sign(query, &body())]);
    }

    /// Sends a query; returns the first answer.
    pub(crate) fn ask(&self, selector: &str) -> Vec<u8> {
        let replies = self.session.get(selector).timeout(SOON).wait().unwrap();
        let reply = replies.recv().unwrap().into_result().unwrap();
        reply.payload().to_bytes().into_owned()
    }
}
