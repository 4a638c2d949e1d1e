//! Differences in the inputs of two runs: files outside the lake, code, schemas.

use std::collections::{BTreeMap, BTreeSet};

use dataflow::Change;
use serde::Serialize;

use super::units::{Pair, Side};

/// The code part of the locked dependency versions.
const LOCKED: &str = "dependencies";

/// A differing input outside the lake.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(tag = "what", rename_all = "snake_case")]
pub(super) enum Source {
    /// A file.
    File {
        /// Its name.
        name: String,
    },
    /// The code of a crate.
    Code {
        /// The crate.
        name: String,
    },
    /// The locked versions of dependencies.
    LockedVersions,
    /// The schema of an output.
    Schema {
        /// The output.
        name: String,
    },
}

/// A difference in an input of two runs.
#[derive(Debug, PartialEq, Serialize)]
pub(super) struct InputChange {
    #[serde(flatten)]
    pub(super) source: Source,
    pub(super) change: Change,
    /// Digest, or a schema's version; `null` if it was not read.
    pub(super) old: Option<String>,
    pub(super) new: Option<String>,
    /// The outputs that read it.
    pub(super) outputs: Vec<String>,
}

/// The inputs of an output: versions of each source. One name may stand for several files.
type Read = BTreeMap<Source, BTreeSet<String>>;

/// Lists the differing inputs of the units of these outputs.
pub(super) fn compare(pairs: &[Pair]) -> Vec<InputChange> {
    let mut changes: BTreeMap<(Source, Option<String>, Option<String>), Vec<String>> =
        BTreeMap::new();
    for pair in pairs {
        let name = pair.node.to_string();
        // Without records the inputs are unknown.
        if pair.old.records.is_empty() || pair.new.records.is_empty() {
            continue;
        }
        let (mut old, mut new) = (read(&name, &pair.old), read(&name, &pair.new));
        let sources: BTreeSet<Source> = old.keys().chain(new.keys()).cloned().collect();
        for source in sources {
            let before = old.remove(&source).unwrap_or_default();
            let after = new.remove(&source).unwrap_or_default();
            if before != after {
                let gone = before.difference(&after).next().or(before.first()).cloned();
                let come = after.difference(&before).next().or(after.first()).cloned();
                let outputs = changes.entry((source, gone, come)).or_default();
                outputs.push(name.clone());
            }
        }
    }
    let changes = changes.into_iter();
    let changes = changes.map(|((source, old, new), outputs)| InputChange {
        change: match (&old, &new) {
            (None, _) => Change::Added,
            (_, None) => Change::Removed,
            _ => Change::Changed,
        },
        source,
        old,
        new,
        outputs,
    });
    changes.collect()
}

fn read(node: &str, side: &Side) -> Read {
    let mut read = Read::new();
    let mut add = |source: Source, version: String| {
        read.entry(source).or_default().insert(version);
    };
    for record in side.records.values() {
        let fingerprint = &record.fingerprint;
        for (name, digest) in &fingerprint.files {
            add(Source::File { name: name.clone() }, digest.to_hex());
        }
    }
    // The units of an output share their code.
    if let Some(record) = side.records.values().next() {
        let recipe = &record.fingerprint.recipe;
        for (part, digest) in &recipe.code {
            let source = if part == LOCKED {
                Source::LockedVersions
            } else {
                Source::Code { name: part.clone() }
            };
            add(source, digest.clone());
        }
        let name = node.to_owned();
        add(Source::Schema { name }, recipe.schema.clone());
    }
    read
}
