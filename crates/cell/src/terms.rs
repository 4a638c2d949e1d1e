//! The terms under which goals may be sent to a cell.

use crate::{Capabilities, CellError};

/// The terms under which goals may be sent to a cell: what it said first, and a person's permission.
///
/// They are checked against the cell's answer immediately before every transmission.
#[derive(Debug, Clone, PartialEq)]
pub struct Terms {
    first: Capabilities,
    execute: bool,
}

impl Terms {
    /// Takes the cell's first answer, and whether a person lets something real move (`execute`).
    pub fn new(first: Capabilities, execute: bool) -> Self {
        Self { first, execute }
    }

    /// Returns the cell's first answer.
    pub fn capabilities(&self) -> &Capabilities {
        &self.first
    }

    /// Whether goals may be sent: always to a cell that says it is simulated, to any other only if a
    /// person allowed it.
    pub fn may_send(&self) -> bool {
        self.first.simulated || self.execute
    }

    /// Whether the goals themselves say that nothing real may move for them.
    pub(crate) fn simulated_only(&self) -> bool {
        !self.execute
    }

    /// Checks the cell's present answer.
    ///
    /// # Errors
    ///
    /// Fails if the cell moves something real without permission, is stopped, or is not what it was.
    pub(crate) fn check(&self, now: &Capabilities) -> Result<(), CellError> {
        let cell = now.cell.clone();
        if !now.simulated && !self.execute {
            return Err(CellError::NotPermitted { cell });
        }
        if let Some(change) = now.change_since(&self.first) {
            return Err(CellError::Changed { cell, change });
        }
        if now.stopped {
            return Err(CellError::Stopped { cell });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{PROTOCOL, acceptance::PALM};

    fn capabilities() -> Capabilities {
        Capabilities {
            protocol: PROTOCOL,
            cell: "lab".to_owned(),
            journal: "aa".to_owned(),
            clock_unix_ms: 0,
            simulated: true,
            stopped: false,
            executing: String::new(),
            robot: String::new(),
            controllers: Vec::new(),
            palm: Some(PALM),
            table_from_base: None,
            max_goal_bytes: 9,
            gap: String::new(),
            real_time: false,
            silence_s: None,
        }
    }

    #[test]
    fn a_real_cell_moves_only_if_a_person_said_so() {
        let real = Capabilities {
            simulated: false,
            ..capabilities()
        };
        for (first, execute, permit) in [
            (&capabilities(), false, true),
            (&real, false, false),
            (&real, true, true),
        ] {
            let terms = Terms::new(first.clone(), execute);
            assert_eq!(terms.may_send(), permit);
            assert_eq!(terms.check(first).is_ok(), permit);
        }
        // One that becomes real meanwhile does not move, permission or not.
        for execute in [false, true] {
            let terms = Terms::new(capabilities(), execute);
            assert!(terms.check(&real).is_err(), "{execute}");
        }
    }

    #[test]
    fn a_change_of_anything_but_clock_and_motion_is_named() {
        type Change = fn(&mut Capabilities);
        let terms = Terms::new(capabilities(), false);
        let said = |change: Change| {
            let mut now = capabilities();
            change(&mut now);
            terms.check(&now).map_err(|err| err.to_string())
        };
        assert_eq!(said(|now| now.clock_unix_ms = 9), Ok(()));
        assert_eq!(said(|now| "00ff".clone_into(&mut now.executing)), Ok(()));
        let changes: [(Change, &str); 5] = [
            (
                |now| "bb".clone_into(&mut now.journal),
                "`journal` was \"aa\" and is \"bb\"",
            ),
            (|now| now.palm = None, "`palm` was {"),
            (
                |now| now.max_goal_bytes = 8,
                "`max_goal_bytes` was 9 and is 8",
            ),
            (
                |now| now.silence_s = Some(0.25),
                "`silence_s` was null and is 0.25",
            ),
            (|now| now.stopped = true, "is stopped"),
        ];
        for (change, part) in changes {
            let said = said(change).unwrap_err();
            assert!(said.contains(part), "{said}");
        }
    }

    #[test]
    fn limits_that_contradict_themselves_are_found() {
        assert_eq!(capabilities().contradiction(), None);
        let mut cell = capabilities();
        cell.palm.as_mut().unwrap().workspace_m.reverse();
        assert!(
            cell.contradiction()
                .unwrap()
                .to_string()
                .contains("workspace_m")
        );
        let mut cell = capabilities();
        cell.palm.as_mut().unwrap().speed_m_per_s = -1.0;
        assert!(
            cell.contradiction()
                .unwrap()
                .to_string()
                .contains("speed_m_per_s")
        );
    }
}
