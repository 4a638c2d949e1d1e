//! The keys under which a cell is reached.

use crate::CellError;

/// The keys of one cell: `cgf/cell/<name>/…`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Keys {
    name: String,
}

impl Keys {
    /// Takes a cell's name: lower-case letters, digits, `-` and `_`.
    ///
    /// # Errors
    ///
    /// Fails if the name is empty or has another character in it.
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

    /// Query: what the cell can do.
    pub fn capabilities(&self) -> String {
        self.key("capabilities")
    }

    /// Query with a goal: takes it or refuses it.
    pub fn goal(&self) -> String {
        self.key("goal")
    }

    /// Query: the report on a goal, answered when it is over.
    pub fn result(&self, goal_id: &str) -> String {
        self.key(&format!("goal/{goal_id}/result"))
    }

    /// Query: breaks a goal off; answered when nothing of it moves any more.
    pub fn cancel(&self, goal_id: &str) -> String {
        self.key(&format!("goal/{goal_id}/cancel"))
    }

    /// Query: breaks off whatever is executed, and has every goal refused until [`Keys::resume`].
    pub fn stop(&self) -> String {
        self.key("stop")
    }

    /// Query: has goals taken again after a stop.
    pub fn resume(&self) -> String {
        self.key("resume")
    }

    /// Publication of the dispatcher while it waits for a motion: a cell in real time breaks a motion
    /// off when it hears none for a while.
    pub fn heartbeat(&self) -> String {
        self.key("heartbeat")
    }

    /// Publication of the cell: how a goal ended.
    pub fn outcome(&self, goal_id: &str) -> String {
        self.key(&format!("goal/{goal_id}/outcome"))
    }

    /// Publication of the cell: what it measures.
    pub fn state(&self) -> String {
        self.key("state")
    }

    /// Query `?from=N`: what was published on [`Keys::state`] from that number on.
    pub fn history(&self) -> String {
        self.key("state/history")
    }

    /// Query `?from=N`: how goals ended, from that number on.
    pub fn results(&self) -> String {
        self.key("results")
    }

    /// Publication of the dispatcher: each goal that the cell took.
    pub fn motion(&self) -> String {
        self.key("motion")
    }

    /// Liveliness token of the cell.
    pub fn alive(&self) -> String {
        self.key("alive")
    }

    /// Everything of this cell.
    pub fn all(&self) -> String {
        self.key("**")
    }

    fn key(&self, end: &str) -> String {
        format!("cgf/cell/{}/{end}", self.name)
    }
}

/// Returns the goal's id in a key made by [`Keys::result`] or [`Keys::cancel`].
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
