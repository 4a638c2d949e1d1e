//! Watching a run.

use crate::{graph::Node, run::NodeReport, store::RecordOutcome};

/// Someone who is told what a run does, from any of its threads.
#[expect(unused_variables, reason = "an observer may ignore any of the events")]
pub trait Observer: Sync {
    /// The outputs that the run goes through, before the first of them.
    fn planned(&self, nodes: &[&Node]) {}

    /// An output has this many units, of which this many have to be made. Not called if none has.
    fn node_started(&self, node: &Node, n_units: usize, n_to_make: usize) {}

    /// A unit is being made by another process: who, in words.
    fn waiting(&self, node: &Node, partition: &str, holder: &str) {}

    /// A unit is this far, as a fraction in 0..=1, and does this.
    fn unit_progress(&self, node: &Node, partition: &str, fraction: f64, message: &str) {}

    /// A unit is done, by this run or an earlier one.
    fn unit_done(&self, node: &Node, partition: &str, outcome: &RecordOutcome) {}

    /// A damaged artifact was dropped and is made again.
    fn damaged(&self, node: &Node, partition: &str) {}

    /// All units of an output are done.
    fn node_done(&self, report: &NodeReport) {}
}
