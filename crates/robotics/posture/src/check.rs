//! Refuses tasks and postures that do not fit a hand.

use crate::{SolverError, compiled::CompiledHand, posture::Posture, task::Task};

impl Task<'_> {
    /// Checks that the task fits a hand.
    pub(crate) fn check(&self, hand: &CompiledHand) -> Result<(), SolverError> {
        for (idx, target) in self.targets.iter().enumerate() {
            if target.point >= hand.point_count() {
                return Err(SolverError::NoPoint {
                    point: target.point,
                    found: hand.point_count(),
                });
            }
            let sum =
                target.point_in_object.x + target.point_in_object.y + target.point_in_object.z;
            if !sum.is_finite() {
                return bad(format!("target {idx}"));
            }
            weight("a target's weight", target.weight)?;
        }
        if let Some(vectors) = &self.vectors {
            if !(vectors.beta_m.is_finite() && vectors.beta_m > 0.0) {
                return bad("`beta_m` of the vectors".to_owned());
            }
            for (idx, target) in vectors.vectors.iter().enumerate() {
                hand.vector(target.vector)?;
                if !target.vector_in_object.sum().is_finite() {
                    return bad(format!("target vector {idx}"));
                }
                weight("a target vector's weight", target.weight)?;
            }
        }
        if let Some(smoothness) = &self.smoothness {
            length("points before", smoothness.points.len(), self.targets.len())?;
            weight("`point_weight`", smoothness.point_weight)?;
            weight("`joint_weight`", smoothness.joint_weight)?;
            weight("`root_weight`", smoothness.root_weight)?;
            smoothness.posture.check(hand.dof())?;
            if smoothness
                .points
                .iter()
                .any(|p| !(p.x + p.y + p.z).is_finite())
            {
                return bad("a point before".to_owned());
            }
        }
        if let Some(prior) = &self.prior {
            length("joint positions of the prior", prior.q.len(), hand.dof())?;
            weight("the weight of the prior", prior.weight)?;
            finite("a joint position of the prior", prior.q)?;
        }
        Ok(())
    }
}

impl Posture {
    /// Checks that the posture is of so many joints.
    pub(crate) fn check(&self, dof: usize) -> Result<(), SolverError> {
        length("joint positions", self.q.len(), dof)?;
        finite("a joint position", &self.q)?;
        let root = &self.root;
        if !(root.translation.sum() + root.rotation.sum() + root.angles.sum()).is_finite() {
            return bad("the root's pose".to_owned());
        }
        Ok(())
    }
}

fn length(what: &'static str, found: usize, expected: usize) -> Result<(), SolverError> {
    if found == expected {
        return Ok(());
    }
    Err(SolverError::WrongLength {
        what,
        found,
        expected,
    })
}

fn finite(what: &str, numbers: &[f64]) -> Result<(), SolverError> {
    if numbers.iter().all(|number| number.is_finite()) {
        return Ok(());
    }
    bad(what.to_owned())
}

fn weight(what: &str, weight: f64) -> Result<(), SolverError> {
    if weight.is_finite() && weight >= 0.0 {
        return Ok(());
    }
    bad(what.to_owned())
}

fn bad(what: String) -> Result<(), SolverError> {
    Err(SolverError::BadNumber { what })
}
