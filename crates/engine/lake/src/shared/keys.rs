//! The keys of a depot's files.
//!
//! ```text
//! format                       version of this layout
//! blobs/ab/abcd…               bytes of artifacts, as in a lake
//! recipes/abcd….json           as in a lake
//! units/ab/abcd….json          records of units, as in a lake: each after its blobs and its recipe
//! runs/PIPELINE/NAME.json      the record of a run and those of all its units in one file
//! differing/abcd…/NAME.json    records of units that came out differently than the first time
//! claims/abcd…                 lakes that make units which move a robot: they never go
//! messages/…                   work items for workers, and how they ended
//! logs/…                       what workers printed
//! ```

use dataflow::Digest;

/// Key of the layout's version.
pub(crate) const FORMAT: &str = "format";

/// The layout's version.
pub(crate) const VERSION: &[u8] = b"depot 1\n";

/// Prefixes of keys.
pub(crate) const BLOBS: &str = "blobs";
pub(crate) const RECIPES: &str = "recipes";
pub(crate) const UNITS: &str = "units";
pub(crate) const RUNS: &str = "runs";
pub(crate) const DIFFERING: &str = "differing";
pub(crate) const MESSAGES: &str = "messages";
pub(crate) const LOGS: &str = "logs";

pub(crate) fn blob(digest: &Digest) -> String {
    let name = digest.to_hex();
    format!("{BLOBS}/{}/{name}", name.get(..2).unwrap_or_default())
}

pub(crate) fn recipe(digest: &Digest) -> String {
    format!("{RECIPES}/{digest}.json")
}

pub(crate) fn record(fingerprint: &Digest) -> String {
    let name = fingerprint.to_hex();
    format!("{UNITS}/{}/{name}.json", name.get(..2).unwrap_or_default())
}

/// Prefix of the runs of a pipeline.
pub(crate) fn runs(pipeline: &str) -> String {
    format!("{RUNS}/{pipeline}")
}

pub(crate) fn run(pipeline: &str, name: &str) -> String {
    format!("{RUNS}/{pipeline}/{name}.json")
}

pub(crate) fn differing(fingerprint: &Digest, name: &str) -> String {
    format!("{DIFFERING}/{fingerprint}/{name}.json")
}

pub(crate) fn claim(fingerprint: &Digest) -> String {
    format!("claims/{fingerprint}")
}

pub(crate) fn message(key: &str) -> String {
    format!("{MESSAGES}/{key}")
}

/// The digest that a key ends in.
pub(crate) fn digest_of(key: &str) -> Option<Digest> {
    let name = key.rsplit('/').next()?;
    name.strip_suffix(".json").unwrap_or(name).parse().ok()
}
