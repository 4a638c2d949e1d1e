//! The event stream of a run, for units made in threads or in other processes.
//!
//! Threads pass events on directly; a process that makes a unit writes them to its stdout, one JSON
//! object per line.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::{
    digest::Digest,
    name::{NodeName, UnitName},
};

/// Receives events, from any thread of a run.
pub type Events<'a> = dyn Fn(&Event) + Sync + 'a;

/// Something that happened in a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case", deny_unknown_fields)]
pub enum Event {
    /// The run has begun.
    RunStarted {
        /// Number of outputs that it goes through.
        n_outputs: usize,
    },
    /// An output has units to make.
    OutputStarted {
        /// The output.
        output: NodeName,
        /// Number of its units, cached ones included.
        n_units: usize,
    },
    /// Another process is making a unit; this one waits for it.
    UnitWaiting {
        /// The unit.
        unit: UnitName,
        /// Description of the lock's holder.
        holder: String,
    },
    /// A unit is in progress.
    UnitProgress {
        /// The unit.
        unit: UnitName,
        /// Completed fraction.
        fraction: Fraction,
        /// Current activity.
        message: String,
    },
    /// The worker that made a unit was lost; the unit is tried again, unless that has happened
    /// often.
    UnitLost {
        /// The unit.
        unit: UnitName,
        /// Why, as a sentence without a final period.
        why: String,
    },
    /// A unit could not be begun, because it could not read artifacts of others.
    UnitLacking {
        /// The unit.
        unit: UnitName,
        /// The units whose artifacts are missing or damaged.
        lacks: Vec<UnitName>,
    },
    /// Units were handed to a scheduler, or their state there has changed.
    Queue {
        /// The output.
        output: NodeName,
        /// Name of the scheduler's configuration.
        on: String,
        /// Units that wait for a machine, by the reason that the scheduler names.
        waiting: BTreeMap<String, usize>,
        /// Units that are being made, by machine.
        running: BTreeMap<String, usize>,
    },
    /// The artifact of a unit is damaged and is rebuilt.
    UnitDamaged {
        /// The unit.
        unit: UnitName,
    },
    /// The result of a unit is in the store.
    UnitDone {
        /// The unit.
        unit: UnitName,
        /// Digest of its fingerprint.
        fingerprint: Digest,
        /// Whether it was made now and not by an earlier run.
        made_now: bool,
        /// Why it was skipped, if it was.
        skipped: Option<String>,
    },
    /// A unit failed.
    UnitFailed {
        /// The unit.
        unit: UnitName,
        /// The error and its causes.
        message: String,
        /// Suggested fix.
        hint: Option<String>,
        /// The upstream output that left out too many items, if that is why.
        left_out: Option<NodeName>,
    },
    /// Every unit of an output is done.
    OutputDone {
        /// The output.
        output: NodeName,
        /// The stage's line about it.
        description: String,
        /// Number of units that this run made.
        n_made_now: usize,
        /// Seconds it took.
        seconds: f64,
    },
}

/// A progress fraction in 0..=1.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Serialize, Deserialize)]
#[serde(try_from = "f64", into = "f64")]
pub struct Fraction(f64);

impl Fraction {
    /// Returns the fraction nearest to a number; 0 for NaN.
    pub fn nearest(number: f64) -> Self {
        Self(if number.is_nan() {
            0.0
        } else {
            number.clamp(0.0, 1.0)
        })
    }
}

impl From<Fraction> for f64 {
    fn from(fraction: Fraction) -> Self {
        fraction.0
    }
}

impl TryFrom<f64> for Fraction {
    type Error = String;

    fn try_from(number: f64) -> Result<Self, String> {
        if (0.0..=1.0).contains(&number) {
            Ok(Self(number))
        } else {
            Err(format!("{number} is not a fraction: it is not in 0..=1"))
        }
    }
}
