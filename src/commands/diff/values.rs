//! Values, stages and wires that differ between two runs.

use std::collections::{BTreeMap, BTreeSet};

use dataflow::{RunRecord, StageName, StageRecord};
use serde::Serialize;
use serde_json::Value;

/// A list longer than this, or of tables, is compared element by element.
const SHORT_LIST: usize = 8;

/// A value that differs. It is `null` where it was not set.
#[derive(Debug, PartialEq, Serialize)]
pub(super) struct ValueChange {
    /// `stage.key`, or `seed`, `profile`, `pipeline`.
    pub(super) key: String,
    pub(super) old: Value,
    pub(super) new: Value,
}

/// A stage's input that is wired differently in two runs.
#[derive(Debug, PartialEq, Serialize)]
pub(super) struct WireChange {
    /// `stage.inputs.name`
    pub(super) key: String,
    pub(super) old: Option<String>,
    pub(super) new: Option<String>,
}

/// Differences in the requests of two runs.
#[derive(Debug, Default, PartialEq, Serialize)]
pub(super) struct RequestDiff {
    pub(super) values: Vec<ValueChange>,
    pub(super) added_stages: Vec<StageName>,
    pub(super) removed_stages: Vec<StageName>,
    pub(super) rewired: Vec<WireChange>,
}

impl RequestDiff {
    /// Compares the requests of two runs.
    pub(super) fn compare(old: &RunRecord, new: &RunRecord) -> Self {
        let mut diff = Self::default();
        let general = |run: &RunRecord| {
            [
                ("pipeline", Value::from(run.pipeline.as_str())),
                ("profile", Value::from(run.origin.profile.clone())),
                ("seed", Value::from(run.seed)),
            ]
        };
        for ((key, old), (_, new)) in general(old).iter().zip(&general(new)) {
            diff.compare_values(key, Some(old), Some(new));
        }
        for (name, stage) in &new.stages {
            match old.stages.get(name) {
                Some(before) => diff.compare_stage(name, before, stage),
                None => diff.added_stages.push(name.clone()),
            }
        }
        let removed = old.stages.keys();
        let removed = removed.filter(|name| !new.stages.contains_key(*name));
        diff.removed_stages = removed.cloned().collect();
        diff
    }

    fn compare_stage(&mut self, name: &StageName, old: &StageRecord, new: &StageRecord) {
        let kind = |stage: &StageRecord| Value::from(stage.kind.as_str());
        self.compare_values(&format!("{name}.kind"), Some(&kind(old)), Some(&kind(new)));
        self.compare_values(name.as_str(), Some(&old.config), Some(&new.config));
        for input in keys(&old.inputs, &new.inputs) {
            let source = |stage: &StageRecord| stage.inputs.get(input).map(ToString::to_string);
            let (old, new) = (source(old), source(new));
            if old != new {
                let key = format!("{name}.inputs.{input}");
                self.rewired.push(WireChange { key, old, new });
            }
        }
    }

    fn compare_values(&mut self, key: &str, old: Option<&Value>, new: Option<&Value>) {
        match (old, new) {
            (Some(Value::Object(old)), Some(Value::Object(new))) => {
                let names: BTreeSet<_> = old.keys().chain(new.keys()).collect();
                for name in names {
                    self.compare_values(&format!("{key}.{name}"), old.get(name), new.get(name));
                }
            }
            (Some(Value::Array(old)), Some(Value::Array(new)))
                if old.len() == new.len() && (old.len() > SHORT_LIST || holds_tables(old)) =>
            {
                for (idx, (old, new)) in old.iter().zip(new).enumerate() {
                    self.compare_values(&format!("{key}.{idx}"), Some(old), Some(new));
                }
            }
            _ if old != new => self.values.push(ValueChange {
                key: key.to_owned(),
                old: old.cloned().unwrap_or_default(),
                new: new.cloned().unwrap_or_default(),
            }),
            _ => {}
        }
    }
}

fn holds_tables(list: &[Value]) -> bool {
    list.iter()
        .any(|value| value.is_object() || value.is_array())
}

/// The keys of two maps, in order.
pub(super) fn keys<'a, N: Ord, V>(
    old: &'a BTreeMap<N, V>,
    new: &'a BTreeMap<N, V>,
) -> BTreeSet<&'a N> {
    old.keys().chain(new.keys()).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn changes(old: &Value, new: &Value) -> Vec<(String, Value, Value)> {
        let mut diff = RequestDiff::default();
        diff.compare_values("s", Some(old), Some(new));
        let changes = diff.values.into_iter();
        changes
            .map(|change| (change.key, change.old, change.new))
            .collect()
    }

    #[test]
    fn only_differences_are_named_by_key() {
        let old = json!({"a": 1, "t": {"x": [1, 2], "y": true}, "gone": "z"});
        let new = json!({"a": 1, "t": {"x": [1, 3], "y": true}, "new": 0});
        assert_eq!(
            changes(&old, &new),
            [
                ("s.gone".to_owned(), json!("z"), Value::Null),
                ("s.new".to_owned(), Value::Null, json!(0)),
                ("s.t.x".to_owned(), json!([1, 2]), json!([1, 3])),
            ]
        );
        assert_eq!(changes(&old, &old), []);
    }

    #[test]
    fn tables_in_lists_are_compared_one_by_one_where_there_are_as_many() {
        let old = json!([{"w": 1.0}, {"w": 0.3}]);
        let new = json!([{"w": 1.0}, {"w": 0.5}]);
        assert_eq!(
            changes(&old, &new),
            [("s.1.w".to_owned(), json!(0.3), json!(0.5))]
        );
        assert_eq!(changes(&old, &json!([])).len(), 1);
    }
}
