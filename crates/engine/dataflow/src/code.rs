//! The code part of a fingerprint: digests of the sources that decide an output.

/// Digests of the sources of a stage or of its report, one per linked workspace crate, and of its
/// locked dependency versions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Code {
    /// `crate=digest` pairs separated by `;`, ordered by name, as the build script wrote them.
    pub parts: &'static str,
}

impl Code {
    /// Iterates over the crates and their digests; a part that is not a pair is kept as it is.
    pub fn iter(self) -> impl Iterator<Item = (&'static str, &'static str)> {
        let parts = self.parts.split(';').filter(|part| !part.is_empty());
        parts.map(|part| part.split_once('=').unwrap_or((part, "")))
    }
}

/// The [`Code`] of a crate that the program depends on (`"stage-train"`), or of its reports
/// (`"report-train"`); the program's build script calls `code_digest::emit()`.
#[macro_export]
macro_rules! code {
    ($name:literal) => {
        $crate::Code {
            parts: env!(concat!("PIPELINE_CODE_", $name)),
        }
    };
}
