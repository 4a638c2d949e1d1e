//! Rows of the table `executions`.

use cell::Report;
use schemas::{
    candidates::Candidate,
    executions::{Execution, Outcome},
};

use crate::{ledger::CellFacts, refusal::Refusal};

/// Returns the row of a motion that was sent.
pub(crate) fn execution(
    cell: &str,
    facts: &CellFacts,
    candidate: &Candidate,
    report: &Report,
) -> Execution {
    Execution {
        goal_id: report.goal_id.clone(),
        candidate_id: candidate.candidate_id.clone(),
        cell: cell.to_owned(),
        simulated: facts.simulated,
        gap: facts.gap.clone(),
        accepted: !matches!(report.outcome, Outcome::Rejected | Outcome::Unknown),
        outcome: report.outcome,
        message: report.message.clone(),
        duration_s: report.duration_s(),
        tracking_error_rad: report.tracking_error_rad(),
        lift_m: report.lift_m,
    }
}

/// Returns the row of a motion that was not sent.
pub(crate) fn not_sent(
    cell: &str,
    facts: &CellFacts,
    candidate: &Candidate,
    refusal: &Refusal,
) -> Execution {
    Execution {
        goal_id: String::new(),
        candidate_id: candidate.candidate_id.clone(),
        cell: cell.to_owned(),
        simulated: facts.simulated,
        gap: facts.gap.clone(),
        accepted: false,
        outcome: Outcome::Rejected,
        message: refusal.to_string(),
        duration_s: 0.0,
        tracking_error_rad: 0.0,
        lift_m: 0.0,
    }
}
