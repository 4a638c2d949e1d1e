//! Stored results of units.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::{
    digest::{Digest, Fields},
    fingerprint::Fingerprint,
    metrics::MetricValues,
    name::FileName,
    outcome::Labels,
};

/// One file of an artifact, stored under its digest.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileRef {
    /// Digest of the bytes.
    pub digest: Digest,
    /// Number of bytes.
    pub size: u64,
}

/// The outcome of a unit, stored under its fingerprint.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// Everything that the result depends on.
    pub fingerprint: Fingerprint,
    /// The result.
    pub outcome: RecordOutcome,
}

/// The result of a unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "result", rename_all = "snake_case")]
pub enum RecordOutcome {
    /// Files that are the artifact.
    Made {
        /// The files by name.
        files: BTreeMap<FileName, FileRef>,
        /// Facts by which later stages choose partitions.
        labels: Labels,
        /// Counts and other metrics.
        metrics: MetricValues,
        /// Whether it is for the run that made it alone.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        provisional: bool,
    },
    /// The item could not be used.
    Skipped {
        /// Why.
        reason: String,
    },
    /// The configuration excludes the item.
    Filtered {
        /// Why.
        reason: String,
    },
}

impl RecordOutcome {
    /// Whether there is an artifact.
    pub fn is_made(&self) -> bool {
        matches!(self, Self::Made { .. })
    }

    /// Whether the outcome is for the run that made it alone: another run makes it again.
    pub fn is_provisional(&self) -> bool {
        matches!(self, Self::Made { provisional, .. } if *provisional)
    }

    /// Returns the outcome in one word: `made`, `skipped` or `filtered`.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Made { .. } => "made",
            Self::Skipped { .. } => "skipped",
            Self::Filtered { .. } => "filtered",
        }
    }

    /// Returns why there is no artifact.
    pub fn reason(&self) -> Option<&str> {
        match self {
            Self::Made { .. } => None,
            Self::Skipped { reason } | Self::Filtered { reason } => Some(reason),
        }
    }

    /// Returns the labels of a made artifact.
    pub fn labels(&self) -> &Labels {
        static NONE: Labels = Labels::new();
        match self {
            Self::Made { labels, .. } => labels,
            Self::Skipped { .. } | Self::Filtered { .. } => &NONE,
        }
    }

    /// Returns the digest of a made artifact: of its files' names and bytes and its labels.
    pub fn artifact_digest(&self) -> Option<Digest> {
        match self {
            Self::Made { files, labels, .. } => {
                let mut fields = Fields::new("artifact");
                digest_files(&mut fields, files.iter());
                fields.number(labels.len() as u64);
                for (label, value) in labels {
                    fields.text(label);
                    fields.text(value);
                }
                Some(fields.finish())
            }
            Self::Skipped { .. } | Self::Filtered { .. } => None,
        }
    }

    /// Returns the digest of a made artifact, or of only the named files of it.
    pub(crate) fn digest_of(&self, parts: Option<&Vec<String>>) -> Option<Digest> {
        let Some(parts) = parts else {
            return self.artifact_digest();
        };
        let Self::Made { files, .. } = self else {
            return None;
        };
        let named: Vec<_> = files
            .iter()
            .filter(|(name, _)| parts.iter().any(|part| **name == *part.as_str()))
            .collect();
        let mut fields = Fields::new("files");
        digest_files(&mut fields, named.into_iter());
        Some(fields.finish())
    }

    /// Returns the files of a made artifact by name.
    pub fn files(&self) -> Option<&BTreeMap<FileName, FileRef>> {
        match self {
            Self::Made { files, .. } => Some(files),
            Self::Skipped { .. } | Self::Filtered { .. } => None,
        }
    }

    /// Returns a file of a made artifact.
    pub fn file(&self, name: &str) -> Option<&FileRef> {
        self.files()?.get(name)
    }

    /// Returns the files of a made artifact, only the named ones if `parts` names any.
    pub(crate) fn parts(&self, parts: Option<&Vec<String>>) -> Option<BTreeMap<FileName, FileRef>> {
        let files = self.files()?.iter();
        let named = files.filter(|(name, _)| {
            parts.is_none_or(|parts| parts.iter().any(|part| **name == *part.as_str()))
        });
        Some(
            named
                .map(|(name, file)| (name.clone(), file.clone()))
                .collect(),
        )
    }
}

fn digest_files<'a>(
    fields: &mut Fields,
    files: impl ExactSizeIterator<Item = (&'a FileName, &'a FileRef)>,
) {
    fields.number(files.len() as u64);
    for (name, file) in files {
        fields.text(name.as_str());
        fields.digest(&file.digest);
    }
}
