//! Jobs: the work items that one worker makes, and where they lie in the depot.

use std::path::PathBuf;

use dataflow::{Digest, WorkItem};
use serde::{Deserialize, Serialize};

/// A job: the work items that one worker makes, one after the other.
#[derive(Serialize, Deserialize)]
pub(crate) struct Job {
    /// The folder of the run, from which relative paths lead.
    pub(crate) folder: PathBuf,
    /// Time in seconds between the heartbeats that its worker leaves in the depot.
    pub(crate) heartbeat_s: Option<u64>,
    /// Time in seconds that the job has, if it is limited.
    #[serde(default)]
    pub(crate) limit_s: Option<u64>,
    /// The work items, made one after the other.
    #[serde(rename = "orders")]
    pub(crate) items: Vec<WorkItem>,
}

/// Key of the work items of a job, e.g. `NAME/0`.
pub(crate) fn job_key(job: &str) -> String {
    format!("orders/{job}")
}

/// Key under which a worker leaves the name of its machine when it begins, and heartbeats after it.
pub(crate) fn here_key(job: &str) -> String {
    format!("here/{job}")
}

/// Key of the end of a work item of a job.
pub(crate) fn end_key(job: &str, fingerprint: &Digest) -> String {
    let wave = job.rsplit_once('/').map_or(job, |(wave, _)| wave);
    format!("ends/{wave}/{fingerprint}")
}
