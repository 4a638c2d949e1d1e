//! The only clock of the project: times are provenance, never part of an artifact.

use std::time::SystemTime;

/// Returns the time of day.
#[expect(
    clippy::disallowed_methods,
    reason = "the lake notes when things were made, beside the artifacts"
)]
pub(crate) fn now() -> SystemTime {
    SystemTime::now()
}
