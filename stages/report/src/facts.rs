//! Facts of the pipeline for a page, beyond the tables that it reads.

use std::collections::BTreeMap;

use dataflow::{RunFacts, Scope, SkippedItem};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::ReportError;

/// Facts of the pipeline for a page, beyond the tables that it reads.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Facts {
    /// The pipeline.
    pub run: RunFacts,
    /// Number of items left out, by input and reason.
    pub left_out: BTreeMap<String, BTreeMap<String, usize>>,
}

impl Facts {
    /// Returns the facts of a stage's scope.
    pub fn of(scope: &Scope, inputs: &[&str]) -> Self {
        let left_out = inputs.iter().filter_map(|&input| {
            let reasons = reasons(scope.left_out(input));
            (!reasons.is_empty()).then(|| (input.to_owned(), reasons))
        });
        Self {
            run: scope.run().clone(),
            left_out: left_out.collect(),
        }
    }

    /// Returns the facts of a recorded run, with the items that its inputs left out.
    pub fn recorded(run: RunFacts, left_out: &BTreeMap<String, Vec<SkippedItem>>) -> Self {
        let left_out = left_out.iter();
        let left_out = left_out.map(|(input, items)| (input.clone(), reasons(items)));
        Self {
            run,
            left_out: left_out.collect(),
        }
    }

    /// Writes them as facts of a unit, one for each value, so that a plan names those that changed.
    ///
    /// # Errors
    ///
    /// Fails if an option cannot be written as JSON.
    pub fn to_facts(&self) -> Result<BTreeMap<String, String>, ReportError> {
        let mut facts = BTreeMap::new();
        flatten("", &serde_json::to_value(self)?, &mut facts);
        Ok(facts)
    }

    /// Reads what [`Facts::to_facts`] wrote.
    ///
    /// # Errors
    ///
    /// Fails if they are others.
    pub fn from_facts<'a>(
        facts: impl IntoIterator<Item = (&'a str, &'a str)>,
    ) -> Result<Self, ReportError> {
        let mut value = Value::Object(Map::new());
        for (path, text) in facts {
            let mut at = &mut value;
            for key in path.split('/') {
                let key = key.replace("~1", "/").replace("~0", "~");
                if !at.is_object() {
                    *at = Value::Object(Map::new());
                }
                at = &mut at[key];
            }
            *at = serde_json::from_str(text)?;
        }
        Ok(serde_json::from_value(value)?)
    }

    /// Returns the options of the stage that makes an input.
    pub(crate) fn options_of(&self, input: &str) -> Option<&serde_json::Value> {
        self.run.options.get(self.stage_of(input)?)
    }

    /// Returns the stage that makes an input.
    pub(crate) fn stage_of(&self, input: &str) -> Option<&str> {
        let (stage, _) = self.run.wired.get(input)?.split_once('.')?;
        Some(stage)
    }

    /// Returns the command that makes the run again.
    pub(crate) fn command(&self) -> String {
        let run = &self.run;
        let mut command = format!("pipeline run pipelines/{}.toml", run.pipeline);
        if let Some(profile) = &run.profile {
            command.push_str(&format!(" --profile {profile}"));
        }
        for given in &run.overrides {
            let is_plain = given
                .chars()
                .all(|c| c.is_alphanumeric() || "._=-+/…".contains(c));
            if is_plain {
                command.push_str(&format!(" --set {given}"));
            } else {
                command.push_str(&format!(" --set '{given}'"));
            }
        }
        command
    }
}

/// Lists the values below a path (RFC 6901, without the first slash) that are not themselves tables of values.
fn flatten(path: &str, value: &Value, facts: &mut BTreeMap<String, String>) {
    match value {
        Value::Object(values) if !values.is_empty() => {
            for (key, value) in values {
                let key = key.replace('~', "~0").replace('/', "~1");
                let below = if path.is_empty() {
                    key
                } else {
                    format!("{path}/{key}")
                };
                flatten(&below, value, facts);
            }
        }
        value => {
            facts.insert(path.to_owned(), value.to_string());
        }
    }
}

/// Counts items by reason; figures in a reason are of one item each, and do not part reasons.
pub(crate) fn reasons(items: &[SkippedItem]) -> BTreeMap<String, usize> {
    let mut reasons: BTreeMap<String, usize> = BTreeMap::new();
    for item in items {
        *reasons.entry(without_figures(&item.reason)).or_default() += 1;
    }
    reasons
}

fn without_figures(reason: &str) -> String {
    let mut words = Vec::new();
    for word in reason.split_whitespace() {
        let is_figure = word.starts_with(|c: char| c.is_ascii_digit());
        words.push(if is_figure { "…" } else { word });
    }
    words.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_are_counted_by_reason_without_their_own_figures() {
        let item = |key: &str, reason: &str| SkippedItem {
            key: key.to_owned(),
            is_fault: false,
            reason: reason.to_owned(),
        };
        let found = reasons(&[
            item("a", "only 7 of 21 landmarks"),
            item("b", "only 9 of 21 landmarks"),
            item("c", "another hand"),
        ]);
        let expected = [("another hand", 1), ("only … of … landmarks", 2)];
        let found: Vec<(&str, usize)> = found.iter().map(|(k, n)| (k.as_str(), *n)).collect();
        assert_eq!(found, expected);
    }

    #[test]
    fn the_command_has_what_was_given() {
        let facts = Facts {
            run: RunFacts {
                pipeline: "cgf".to_owned(),
                profile: Some("paper".to_owned()),
                overrides: vec!["seed=3".to_owned(), "a.b=[1, 2]".to_owned()],
                ..RunFacts::default()
            },
            ..Facts::default()
        };
        let expected =
            "pipeline run pipelines/cgf.toml --profile paper --set seed=3 --set 'a.b=[1, 2]'";
        assert_eq!(facts.command(), expected);
        let of = |facts: &Facts| -> Facts {
            let written = facts.to_facts().unwrap();
            let pairs = written
                .iter()
                .map(|(name, value)| (name.as_str(), value.as_str()));
            Facts::from_facts(pairs).unwrap()
        };
        assert_eq!(of(&facts), facts);
        let mut other = facts.clone();
        let options = serde_json::json!({"scene": {"friction": 0.9}, "a/b~c": [1, 2], "none": {}});
        other.run.options.insert("screen".to_owned(), options);
        other.left_out.insert(
            "demonstrations".to_owned(),
            [("left/right".to_owned(), 2)].into(),
        );
        assert_eq!(of(&other), other);
        let written = other.to_facts().unwrap();
        assert_eq!(written["run/options/screen/scene/friction"], "0.9");
    }
}
