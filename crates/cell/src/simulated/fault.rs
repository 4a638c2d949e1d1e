//! Faults on request: what real cells, routers and networks do to a dispatcher.

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

/// What is said instead of an answer.
pub(super) const GARBLED: &[u8] = b"?\n";
/// How far an object has not risen, in meters.
const WRONG_LIFT_M: f64 = -5.0;

/// How late an answer is.
const LATE: Duration = Duration::from_secs(3);

/// Something that goes wrong at a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// The cell's process dies when it has taken a goal, before it answers.
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
    /// From this goal on no goal and no question for a report is answered.
    NeverAnswer,
    /// The answer to a goal is no answer.
    GarbledAnswer,
    /// The report is cut in the middle of a number.
    GarbledReport,
    /// The report says that the object rose otherwise than it shows.
    WrongReport,
}

/// A fault and the goal at which it happens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlannedFault {
    /// What goes wrong.
    pub fault: Fault,
    /// At which of the goals that the cell is sent, from 1.
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

    /// Reads e.g. `die_after_answer@2`; without a number it is the first goal.
    fn from_str(text: &str) -> Result<Self, String> {
        let (name, at) = text.split_once('@').unwrap_or((text, "1"));
        let found = Fault::ALL.iter().find(|(known, _)| *known == name);
        let (_, fault) = found.ok_or_else(|| {
            let names = Fault::ALL.map(|(name, _)| name).join(", ");
            format!("`{name}` is no fault; there are {names}")
        })?;
        let at = at
            .parse::<usize>()
            .ok()
            .filter(|&at| at > 0)
            .ok_or_else(|| format!("`{at}` is no number of a goal, from 1"))?;
        Ok(Self { fault: *fault, at })
    }
}

/// The faults that are still to come.
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

    /// Returns whether a fault happens now, and that it has.
    pub(super) fn strikes(&self, fault: Fault) -> bool {
        let at = self.goals_n.load(Ordering::SeqCst);
        let mut planned = lock(&self.planned);
        let found = planned.iter().position(|p| p.fault == fault && p.at == at);
        found.map(|idx| planned.remove(idx)).is_some()
    }

    /// Returns whether a fault has begun that does not end.
    pub(super) fn lasts(&self, fault: Fault) -> bool {
        let at = self.goals_n.load(Ordering::SeqCst);
        let mut planned = lock(&self.planned).clone().into_iter();
        planned.any(|p| p.fault == fault && p.at <= at)
    }

    /// Ends this process as a crash does, if the fault happens now.
    pub(super) fn die(&self, fault: Fault) {
        if self.strikes(fault) {
            process::abort();
        }
    }

    /// Returns a report as it is given.
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

    /// Waits, if the answer is to be late.
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
