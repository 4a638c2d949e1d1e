//! The keys under which a cell is reached.

use crate::CellError;

/// The keys of one cell: `cgf/cell/<name>/…`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Keys {
    name: String,
}

impl Keys {
    /// Parses a cell's name: lower-case letters, digits, `-` and `_`.
    ///
    /// # Errors
    ///
    /// Fails if the name is empty or contains another character.
    pub fn new(name: &str) -> Result<Self, CellError> {
        let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "-_".contains(c);
        if name.is_empty() || !name.chars().all(allowed) {
            return Err(CellError::Name {
                name: name.to_owned(),
            });
        }
        Ok(Self {
            name: name.to_owned(),
        })
    }

    /// Returns the cell's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Query: the cell's capabilities.
    pub fn capabilities(&self) -> String {
        self.key("capabilities")
    }

    /// Query with a goal: accepts or refuses it.
    pub fn goal(&self) -> String {
        self.key("goal")
    }

    /// Query: the report on a goal, answered when its motion ends.
    pub fn result(&self, goal_id: &str) -> String {
        self.key(&format!("goal/{goal_id}/result"))
    }

    /// Query: cancels a goal; answered when its motion has stopped.
    pub fn cancel(&self, goal_id: &str) -> String {
        self.key(&format!("goal/{goal_id}/cancel"))
    }

    /// Query: aborts the current motion and has every goal refused until [`Keys::resume`].
    pub fn stop(&self) -> String {
        self.key("stop")
    }

    /// Query: lets the cell accept goals again after a stop.
    pub fn resume(&self) -> String {
        self.key("resume")
    }

    /// Publication of the dispatcher while it waits for a motion: a cell in real time aborts the
    /// motion when heartbeats stop.
    pub fn heartbeat(&self) -> String {
        self.key("heartbeat")
    }

    /// Publication of the cell: a goal's outcome.
    pub fn outcome(&self, goal_id: &str) -> String {
        self.key(&format!("goal/{goal_id}/outcome"))
    }

    /// Publication of the cell: its measured state.
    pub fn state(&self) -> String {
        self.key("state")
    }

    /// Query `?from=N`: the samples of [`Keys::state`] from that number on.
    pub fn history(&self) -> String {
        self.key("state/history")
    }

    /// Query `?from=N`: outcomes of goals from that number on.
    pub fn results(&self) -> String {
        self.key("results")
    }

    /// Publication of the dispatcher: each accepted goal.
    pub fn motion(&self) -> String {
        self.key("motion")
    }

    /// Liveliness token of the cell.
    pub fn alive(&self) -> String {
        self.key("alive")
    }

    /// All keys of this cell.
    pub fn all(&self) -> String {
        self.key("**")
    }

    fn key(&self, end: &str) -> String {
        format!("cgf/cell/{}/{end}", self.name)
    }
}

/// Returns the goal id in a key made by [`Keys::result`] or [`Keys::cancel`].
pub(crate) fn goal_id_of(key: &str) -> Option<&str> {
    key.rsplit('/').nth(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_result_key_gives_back_its_goal() {
        let keys = Keys::new("simulated").unwrap();
        assert_eq!(goal_id_of(&keys.result("00ff")), Some("00ff"));
    }

    #[test]
    fn names_that_would_change_the_key_are_refused() {
        for name in ["", "a/b", "*", "Cell", "a b", "$*"] {
            assert!(Keys::new(name).is_err(), "{name:?}");
        }
    }
}
