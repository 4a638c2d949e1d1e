//! A goal on its way: addressed to one cell and journal, and signed by its dispatcher.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

use crate::{EncodedGoal, Goal, PROTOCOL, Rejection, RejectionCode, SigningKey, signature, wire};

/// Largest clock difference between a dispatcher and a cell, in milliseconds.
pub const CLOCKS_MS: u64 = 1000;
/// Longest validity of a goal, in milliseconds: a day.
const MAX_VALID_MS: u64 = 86_400_000;

/// A goal's addressee, its sender, and its terms.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Address {
    /// Name of the cell that is to execute the goal.
    pub cell: String,
    /// That cell's journal.
    pub journal: String,
    /// The dispatcher's name in its heartbeats: the only ones that count while the goal executes.
    pub dispatcher: String,
    /// Whether nothing real may move for the goal.
    pub simulated_only: bool,
    /// Send time by the dispatcher's clock, in milliseconds since 1970.
    pub sent_unix_ms: u64,
    /// Start deadline by the dispatcher's clock, in milliseconds since 1970.
    pub valid_until_unix_ms: u64,
}

/// A goal as it is sent.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GoalMessage {
    /// The goal, whatever its address.
    pub encoded: EncodedGoal,
    /// BLAKE3 of everything after the first line: what the dispatcher signed.
    pub digest: String,
    /// Its address.
    pub address: Address,
    /// Public key of the dispatcher that signed it.
    pub dispatcher_key: String,
    /// The whole message.
    pub bytes: Vec<u8>,
}

/// The protocol version, which is readable in messages of every version.
#[derive(Deserialize)]
pub(crate) struct Version {
    pub(crate) protocol: u64,
}

/// First line of a message.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Seal {
    protocol: u32,
    /// BLAKE3 of what follows.
    digest: String,
    /// The dispatcher's, of the digest.
    signature: String,
}

/// Second line of a message; the goal follows.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct AddressLine {
    cell: String,
    journal: String,
    goal_id: String,
    dispatcher: String,
    dispatcher_key: String,
    simulated_only: bool,
    sent_unix_ms: u64,
    valid_until_unix_ms: u64,
}

impl Address {
    /// Returns the address of a goal that is sent now and may start within `valid`.
    pub fn now(
        cell: &str,
        journal: &str,
        dispatcher: &str,
        simulated_only: bool,
        valid: Duration,
    ) -> Self {
        let sent_unix_ms = now_unix_ms();
        let valid_ms = u64::try_from(valid.as_millis()).unwrap_or(u64::MAX);
        Self {
            cell: cell.to_owned(),
            journal: journal.to_owned(),
            dispatcher: dispatcher.to_owned(),
            simulated_only,
            sent_unix_ms,
            valid_until_unix_ms: sent_unix_ms.saturating_add(valid_ms),
        }
    }

    /// Checks that a goal arrives in time.
    ///
    /// # Errors
    ///
    /// Fails with the cell's refusal, given the time by its own clock: `expired` for a goal that
    /// was delayed too long, `clock` where a delay cannot explain the times.
    pub(crate) fn check_time(&self, now_unix_ms: u64) -> Result<(), Rejection> {
        let (sent, until) = (self.sent_unix_ms, self.valid_until_unix_ms);
        let seconds = |from: u64, to: u64| to.saturating_sub(from) as f64 / 1000.0;
        let refuse = |code: RejectionCode, reason: String| Err(Rejection::new(code, reason));
        let valid_ms = until.saturating_sub(sent);
        if sent > now_unix_ms.saturating_add(CLOCKS_MS) {
            return refuse(
                RejectionCode::Clock,
                format!(
                    "by the cell's clock the goal was sent {} s in the future",
                    seconds(now_unix_ms, sent)
                ),
            );
        }
        if until < sent || valid_ms > MAX_VALID_MS {
            return refuse(
                RejectionCode::Clock,
                format!(
                    "the goal is valid until {} s after it was sent, expected 0 to {}",
                    until as f64 / 1000.0 - sent as f64 / 1000.0,
                    MAX_VALID_MS / 1000
                ),
            );
        }
        if now_unix_ms > until {
            let late_s = seconds(until, now_unix_ms);
            // The sender has waited for the whole validity without an answer.
            return if now_unix_ms - until > valid_ms.saturating_add(CLOCKS_MS) {
                refuse(
                    RejectionCode::Clock,
                    format!(
                        "by the cell's clock the goal expired {late_s} s ago; compare the clocks"
                    ),
                )
            } else {
                refuse(
                    RejectionCode::Expired,
                    format!("the goal came {late_s} s after the time until which it was valid"),
                )
            };
        }
        Ok(())
    }
}

impl GoalMessage {
    /// Addresses a goal and signs it with the dispatcher's key.
    pub fn new(encoded: EncodedGoal, address: Address, key: &SigningKey) -> Self {
        let mut rest = wire::line(&AddressLine {
            cell: address.cell.clone(),
            journal: address.journal.clone(),
            goal_id: encoded.goal_id.clone(),
            dispatcher: address.dispatcher.clone(),
            dispatcher_key: key.name().to_owned(),
            simulated_only: address.simulated_only,
            sent_unix_ms: address.sent_unix_ms,
            valid_until_unix_ms: address.valid_until_unix_ms,
        });
        rest.extend_from_slice(&encoded.bytes);
        let digest = blake3::hash(&rest).to_hex().to_string();
        let mut bytes = wire::line(&Seal {
            protocol: PROTOCOL,
            signature: key.sign_goal(&digest),
            digest: digest.clone(),
        });
        bytes.extend_from_slice(&rest);
        Self {
            encoded,
            digest,
            address,
            dispatcher_key: key.name().to_owned(),
            bytes,
        }
    }

    /// Parses a message and checks that it is intact: version, digest, id, form, and the dispatcher's
    /// signature.
    ///
    /// # Errors
    ///
    /// Fails with the cell's refusal of such a message.
    pub fn decode(bytes: &[u8]) -> Result<(Self, Goal), Rejection> {
        let (Version { protocol }, _) = wire::split_line("seal", bytes)?;
        if protocol != u64::from(PROTOCOL) {
            let older = if protocol < u64::from(PROTOCOL) {
                "the dispatcher"
            } else {
                "the cell"
            };
            return Err(Rejection::new(
                RejectionCode::Protocol,
                format!("the cell speaks version {PROTOCOL}, the goal {protocol}: update {older}"),
            ));
        }
        let (seal, rest): (Seal, &[u8]) = wire::split_line("seal", bytes)?;
        if seal.digest != blake3::hash(rest).to_hex().as_str() {
            return Err(Rejection::new(
                RejectionCode::Digest,
                "the digest is not that of the bytes".to_owned(),
            ));
        }
        let (line, content): (AddressLine, &[u8]) = wire::split_line("address", rest)?;
        let (encoded, goal) = EncodedGoal::decode(content)?;
        if line.goal_id != encoded.goal_id {
            return Err(Rejection::new(
                RejectionCode::Digest,
                "the id is not that of the motion".to_owned(),
            ));
        }
        if !signature::verifies_goal(&line.dispatcher_key, &seal.digest, &seal.signature) {
            return Err(Rejection::new(
                RejectionCode::Dispatcher,
                "the signature is not that of the dispatcher's key".to_owned(),
            ));
        }
        let message = Self {
            encoded,
            digest: seal.digest,
            address: Address {
                cell: line.cell,
                journal: line.journal,
                dispatcher: line.dispatcher,
                simulated_only: line.simulated_only,
                sent_unix_ms: line.sent_unix_ms,
                valid_until_unix_ms: line.valid_until_unix_ms,
            },
            dispatcher_key: line.dispatcher_key,
            bytes: bytes.to_vec(),
        };
        Ok((message, goal))
    }
}

/// Returns the time used for expiry checks.
#[expect(
    clippy::disallowed_methods,
    reason = "a goal's end is exchanged between two machines, and is in no artifact"
)]
pub(crate) fn now() -> SystemTime {
    SystemTime::now()
}

/// Returns that time in milliseconds since 1970.
pub(crate) fn now_unix_ms() -> u64 {
    let since_1970 = now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since_1970.as_millis()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::goal::tests::goal;

    fn message(goal: &Goal) -> GoalMessage {
        let address = Address::now("lab", "aa", "me", true, Duration::from_secs(1));
        GoalMessage::new(goal.encode(), address, &SigningKey::fresh().unwrap())
    }

    fn code(bytes: &[u8]) -> RejectionCode {
        GoalMessage::decode(bytes).unwrap_err().code
    }

    #[test]
    fn a_message_round_trips_and_keeps_the_goals_id() {
        let goal = goal();
        let sent = message(&goal);
        let (again, opened) = GoalMessage::decode(&sent.bytes).unwrap();
        assert_eq!((&again, &opened), (&sent, &goal));
        let elsewhere = message(&goal);
        assert_ne!(elsewhere.bytes, sent.bytes);
        assert_eq!(elsewhere.encoded.goal_id, sent.encoded.goal_id);
    }

    #[test]
    fn a_goal_changed_or_cut_anywhere_is_refused() {
        let bytes = message(&goal()).bytes;
        for at in 0..bytes.len() {
            let mut changed = bytes.clone();
            changed[at] ^= 1;
            assert!(GoalMessage::decode(&changed).is_err(), "byte {at} changed");
            assert!(GoalMessage::decode(&bytes[..at]).is_err(), "cut at {at}");
        }
    }

    /// Another party can make a goal of its own, but not in this dispatcher's name.
    #[test]
    fn a_goal_that_another_party_sealed_anew_is_not_the_dispatchers() {
        let sent = message(&goal());
        let text = String::from_utf8_lossy(&sent.bytes);
        let (_, rest) = sent.bytes.split_at(text.find('\n').unwrap() + 1);
        let rest = [
            String::from_utf8_lossy(rest)
                .lines()
                .next()
                .unwrap()
                .replace("\"simulated_only\":true", "\"simulated_only\":false")
                .as_bytes(),
            b"\n",
            &sent.encoded.bytes,
        ]
        .concat();
        let digest = blake3::hash(&rest).to_hex().to_string();
        let signature = SigningKey::fresh().unwrap().sign_goal(&digest);
        let seal = Seal {
            protocol: PROTOCOL,
            digest,
            signature,
        };
        let forged = [wire::line(&seal), rest].concat();
        assert_eq!(code(&forged), RejectionCode::Dispatcher);
    }

    #[test]
    fn late_goal_is_distinguished_from_clock_offset() {
        const NOW: u64 = 1_800_000_000_000;
        let code = |sent: i64, until: i64| {
            let at = |offset: i64| NOW.saturating_add_signed(offset);
            let address = Address {
                sent_unix_ms: at(sent),
                valid_until_unix_ms: at(until),
                ..Address::now("lab", "aa", "me", true, Duration::ZERO)
            };
            address.check_time(NOW).err().map(|refused| refused.code)
        };
        let (clock, expired) = (Some(RejectionCode::Clock), Some(RejectionCode::Expired));
        for (sent, until, expected) in [
            (0, 10_000, None),
            (-9_999, 1, None),
            (900, 10_900, None),
            (-10_001, -1, expired),
            (-20_000, -10_000, expired),
            (-22_000, -12_000, clock),
            (-3_600_000, -3_590_000, clock),
            (1_001, 11_001, clock),
            (3_600_000, 3_610_000, clock),
            (0, 86_400_001, clock),
            (0, i64::MAX, clock),
            (0, -1, clock),
            (i64::MIN, i64::MIN, clock),
        ] {
            assert_eq!(code(sent, until), expected, "{sent} to {until}");
        }
    }

    #[test]
    fn refusals_name_the_reason() {
        assert_eq!(code(b""), RejectionCode::Malformed);
        assert_eq!(code(b"{}\n{}\n"), RejectionCode::Malformed);
        let mut strange = goal();
        strange.hand.points[2].time_s = f64::NAN;
        assert_eq!(code(&message(&strange).bytes), RejectionCode::Malformed);
        for (version, update) in [(4, "update the dispatcher"), (9, "update the cell")] {
            let line = format!("{{\"protocol\":{version},\"goal_id\":\"\"}}\n");
            let refused = GoalMessage::decode(line.as_bytes()).unwrap_err();
            assert_eq!(refused.code, RejectionCode::Protocol);
            assert!(refused.reason.ends_with(update), "{refused:?}");
        }
    }
}
