//! The events of a unit that another process makes.

use crate::{
    digest::Digest,
    error::{Failure, ProtocolViolation},
    event::{Event, Events},
    executor::UnitOutcome,
    name::UnitName,
    work_item::WorkItem,
};

/// Characters of a refused line that its error quotes.
const QUOTED: usize = 200;

/// Checks the events of a unit made in another process and forwards them.
pub struct Relay<'a> {
    item: &'a WorkItem,
    events: &'a Events<'a>,
    end: Option<UnitOutcome>,
}

impl<'a> Relay<'a> {
    /// Relays the events of a work item's unit.
    pub fn new(item: &'a WorkItem, events: &'a Events<'a>) -> Self {
        Self {
            item,
            events,
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
            .map_err(|err| self.refuse(line, ProtocolViolation::NoEvent(err)))?;
        if self.end.is_some() {
            return Err(self.refuse(line, ProtocolViolation::AfterTheLast));
        }
        let of_this_unit = &self.item.unit;
        match event {
            Event::UnitWaiting { ref unit, .. } | Event::UnitProgress { ref unit, .. }
                if unit == of_this_unit =>
            {
                (self.events)(&event);
                return Ok(());
            }
            event => {
                let end = UnitOutcome::of_event(event, of_this_unit, &self.item.fingerprint);
                self.end =
                    Some(end.ok_or_else(|| self.refuse(line, ProtocolViolation::OtherUnit))?);
            }
        }
        Ok(())
    }

    /// Whether the unit's last event has come.
    pub fn is_over(&self) -> bool {
        self.end.is_some()
    }

    /// Returns how the unit ended, if its last event has come.
    pub fn end(self) -> Option<UnitOutcome> {
        self.end
    }

    fn refuse(&self, line: &str, violation: ProtocolViolation) -> Failure {
        Failure::Protocol {
            unit: self.item.unit.clone(),
            line: line.chars().take(QUOTED).collect(),
            violation,
        }
    }
}

impl UnitOutcome {
    /// Returns the end that the last event of a unit with this fingerprint tells; `None` of another
    /// event.
    pub fn of_event(event: Event, name: &UnitName, expected: &Digest) -> Option<Self> {
        let (of, end) = match event {
            Event::UnitDone {
                unit,
                fingerprint,
                made_now,
                ..
            } if fingerprint == *expected => (unit, Self::Done { made_now }),
            Event::UnitFailed {
                unit,
                message,
                hint,
                left_out,
            } => {
                let left_out = left_out.map(Into::into);
                let failure = Failure::Remote {
                    message,
                    hint,
                    left_out,
                };
                (unit, Self::Failed(failure))
            }
            Event::UnitLacking { unit, lacks } => (unit, Self::missing_artifacts(lacks)),
            _ => return None,
        };
        (of == *name).then_some(end)
    }
}

#[cfg(test)]
mod tests {
    use std::{collections::BTreeMap, sync::Mutex};

    use super::*;
    use crate::{
        event::Fraction, fingerprint::OutputFingerprint, name::NodeName, outcome::Labels,
        work_item::Recompute,
    };

    fn unit(stage: &str) -> UnitName {
        let node = NodeName::parse(&format!("{stage}.made")).unwrap();
        UnitName::new(&node, &"p".parse().unwrap())
    }

    fn work_item() -> WorkItem {
        let recipe = OutputFingerprint {
            kind: "map".to_owned(),
            output: "made".parse().unwrap(),
            code: BTreeMap::new(),
            config: serde_json::json!({}),
            schema: "made/1".to_owned(),
        };
        WorkItem {
            unit: unit("b"),
            fingerprint: Digest::of_bytes(b"unit"),
            forced: Recompute::No,
            recipe: recipe.into(),
            options: "{}".to_owned(),
            wires: BTreeMap::new(),
            inputs: BTreeMap::new(),
            files: Vec::new(),
            facts: BTreeMap::new(),
            labels: Some(Labels::new()),
            seed: 7,
        }
    }

    fn progress(stage: &str) -> Event {
        Event::UnitProgress {
            unit: unit(stage),
            fraction: Fraction::nearest(0.5),
            message: "halfway".to_owned(),
        }
    }

    fn done(stage: &str, of: &[u8]) -> Event {
        Event::UnitDone {
            unit: unit(stage),
            fingerprint: Digest::of_bytes(of),
            made_now: true,
            skipped: None,
        }
    }

    fn line(event: &Event) -> String {
        serde_json::to_string(event).unwrap()
    }

    /// Relays lines about a unit: returns the forwarded events, and how it ended or the error of the
    /// first refused line.
    fn relayed(lines: &[String]) -> (Vec<Event>, Result<Option<UnitOutcome>, String>) {
        let item = work_item();
        let passed = Mutex::new(Vec::new());
        let events = |event: &Event| passed.lock().unwrap().push(event.clone());
        let mut relay = Relay::new(&item, &events);
        let refused = lines.iter().find_map(|line| relay.line(line).err());
        let end = refused.map_or_else(|| Ok(relay.end()), |err| Err(err.to_string()));
        (passed.into_inner().unwrap(), end)
    }

    #[test]
    fn progress_is_relayed_and_the_last_event_is_the_end() {
        let lacking = Event::UnitLacking {
            unit: unit("b"),
            lacks: vec![unit("a")],
        };
        let (passed, end) = relayed(&[line(&progress("b")), line(&done("b", b"unit"))]);
        assert_eq!(passed, [progress("b")]);
        assert!(matches!(
            end,
            Ok(Some(UnitOutcome::Done { made_now: true }))
        ));
        let (_, end) = relayed(&[line(&lacking)]);
        assert!(
            matches!(end, Ok(Some(UnitOutcome::Lost { missing, .. })) if missing == [unit("a")])
        );
        assert!(matches!(relayed(&[line(&progress("b"))]).1, Ok(None)));
    }

    #[test]
    fn malformed_and_foreign_events_are_refused() {
        let mut other_partition = line(&progress("b"));
        other_partition = other_partition.replace("\"p\"", "\"q\"");
        let too_far = line(&progress("b")).replace("0.5", "1.5");
        let unknown_field = line(&progress("b")).replace("{\"event\"", "{\"x\":1,\"event\"");
        let run = Event::RunStarted { n_outputs: 3 };
        for (lines, reason) in [
            (vec!["not JSON".to_owned()], "is not an event"),
            (vec![too_far], "1.5 is not a fraction"),
            (vec![unknown_field], "unknown field"),
            (vec![other_partition], "not an event of this unit"),
            (vec![line(&progress("a"))], "not an event of this unit"),
            (
                vec![line(&done("b", b"other"))],
                "not an event of this unit",
            ),
            (vec![line(&run)], "not an event of this unit"),
            (
                vec![line(&done("b", b"unit")), line(&progress("b"))],
                "follows the last event",
            ),
        ] {
            let (passed, refused) = relayed(&lines);
            let refused = refused.unwrap_err();
            assert!(refused.contains(reason), "{lines:?}: {refused}");
            assert!(passed.is_empty(), "{lines:?}");
        }
    }
}
