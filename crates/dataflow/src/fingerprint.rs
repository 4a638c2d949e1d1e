//! Everything that the bytes of a partition depend on, as a plain struct.

use std::{collections::BTreeMap, fmt};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::digest::Digest;

/// Everything that the bytes of one partition depend on.
///
/// It is stored with the result, so that "why does this run" is a field-by-field answer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fingerprint {
    /// The stage's kind: another kind computes something else.
    pub kind: String,
    /// The artifact made, for kinds with more than one output.
    pub output: String,
    /// The partition's key, which stages may use.
    pub partition: String,
    /// Digests of the sources that decide the output, by workspace crate.
    pub code: BTreeMap<String, String>,
    /// The stage's configuration, without the paths of files listed in `files`.
    pub config: Value,
    /// Digests of the partitions read, by input name and partition key.
    pub inputs: BTreeMap<String, BTreeMap<String, Digest>>,
    /// Digests of the files read outside the lake, by name.
    pub files: BTreeMap<String, Digest>,
    /// Name and version of the schema in which the output is written.
    pub schema: String,
    /// The unit's own seed.
    pub seed: u64,
}

/// One part of a fingerprint that differs from the last time.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "cause", rename_all = "snake_case")]
pub enum Cause {
    /// It was never made.
    New,
    /// It was made, but its files are no longer whole in the lake.
    Lost,
    /// `--fresh` asked for it.
    Forced,
    /// A value of the pipeline file.
    Config {
        /// Dotted path of the key inside the stage's table.
        key: String,
        /// The value last time; `null` if it was not there.
        old: Value,
        /// The value now; `null` if it is not there.
        new: Value,
    },
    /// The sources of a workspace crate, or `dependencies` for locked versions.
    Code {
        /// The crate.
        part: String,
    },
    /// A partition that it reads.
    Input {
        /// The input's name.
        input: String,
        /// The partition's key.
        partition: String,
        /// What happened to it.
        change: Change,
    },
    /// A file outside the lake.
    File {
        /// The file's name.
        file: String,
        /// What happened to it.
        change: Change,
    },
    /// The schema's version.
    Schema {
        /// The version last time.
        old: String,
        /// The version now.
        new: String,
    },
    /// The seed.
    Seed,
    /// The stage's kind.
    Kind {
        /// The kind last time.
        old: String,
        /// The kind now.
        new: String,
    },
}

/// What happened to something that a unit reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Change {
    /// It is read now and was not last time.
    Added,
    /// It was read last time and is not now.
    Removed,
    /// Its bytes differ.
    Changed,
}

impl Fingerprint {
    /// Returns the digest by which the result is found.
    pub fn digest(&self) -> Digest {
        // A fingerprint is made of maps with text keys, so this cannot fail; a failure would make
        // every unit look new, which is safe.
        Digest::of_json(&serde_json::to_value(self).unwrap_or(Value::Null))
    }

    /// Lists the parts that differ from `old`.
    pub fn differences(&self, old: &Self) -> Vec<Cause> {
        let mut causes = Vec::new();
        if self.kind != old.kind {
            causes.push(Cause::Kind {
                old: old.kind.clone(),
                new: self.kind.clone(),
            });
        }
        compare_values("", &old.config, &self.config, &mut causes);
        for (part, _) in changes(&old.code, &self.code) {
            causes.push(Cause::Code { part: part.clone() });
        }
        for (file, change) in changes(&old.files, &self.files) {
            causes.push(Cause::File {
                file: file.clone(),
                change,
            });
        }
        let empty = BTreeMap::new();
        let names: std::collections::BTreeSet<_> =
            old.inputs.keys().chain(self.inputs.keys()).collect();
        for input in names {
            let old = old.inputs.get(input).unwrap_or(&empty);
            let new = self.inputs.get(input).unwrap_or(&empty);
            for (partition, change) in changes(old, new) {
                causes.push(Cause::Input {
                    input: input.clone(),
                    partition: partition.clone(),
                    change,
                });
            }
        }
        if self.schema != old.schema {
            causes.push(Cause::Schema {
                old: old.schema.clone(),
                new: self.schema.clone(),
            });
        }
        if self.seed != old.seed {
            causes.push(Cause::Seed);
        }
        causes
    }
}

/// Keys of two ordered maps whose values differ.
fn changes<'a, V: PartialEq>(
    old: &'a BTreeMap<String, V>,
    new: &'a BTreeMap<String, V>,
) -> Vec<(&'a String, Change)> {
    let mut changes: Vec<_> = new
        .iter()
        .filter_map(|(key, value)| match old.get(key) {
            None => Some((key, Change::Added)),
            Some(before) if before != value => Some((key, Change::Changed)),
            Some(_) => None,
        })
        .collect();
    let removed = old.keys().filter(|key| !new.contains_key(*key));
    changes.extend(removed.map(|key| (key, Change::Removed)));
    changes
}

fn compare_values(path: &str, old: &Value, new: &Value, causes: &mut Vec<Cause>) {
    match (old, new) {
        (Value::Object(before), Value::Object(after)) => {
            let keys: std::collections::BTreeSet<_> = before.keys().chain(after.keys()).collect();
            for key in keys {
                let path = if path.is_empty() {
                    key.clone()
                } else {
                    format!("{path}.{key}")
                };
                let old = before.get(key).unwrap_or(&Value::Null);
                let new = after.get(key).unwrap_or(&Value::Null);
                compare_values(&path, old, new, causes);
            }
        }
        _ if old != new => causes.push(Cause::Config {
            key: path.to_owned(),
            old: old.clone(),
            new: new.clone(),
        }),
        _ => {}
    }
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::New => f.write_str("never made"),
            Self::Lost => f.write_str("its files are missing or damaged in the lake"),
            Self::Forced => f.write_str("asked for by `--fresh`"),
            Self::Config { key, old, new } => match (old, new) {
                (Value::Null, new) => write!(f, "`{key}` set to {new}"),
                (old, Value::Null) => write!(f, "`{key}` removed, was {old}"),
                (old, new) => write!(f, "`{key}` changed from {old} to {new}"),
            },
            Self::Code { part } if part == "dependencies" => {
                f.write_str("the locked versions of dependencies changed")
            }
            Self::Code { part } => write!(f, "the code of `{part}` changed"),
            Self::Input {
                input,
                partition,
                change,
            } => write!(f, "input `{input}` `{partition}` {change}"),
            Self::File { file, change } => write!(f, "file `{file}` {change}"),
            Self::Schema { old, new } => write!(f, "schema changed from `{old}` to `{new}`"),
            Self::Seed => f.write_str("`seed` changed"),
            Self::Kind { old, new } => write!(f, "`kind` changed from `{old}` to `{new}`"),
        }
    }
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Added => "added",
            Self::Removed => "removed",
            Self::Changed => "changed",
        })
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn fingerprint() -> Fingerprint {
        Fingerprint {
            kind: "train".to_owned(),
            output: "checkpoint".to_owned(),
            partition: "model".to_owned(),
            code: BTreeMap::from([("cgf".to_owned(), "aa".to_owned())]),
            config: json!({"epochs": 40, "loss": {"kl_weight": 0.001}}),
            inputs: BTreeMap::from([(
                "trajectories".to_owned(),
                BTreeMap::from([("a".to_owned(), Digest::of_bytes(b"a"))]),
            )]),
            files: BTreeMap::from([("hand.urdf".to_owned(), Digest::of_bytes(b"hand"))]),
            schema: "checkpoint/1".to_owned(),
            seed: 7,
        }
    }

    #[test]
    fn equal_fingerprints_have_equal_digests() {
        assert_eq!(fingerprint().digest(), fingerprint().digest());
        assert_eq!(fingerprint().differences(&fingerprint()), []);
    }

    #[test]
    fn every_field_changes_the_digest_and_is_named() {
        let old = fingerprint();
        let check = |edit: fn(&mut Fingerprint), expected: &str| {
            let mut new = old.clone();
            edit(&mut new);
            assert_ne!(new.digest(), old.digest(), "{expected}");
            let causes: Vec<String> = new
                .differences(&old)
                .iter()
                .map(ToString::to_string)
                .collect();
            assert_eq!(causes, [expected]);
        };
        check(
            |f| f.kind = "tune".to_owned(),
            "`kind` changed from `train` to `tune`",
        );
        check(
            |f| f.config = json!({"epochs": 40, "loss": {"kl_weight": 0.01}}),
            "`loss.kl_weight` changed from 0.001 to 0.01",
        );
        check(
            |f| drop(f.code.insert("cgf".to_owned(), "bb".to_owned())),
            "the code of `cgf` changed",
        );
        check(
            |f| {
                let read = f.inputs.entry("trajectories".to_owned()).or_default();
                read.insert("b".to_owned(), Digest::of_bytes(b"b"));
            },
            "input `trajectories` `b` added",
        );
        check(
            |f| {
                let other = Digest::of_bytes(b"other");
                f.files.insert("hand.urdf".to_owned(), other);
            },
            "file `hand.urdf` changed",
        );
        check(|f| f.seed = 8, "`seed` changed");
        check(
            |f| f.schema = "checkpoint/2".to_owned(),
            "schema changed from `checkpoint/1` to `checkpoint/2`",
        );
    }
}
