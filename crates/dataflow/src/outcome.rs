//! What became of one partition.

use std::collections::BTreeMap;

/// What became of one partition.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome {
    /// The files in [`Context::folder`](crate::Context::folder) are the artifact.
    Made(Made),
    /// The item cannot be used; counted, listed, and the run ends with exit code 3.
    Skipped {
        /// Why, as one sentence without a final period.
        reason: String,
    },
    /// The configuration asks to leave this item out; listed, and no fault.
    Filtered {
        /// Why, as one sentence without a final period.
        reason: String,
    },
}

/// What is said about a partition beside its files.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Made {
    /// Facts by which later stages choose partitions, e.g. `object = 003_cracker_box`.
    pub labels: Labels,
    /// Counts and figures for the stage's line and for comparing runs.
    pub metrics: BTreeMap<String, f64>,
}

/// Facts by which later stages choose partitions, e.g. `object = 003_cracker_box`.
pub type Labels = BTreeMap<String, String>;
