//! Fault injection: failures of real cells, routers and networks.

use std::{
    process,
    str::FromStr,
    sync::{
        Mutex,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
    time::Duration,
};

use super::lock;
use crate::Report;

/// The bytes of a garbled answer.
pub(super) const GARBLED: &[u8] = b"?\n";
/// The false rise of a wrong report, in meters.
const WRONG_LIFT_M: f64 = -5.0;

/// Delay of a late answer.
const LATE: Duration = Duration::from_secs(3);

/// A fault of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// The cell's process dies after accepting a goal, before it answers.
    DieBeforeAnswer,
    /// It dies right after it has answered.
    DieAfterAnswer,
    /// It dies in the middle of the motion.
    DieInMotion,
    /// The answer to a goal is lost.
    LoseAnswer,
    /// The answer to a goal is three seconds late.
    LateAnswer,
    /// The goal is answered twice.
    DoubleAnswer,
    /// The first answer to a question for a report is lost.
    LoseResult,
    /// From this goal on, goals and report queries are not answered.
    NeverAnswer,
    /// The answer to a goal is garbled.
    GarbledAnswer,
    /// The report is cut in the middle of a number.
    GarbledReport,
    /// The reported rise differs from that of the samples.
    WrongReport,
}

/// A fault and the goal at which it happens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlannedFault {
    /// The fault.
    pub fault: Fault,
    /// Number of the received goal at which it happens, from 1.
    pub at: usize,
}

impl Fault {
    const ALL: [(&'static str, Self); 11] = [
        ("die_before_answer", Self::DieBeforeAnswer),
        ("die_after_answer", Self::DieAfterAnswer),
        ("die_in_motion", Self::DieInMotion),
        ("lose_answer", Self::LoseAnswer),
        ("late_answer", Self::LateAnswer),
        ("double_answer", Self::DoubleAnswer),
        ("lose_result", Self::LoseResult),
        ("never_answer", Self::NeverAnswer),
        ("garbled_answer", Self::GarbledAnswer),
        ("garbled_report", Self::GarbledReport),
        ("wrong_report", Self::WrongReport),
    ];
}

impl FromStr for PlannedFault {
    type Err = String;

    /// Parses e.g. `die_after_answer@2`; without a number it is the first goal.
    fn from_str(text: &str) -> Result<Self, String> {
        let (name, at) = text.split_once('@').unwrap_or((text, "1"));
        let found = Fault::ALL.iter().find(|(known, _)| *known == name);
        let (_, fault) = found.ok_or_else(|| {
            let names = Fault::ALL.map(|(name, _)| name).join(", ");
            format!("`{name}` is not a fault; there are {names}")
        })?;
        let at = at
            .parse::<usize>()
            .ok()
            .filter(|&at| at > 0)
            .ok_or_else(|| format!("`{at}` is not a number of a goal, from 1"))?;
        Ok(Self { fault: *fault, at })
    }
}

/// The pending faults.
pub(super) struct Faults {
    goals_n: AtomicUsize,
    planned: Mutex<Vec<PlannedFault>>,
}

impl Faults {
    pub(super) fn new(planned: Vec<PlannedFault>) -> Self {
        Self {
            goals_n: AtomicUsize::new(0),
            planned: Mutex::new(planned),
        }
    }

    /// Counts a goal.
    pub(super) fn goal(&self) {
        self.goals_n.fetch_add(1, Ordering::SeqCst);
    }

    /// Returns whether a fault happens now, and removes it.
    pub(super) fn strikes(&self, fault: Fault) -> bool {
        let at = self.goals_n.load(Ordering::SeqCst);
        let mut planned = lock(&self.planned);
        let found = planned.iter().position(|p| p.fault == fault && p.at == at);
        found.map(|idx| planned.remove(idx)).is_some()
    }

    /// Returns whether a permanent fault has begun.
    pub(super) fn lasts(&self, fault: Fault) -> bool {
        let at = self.goals_n.load(Ordering::SeqCst);
        let mut planned = lock(&self.planned).clone().into_iter();
        planned.any(|p| p.fault == fault && p.at <= at)
    }

    /// Ends this process as a crash does, if the fault is due.
    pub(super) fn die(&self, fault: Fault) {
        if self.strikes(fault) {
            process::abort();
        }
    }

    /// Serializes a report, wrong or garbled if such a fault is due.
    pub(super) fn given(&self, mut report: Report) -> Vec<u8> {
        if self.strikes(Fault::WrongReport) {
            report.lift_m = WRONG_LIFT_M;
        }
        let mut bytes = report.to_bytes();
        if self.strikes(Fault::GarbledReport) {
            bytes.pop();
        }
        bytes
    }

    /// Delays the answer, if that fault is due.
    pub(super) fn delay(&self) {
        if self.strikes(Fault::LateAnswer) {
            thread::sleep(LATE);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_named_and_numbered() {
        let fault: PlannedFault = "lose_answer@3".parse().unwrap();
        assert_eq!((fault.fault, fault.at), (Fault::LoseAnswer, 3));
        assert_eq!("die_in_motion".parse::<PlannedFault>().unwrap().at, 1);
        for wrong in ["", "explode", "lose_answer@0", "lose_answer@x"] {
            assert!(wrong.parse::<PlannedFault>().is_err(), "{wrong}");
        }
        let faults = Faults::new(vec![fault]);
        faults.goal();
        assert!(!faults.strikes(Fault::LoseAnswer));
        faults.goal();
        faults.goal();
        assert!(faults.strikes(Fault::LoseAnswer));
        assert!(!faults.strikes(Fault::LoseAnswer));
    }
}
