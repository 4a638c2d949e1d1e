//! Messages that were refused: repeated, they get the same answer, whatever has changed since.
//!
//! A dispatcher that was told of a refusal counts on it that nothing moves; another party that repeats the
//! message later must not make it move after all. A restarted cell has forgotten them: by then most have
//! expired.

use std::collections::BTreeMap;

use crate::{GoalMessage, Rejection, message::now_unix_ms};

/// Most refusals kept; then the one that expires first is dropped.
const KEPT: usize = 4096;

/// Refusals of messages that are still valid, by the digests that their dispatchers signed.
#[derive(Debug, Default)]
pub(super) struct Refused(BTreeMap<String, Refusal>);

#[derive(Debug)]
struct Refusal {
    valid_until_unix_ms: u64,
    rejection: Rejection,
}

impl Refused {
    /// Fails with the refusal of a message that was refused before.
    pub(super) fn check(&self, message: &GoalMessage) -> Result<(), Rejection> {
        let refusal = self.0.get(&message.digest);
        refusal.map_or(Ok(()), |refusal| Err(refusal.rejection.clone()))
    }

    /// Keeps a refusal until the message has expired.
    pub(super) fn keep(&mut self, digest: String, valid_until_unix_ms: u64, why: &Rejection) {
        let now = now_unix_ms();
        self.0
            .retain(|_, refusal| refusal.valid_until_unix_ms >= now);
        if valid_until_unix_ms >= now {
            let refusal = Refusal {
                valid_until_unix_ms,
                rejection: why.clone(),
            };
            self.0.insert(digest, refusal);
        }
        if self.0.len() > KEPT {
            let first = self
                .0
                .iter()
                .min_by_key(|(_, kept)| kept.valid_until_unix_ms);
            if let Some(digest) = first.map(|(digest, _)| digest.clone()) {
                self.0.remove(&digest);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::{Address, RejectionCode, SigningKey, goal::tests::goal};

    #[test]
    fn a_refused_message_stays_refused_until_it_expires() {
        let busy = Rejection::new(RejectionCode::Busy, "it moves".to_owned());
        let message = |dispatcher: &str| {
            let address = Address::now("lab", "aa", dispatcher, true, Duration::from_mins(1));
            GoalMessage::new(goal().encode(), address, &SigningKey::fresh().unwrap())
        };
        let (sent, other) = (message("me"), message("you"));
        let mut refused = Refused::default();
        let until = sent.address.valid_until_unix_ms;
        refused.keep(sent.digest.clone(), until, &busy);
        refused.keep("expired".to_owned(), 1, &busy);
        assert_eq!(refused.check(&sent), Err(busy.clone()));
        assert_eq!(refused.check(&other), Ok(()));
        assert_eq!(refused.0.len(), 1);
        for number in 0..=KEPT {
            refused.keep(number.to_string(), until + 1, &busy);
        }
        assert_eq!(refused.0.len(), KEPT);
        assert_eq!(refused.check(&sent), Ok(()));
    }
}
