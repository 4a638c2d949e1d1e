//! Candidates as the physics takes them.

use schemas::candidates::Candidate;
use simulation::Motion;

/// Returns a candidate's motion; its joints are the hand's.
pub(crate) fn motion(candidate: &Candidate) -> Motion {
    let steps = candidate.steps.iter();
    Motion {
        time_s: steps.clone().map(|step| step.time_s).collect(),
        object_from_palm: steps
            .clone()
            .map(|step| *step.object_from_palm.isometry())
            .collect(),
        q: steps.map(|step| step.q_rad.clone()).collect(),
        rates: None,
    }
}
