//! Making units outside this process.

use std::collections::BTreeSet;

use crate::{
    digest::Digest,
    error::Failure,
    event::{Event, Events},
    name::{NodeName, UnitName},
};

/// Makes units in other processes, possibly on other machines, which share only the store and the
/// pipeline file with this one.
pub trait RemoteWorker: Sync {
    /// Makes one unit, passes every event to the relay, and returns when the unit's process has
    /// ended. `forced` makes it even if its result is in the store.
    ///
    /// # Errors
    ///
    /// Fails if the process cannot be run, dies, or breaks the protocol.
    fn make(&self, unit: &UnitName, forced: Forced, relay: &mut Relay) -> Result<(), Failure>;
}

/// Whether a unit is made even if its result is in the store.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Forced {
    /// The unit is made again.
    Yes,
    /// The stored result is used.
    No,
}

/// Characters of a refused line that its error quotes.
const QUOTED: usize = 200;

/// Checks the events of a unit made in another process and forwards them.
pub struct Relay<'a> {
    unit: &'a UnitName,
    /// Outputs that the unit depends on: their artifacts may be reported as damaged.
    upstream: BTreeSet<&'a NodeName>,
    events: &'a Events<'a>,
    repaired: BTreeSet<UnitName>,
    end: Option<Result<Done, Failure>>,
}

/// A process's report of a unit whose result it has stored.
pub(crate) struct Done {
    pub(crate) fingerprint: Digest,
    pub(crate) made_now: bool,
}

impl<'a> Relay<'a> {
    pub(crate) fn new(
        unit: &'a UnitName,
        upstream: BTreeSet<&'a NodeName>,
        events: &'a Events<'a>,
    ) -> Self {
        Self {
            unit,
            upstream,
            events,
            repaired: BTreeSet::new(),
            end: None,
        }
    }

    /// Accepts an event as a line of JSON.
    ///
    /// # Errors
    ///
    /// Fails if the line is not an event, or not one that this unit can send.
    pub fn line(&mut self, line: &str) -> Result<(), Failure> {
        let event = serde_json::from_str(line)
            .map_err(|err| self.refuse(line, &format!("is not an event: {err}")))?;
        if self.end.is_some() {
            return Err(self.refuse(line, "follows the last event"));
        }
        match event {
            Event::UnitDone {
                unit,
                fingerprint,
                made_now,
                ..
            } if unit == *self.unit => {
                self.end = Some(Ok(Done {
                    fingerprint,
                    made_now,
                }));
            }
            Event::UnitFailed {
                unit,
                message,
                hint,
                left_out,
            } if unit == *self.unit => {
                self.end = Some(Err(Failure::Remote {
                    message,
                    hint,
                    left_out: left_out.map(Into::into),
                }));
            }
            Event::UnitDamaged { ref unit } if self.upstream.contains(&unit.node) => {
                self.repaired.insert(unit.clone());
                (self.events)(&event);
            }
            Event::UnitWaiting { ref unit, .. } | Event::UnitProgress { ref unit, .. }
                if unit == self.unit || self.repaired.contains(unit) =>
            {
                (self.events)(&event);
            }
            Event::UnitDone { ref unit, .. } if self.repaired.contains(unit) => {
                (self.events)(&event);
            }
            _ => return Err(self.refuse(line, "is not an event of this unit")),
        }
        Ok(())
    }

    /// Returns whether the last event has come.
    pub fn is_over(&self) -> bool {
        self.end.is_some()
    }

    /// Returns the upstream units whose damaged artifacts were rebuilt, and the end of this unit if
    /// one was reported.
    pub(crate) fn finish(self) -> (BTreeSet<UnitName>, Option<Result<Done, Failure>>) {
        (self.repaired, self.end)
    }

    fn refuse(&self, line: &str, reason: &str) -> Failure {
        let quoted: String = line.chars().take(QUOTED).collect();
        Failure::Protocol {
            unit: self.unit.clone(),
            message: format!("`{quoted}` {reason}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;
    use crate::event::Fraction;

    fn unit(stage: &str) -> UnitName {
        let node = NodeName::parse(&format!("{stage}.made")).unwrap();
        UnitName::new(&node, &"p".parse().unwrap())
    }

    fn progress(stage: &str) -> Event {
        Event::UnitProgress {
            unit: unit(stage),
            fraction: Fraction::nearest(0.5),
            message: "halfway".to_owned(),
        }
    }

    fn done(stage: &str) -> Event {
        Event::UnitDone {
            unit: unit(stage),
            fingerprint: Digest::of_bytes(b"unit"),
            made_now: true,
            skipped: None,
        }
    }

    fn damaged(stage: &str) -> Event {
        Event::UnitDamaged { unit: unit(stage) }
    }

    fn line(event: &Event) -> String {
        serde_json::to_string(event).unwrap()
    }

    /// Relays lines about a unit of `b`, which reads `a`: returns the forwarded events and the
    /// error of the first refused line.
    fn relayed(lines: &[String]) -> (Vec<Event>, Option<String>) {
        let (asked, source) = (unit("b"), unit("a").node);
        let passed = Mutex::new(Vec::new());
        let events = |event: &Event| passed.lock().unwrap().push(event.clone());
        let mut relay = Relay::new(&asked, BTreeSet::from([&source]), &events);
        let refused = lines.iter().find_map(|line| relay.line(line).err());
        (
            passed.into_inner().unwrap(),
            refused.map(|err| err.to_string()),
        )
    }

    #[test]
    fn events_of_the_unit_and_its_repairs_are_relayed() {
        let events = [progress("b"), damaged("a"), progress("a"), done("a")];
        let mut lines = events.each_ref().map(line).to_vec();
        lines.push(line(&done("b")));
        assert_eq!(relayed(&lines), (events.to_vec(), None));
    }

    #[test]
    fn malformed_and_foreign_events_are_refused() {
        let mut other_partition = line(&progress("b"));
        other_partition = other_partition.replace("\"p\"", "\"q\"");
        let too_far = line(&progress("b")).replace("0.5", "1.5");
        let unknown_field = line(&damaged("a")).replace("{\"event\"", "{\"x\":1,\"event\"");
        let run = Event::RunStarted { n_outputs: 3 };
        for (lines, reason) in [
            (vec!["not JSON".to_owned()], "is not an event"),
            (vec![too_far], "1.5 is not a fraction"),
            (vec![unknown_field], "unknown field"),
            (vec![other_partition], "not an event of this unit"),
            (vec![line(&progress("a"))], "not an event of this unit"),
            (vec![line(&damaged("c"))], "not an event of this unit"),
            (vec![line(&run)], "not an event of this unit"),
            (
                vec![line(&done("b")), line(&progress("b"))],
                "follows the last event",
            ),
        ] {
            let (passed, refused) = relayed(&lines);
            let refused = refused.unwrap();
            assert!(refused.contains(reason), "{lines:?}: {refused}");
            assert!(passed.is_empty(), "{lines:?}");
        }
    }
}
