//! Everything that the bytes of a partition depend on, as a plain struct.

use std::{borrow::Borrow, collections::BTreeMap, fmt, sync::Arc};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::{
    digest::{Digest, Fields},
    elementary_functions,
    name::{ArtifactName, PartitionKey, StageName},
};

/// The part of a fingerprint that all units of one output share.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OutputFingerprint {
    /// The stage's kind: another kind computes something else.
    pub kind: String,
    /// The artifact made, for kinds with more than one output.
    pub output: ArtifactName,
    /// Digests of the sources that decide the output, by workspace crate, and of the elementary functions where they
    /// round otherwise than usual.
    pub code: BTreeMap<String, String>,
    /// The stage's configuration, without the paths of files that its units read.
    pub config: Value,
    /// Name and version of the schema in which the output is written.
    pub schema: String,
}

impl OutputFingerprint {
    /// Returns the digest under which the recipe is stored.
    pub fn digest(&self) -> Digest {
        Digest::of_json(&self.to_json())
    }

    /// Returns the recipe as it is written. All its parts are texts and JSON, so this cannot fail.
    fn to_json(&self) -> Value {
        // Destructured, so that a new field cannot be forgotten here.
        let Self {
            kind,
            output,
            code,
            config,
            schema,
        } = self;
        let code = code
            .iter()
            .map(|(part, digest)| (part.clone(), digest.as_str().into()));
        let fields = [
            ("kind", kind.as_str().into()),
            ("output", output.as_str().into()),
            ("code", Value::Object(code.collect())),
            ("config", config.clone()),
            ("schema", schema.as_str().into()),
        ];
        Value::Object(
            fields
                .map(|(name, value)| (name.to_owned(), value))
                .into_iter()
                .collect(),
        )
    }
}

/// Everything that the bytes of one partition depend on.
///
/// It is stored with the result, so that "why does this run" is a field-by-field answer.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Fingerprint {
    /// The part shared with the other partitions of its output.
    #[serde(flatten)]
    pub recipe: Arc<OutputFingerprint>,
    /// The stage's name in the pipeline file, on which its seed depends.
    pub stage: StageName,
    /// The partition's key, which stages may use.
    pub partition: PartitionKey,
    /// Digests of the partitions read, by input name and partition key.
    pub inputs: BTreeMap<ArtifactName, BTreeMap<PartitionKey, Digest>>,
    /// Digests of the files read outside the lake, by name.
    pub files: BTreeMap<String, Digest>,
    /// Facts found while it was listed, by name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub facts: BTreeMap<String, String>,
    /// The pipeline's seed.
    pub seed: u64,
}

/// One part of a fingerprint that differs from the last time.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "cause", rename_all = "snake_case")]
pub enum Cause {
    /// It was never made.
    New,
    /// It was made, but files in the lake are missing or damaged.
    Lost,
    /// It was made for an earlier run alone.
    Provisional,
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
        /// The digest of its sources last time; `null` if it was not used.
        old: Option<String>,
        /// The digest now; `null` if it is not used.
        new: Option<String>,
    },
    /// A partition that it reads.
    Input {
        /// The input's name.
        input: ArtifactName,
        /// The partition's key.
        partition: PartitionKey,
        /// Kind of change.
        change: Change,
        /// Its digest last time; `null` if it was not read.
        old: Option<Digest>,
        /// Its digest now; `null` if it is not read.
        new: Option<Digest>,
    },
    /// A file outside the lake.
    File {
        /// The file's name.
        file: String,
        /// Kind of change.
        change: Change,
        /// Its digest last time; `null` if it was not read.
        old: Option<Digest>,
        /// Its digest now; `null` if it is not read.
        new: Option<Digest>,
    },
    /// A fact found while the unit was listed.
    Fact {
        /// Its name.
        fact: String,
        /// Its value last time; `null` if there was none.
        old: Option<String>,
        /// Its value now; `null` if there is none.
        new: Option<String>,
    },
    /// The schema's version.
    Schema {
        /// The version last time.
        old: String,
        /// The version now.
        new: String,
    },
    /// The pipeline's seed.
    Seed {
        /// The seed last time.
        old: u64,
        /// The seed now.
        new: u64,
    },
    /// The stage's name, on which its seed depends.
    Renamed {
        /// The name last time.
        old: StageName,
        /// The name now.
        new: StageName,
    },
    /// The stage's kind.
    Kind {
        /// The kind last time.
        old: String,
        /// The kind now.
        new: String,
    },
}

/// Kind of change in an input of a unit.
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
    /// Returns the digest under which the result is stored.
    pub fn digest(&self) -> Digest {
        self.digest_with(&self.recipe.digest())
    }

    /// Returns the digest, given the recipe's, which many units share.
    pub(crate) fn digest_with(&self, recipe: &Digest) -> Digest {
        let mut fields = Fields::new("unit");
        fields.digest(recipe);
        fields.number(self.inputs.len() as u64);
        for (input, partitions) in &self.inputs {
            fields.text(input.as_str());
            digest_map(&mut fields, partitions);
        }
        self.digest_own(&mut fields);
        fields.finish()
    }

    /// Digests everything but the recipe and the inputs from other stages.
    fn digest_own(&self, fields: &mut Fields) {
        fields.text(self.stage.as_str());
        fields.text(self.partition.as_str());
        digest_map(fields, &self.files);
        fields.number(self.facts.len() as u64);
        for (name, value) in &self.facts {
            fields.text(name);
            fields.text(value);
        }
        fields.number(self.seed);
    }

    /// Returns the digest of everything but the inputs from other stages, given the recipe's
    /// digest: units with different own digests differ whatever their inputs are.
    pub fn own_digest(&self, recipe: &Digest) -> Digest {
        let mut fields = Fields::new("own");
        fields.digest(recipe);
        self.digest_own(&mut fields);
        fields.finish()
    }

    /// Lists the parts that differ from `old`.
    pub fn differences(&self, old: &Self) -> Vec<Cause> {
        let mut causes = self.own_differences(old);
        let empty = BTreeMap::new();
        let names: std::collections::BTreeSet<_> =
            old.inputs.keys().chain(self.inputs.keys()).collect();
        for input in names {
            let old = old.inputs.get(input).unwrap_or(&empty);
            let new = self.inputs.get(input).unwrap_or(&empty);
            for (partition, change, old, new) in changes(old, new) {
                causes.push(Cause::Input {
                    input: input.clone(),
                    partition: partition.clone(),
                    change,
                    old: old.copied(),
                    new: new.copied(),
                });
            }
        }
        causes
    }

    /// Lists the parts that differ from `old`, without inputs from other stages.
    pub(crate) fn own_differences(&self, old: &Self) -> Vec<Cause> {
        let mut causes = self.recipe.differences(&old.recipe);
        if self.stage != old.stage {
            causes.push(Cause::Renamed {
                old: old.stage.clone(),
                new: self.stage.clone(),
            });
        }
        for (file, change, old, new) in changes(&old.files, &self.files) {
            causes.push(Cause::File {
                file: file.clone(),
                change,
                old: old.copied(),
                new: new.copied(),
            });
        }
        for (fact, _, old, new) in changes(&old.facts, &self.facts) {
            causes.push(Cause::Fact {
                fact: fact.clone(),
                old: old.cloned(),
                new: new.cloned(),
            });
        }
        if self.seed != old.seed {
            causes.push(Cause::Seed {
                old: old.seed,
                new: self.seed,
            });
        }
        causes
    }
}

impl OutputFingerprint {
    /// Lists the parts that differ from `old`.
    pub(crate) fn differences(&self, old: &Self) -> Vec<Cause> {
        let mut causes = Vec::new();
        if (&self.kind, &self.output) != (&old.kind, &old.output) {
            let name = |recipe: &Self| {
                if self.kind == old.kind {
                    format!("{}.{}", recipe.kind, recipe.output)
                } else {
                    recipe.kind.clone()
                }
            };
            causes.push(Cause::Kind {
                old: name(old),
                new: name(self),
            });
        }
        compare_values("", &old.config, &self.config, &mut causes);
        for (part, _, old, new) in changes(&old.code, &self.code) {
            causes.push(Cause::Code {
                part: part.clone(),
                old: old.cloned(),
                new: new.cloned(),
            });
        }
        if self.schema != old.schema {
            causes.push(Cause::Schema {
                old: old.schema.clone(),
                new: self.schema.clone(),
            });
        }
        causes
    }
}

fn digest_map<N: Borrow<str>>(fields: &mut Fields, digests: &BTreeMap<N, Digest>) {
    fields.number(digests.len() as u64);
    for (name, digest) in digests {
        fields.text(name.borrow());
        fields.digest(digest);
    }
}

/// Keys of two ordered maps whose values differ, with the old and the new value.
fn changes<'a, N: Ord, V: PartialEq>(
    old: &'a BTreeMap<N, V>,
    new: &'a BTreeMap<N, V>,
) -> Vec<(&'a N, Change, Option<&'a V>, Option<&'a V>)> {
    let mut changes: Vec<_> = new
        .iter()
        .filter_map(|(key, value)| match old.get(key) {
            None => Some((key, Change::Added, None, Some(value))),
            Some(before) if before != value => {
                Some((key, Change::Changed, Some(before), Some(value)))
            }
            Some(_) => None,
        })
        .collect();
    let removed = old.iter().filter(|(key, _)| !new.contains_key(*key));
    changes.extend(removed.map(|(key, value)| (key, Change::Removed, Some(value), None)));
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
            Self::Provisional => f.write_str("the last result was for its own run alone"),
            Self::Forced => f.write_str("asked for by `--fresh`"),
            Self::Config { key, old, new } => match (old, new) {
                (Value::Null, new) => write!(f, "`{key}` set to {new}"),
                (old, Value::Null) => write!(f, "`{key}` removed, was {old}"),
                (old, new) => write!(f, "`{key}` changed from {old} to {new}"),
            },
            Self::Code { part, old, new } => {
                if part == "dependencies" {
                    f.write_str("the locked versions of dependencies changed")?;
                } else if part == elementary_functions::PART {
                    f.write_str(
                        "the processor or its C library rounds `sin`, `exp` and the like otherwise",
                    )?;
                } else {
                    write!(f, "the code of `{part}` changed")?;
                }
                let digits = |digest: &Option<String>| digest.as_deref().map(first_digits);
                from_to(f, digits(old), digits(new))
            }
            Self::Input {
                input,
                partition,
                change,
                old,
                new,
            } => {
                write!(f, "input `{input}` `{partition}` {change}")?;
                from_to(f, old.map(Digest::short), new.map(Digest::short))
            }
            Self::File {
                file,
                change,
                old,
                new,
            } => {
                write!(f, "file `{file}` {change}")?;
                from_to(f, old.map(Digest::short), new.map(Digest::short))
            }
            Self::Fact { fact, old, new } => match (old, new) {
                (_, None) => write!(f, "no longer {fact}"),
                (None, Some(new)) => write!(f, "{fact}: {new}"),
                (Some(old), Some(new)) => write!(f, "{fact}: {new}, before: {old}"),
            },
            Self::Schema { old, new } => write!(f, "schema changed from `{old}` to `{new}`"),
            Self::Seed { old, new } => write!(f, "`seed` changed from {old} to {new}"),
            Self::Renamed { old, new } => {
                write!(
                    f,
                    "the stage was renamed from `{old}` to `{new}`, and its random numbers follow its \
                     name"
                )
            }
            Self::Kind { old, new } => write!(f, "`kind` changed from `{old}` to `{new}`"),
        }
    }
}

/// Writes the old and the new value if both exist.
fn from_to(f: &mut fmt::Formatter<'_>, old: Option<String>, new: Option<String>) -> fmt::Result {
    match (old, new) {
        (Some(old), Some(new)) => write!(f, " from {old} to {new}"),
        _ => Ok(()),
    }
}

/// The leading digits of a digest, for display.
fn first_digits(digest: &str) -> String {
    digest.chars().take(12).collect()
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
    use proptest::prelude::*;
    use serde_json::json;

    use super::*;

    proptest! {
        #[test]
        fn a_recipe_of_any_numbers_is_read_back_as_itself(
            bits in proptest::collection::vec(any::<u64>(), 1..100),
        ) {
            let numbers: Vec<f64> = bits
                .iter()
                .flat_map(|&bits| [f64::from_bits(bits), (bits % 100_000) as f64 / 30_000.0])
                .filter(|number| number.is_finite())
                .collect();
            let recipe = OutputFingerprint {
                config: json!({"values": numbers}),
                ..(*fingerprint().recipe).clone()
            };
            let text = serde_json::to_string(&recipe).unwrap();
            let again: OutputFingerprint = serde_json::from_str(&text).unwrap();
            prop_assert_eq!(again.digest(), recipe.digest());
            prop_assert_eq!(recipe.to_json(), serde_json::to_value(&recipe).unwrap());
            prop_assert_eq!(serde_json::to_string(&again).unwrap(), text);
        }
    }

    fn fingerprint() -> Fingerprint {
        Fingerprint {
            recipe: Arc::new(OutputFingerprint {
                kind: "train".to_owned(),
                output: "checkpoint".parse().unwrap(),
                code: BTreeMap::from([("cgf".to_owned(), "aa".to_owned())]),
                config: json!({"epochs": 40, "loss": {"kl_weight": 0.001}}),
                schema: "checkpoint/1".to_owned(),
            }),
            stage: "train".parse().unwrap(),
            partition: "model".parse().unwrap(),
            inputs: BTreeMap::from([(
                "trajectories".parse().unwrap(),
                BTreeMap::from([("a".parse().unwrap(), Digest::of_bytes(b"a"))]),
            )]),
            files: BTreeMap::from([("hand.urdf".to_owned(), Digest::of_bytes(b"hand"))]),
            facts: BTreeMap::from([("side".to_owned(), "left".to_owned())]),
            seed: 7,
        }
    }

    #[test]
    fn equal_fingerprints_have_equal_digests() {
        assert_eq!(fingerprint().digest(), fingerprint().digest());
        assert_eq!(fingerprint().differences(&fingerprint()), []);
    }

    #[test]
    fn every_field_changes_the_digest_and_is_named_with_its_old_and_new_value() {
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
        let recipe = |f: &mut Fingerprint, edit: fn(&mut OutputFingerprint)| {
            edit(Arc::make_mut(&mut f.recipe));
        };
        check(
            |f| Arc::make_mut(&mut f.recipe).kind = "tune".to_owned(),
            "`kind` changed from `train` to `tune`",
        );
        check(
            |f| {
                Arc::make_mut(&mut f.recipe).config =
                    json!({"epochs": 40, "loss": {"kl_weight": 0.01}});
            },
            "`loss.kl_weight` changed from 0.001 to 0.01",
        );
        let mut other = old.clone();
        recipe(&mut other, |recipe| {
            recipe.code.insert("cgf".to_owned(), "bb".to_owned());
        });
        let causes = other.differences(&old);
        let expected = Cause::Code {
            part: "cgf".to_owned(),
            old: Some("aa".to_owned()),
            new: Some("bb".to_owned()),
        };
        assert_eq!(causes, [expected]);
        assert_eq!(
            causes[0].to_string(),
            "the code of `cgf` changed from aa to bb"
        );
        check(
            |f| {
                let read = f.inputs.entry("trajectories".parse().unwrap()).or_default();
                read.insert("b".parse().unwrap(), Digest::of_bytes(b"b"));
            },
            "input `trajectories` `b` added",
        );
        check(|f| f.files.clear(), "file `hand.urdf` removed");
        check(
            |f| {
                f.facts.insert("side".to_owned(), "right".to_owned());
            },
            "side: right, before: left",
        );
        check(|f| f.facts.clear(), "no longer side");
        check(|f| f.seed = 8, "`seed` changed from 7 to 8");
        check(
            |f| f.stage = "fit".parse().unwrap(),
            "the stage was renamed from `train` to `fit`, and its random numbers follow its name",
        );
        check(
            |f| Arc::make_mut(&mut f.recipe).schema = "checkpoint/2".to_owned(),
            "schema changed from `checkpoint/1` to `checkpoint/2`",
        );
    }

    #[test]
    fn a_changed_file_is_named_with_both_digests() {
        let old = fingerprint();
        let mut new = old.clone();
        let bytes = Digest::of_bytes(b"other");
        new.files.insert("hand.urdf".to_owned(), bytes);
        let causes = new.differences(&old);
        let expected = format!(
            "file `hand.urdf` changed from {} to {}",
            Digest::of_bytes(b"hand").short(),
            bytes.short()
        );
        assert_eq!(causes[0].to_string(), expected);
    }
}
