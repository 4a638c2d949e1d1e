//! Eigengrasps: principal components of grasps.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use robot::RobotModel;

use crate::EigengraspError;

/// Variance below which a component is none, in rad²: a thousandth of a degree, squared.
const MIN_VARIANCE: f64 = 1e-10;

/// The mean of grasps and the directions in which they differ most.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Basis {
    /// The mean joint positions, in radians.
    pub(crate) mean: Vec<f64>,
    /// Directions of unit length, the one of the greatest variance first, each times the standard deviation along it
    /// (rad).
    pub(crate) eigengrasps: Vec<Vec<f64>>,
    /// Share of the grasps' variance along them.
    pub(crate) explained: f64,
}

impl Basis {
    /// Returns the first `n` principal components of grasps, in radians; of each the largest entry is positive.
    ///
    /// # Errors
    ///
    /// Fails if the grasps do not differ in so many independent directions.
    pub(crate) fn of(grasps: &[Vec<f64>], n: usize) -> Result<Self, EigengraspError> {
        let few = || EigengraspError::FewGrasps {
            found: grasps.len(),
            asked: n,
        };
        let dof = grasps.first().ok_or_else(few)?.len();
        let count = grasps.len() as f64;
        let mean = |joint: usize| grasps.iter().map(|q| q[joint]).sum::<f64>() / count;
        let mean: Vec<f64> = (0..dof).map(mean).collect();
        let mut covariance = DMatrix::zeros(dof, dof);
        for q in grasps {
            let off = DVector::from_iterator(dof, q.iter().zip(&mean).map(|(q, mean)| q - mean));
            covariance += &off * off.transpose() / count;
        }
        let total = covariance.trace();
        let eigen = SymmetricEigen::new(covariance);
        let mut order: Vec<usize> = (0..dof).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let chosen = order.get(..n).ok_or_else(few)?;
        if chosen
            .iter()
            .any(|&idx| eigen.eigenvalues[idx] < MIN_VARIANCE)
        {
            return Err(few());
        }
        let eigengrasp = |&idx: &usize| {
            let direction = eigen.eigenvectors.column(idx);
            let sign = direction[direction.iamax()].signum();
            let size = sign * eigen.eigenvalues[idx].sqrt();
            direction.iter().map(|entry| entry * size).collect()
        };
        let explained: f64 = chosen.iter().map(|&idx| eigen.eigenvalues[idx]).sum();
        Ok(Self {
            eigengrasps: chosen.iter().map(eigengrasp).collect(),
            explained: explained / total,
            mean,
        })
    }

    /// Returns joint positions from amplitudes, in standard deviations; a joint stops at its limits.
    pub(crate) fn joints(&self, amplitudes: &[f64], hand: &RobotModel) -> Vec<f64> {
        let mut q = self.mean.clone();
        for (amplitude, eigengrasp) in amplitudes.iter().zip(&self.eigengrasps) {
            for (q, along) in q.iter_mut().zip(eigengrasp) {
                *q += amplitude * along;
            }
        }
        for (q, joint) in q.iter_mut().zip(hand.joints()) {
            *q = joint.clamp(*q);
        }
        q
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    /// Two directions with deviations 0.5 and 0.2 about a mean, at all four corners.
    #[test]
    fn components_of_a_known_distribution_are_found_with_their_variance() {
        let mean = [0.1, 0.2, 0.3];
        let (first, second) = ([0.6, 0.8, 0.0], [-0.8, 0.6, 0.0]);
        let mut grasps = Vec::new();
        for a in [-0.5, 0.5] {
            for b in [-0.2, 0.2] {
                let q = (0..3).map(|k| mean[k] + a * first[k] + b * second[k]);
                grasps.push(q.collect::<Vec<f64>>());
            }
        }
        let one = Basis::of(&grasps, 1).unwrap();
        assert!(
            (one.explained - 0.25 / 0.29).abs() < 1e-12,
            "{}",
            one.explained
        );
        let both = Basis::of(&grasps, 2).unwrap();
        assert!((both.explained - 1.0).abs() < 1e-12);
        for k in 0..3 {
            assert!((both.mean[k] - mean[k]).abs() < 1e-12);
            assert!((both.eigengrasps[0][k] - 0.5 * first[k]).abs() < 1e-12);
            // Its largest entry is positive.
            assert!((both.eigengrasps[1][k] + 0.2 * second[k]).abs() < 1e-12);
        }
        let three = Basis::of(&grasps, 3);
        assert!(matches!(
            three,
            Err(EigengraspError::FewGrasps { found: 4, asked: 3 })
        ));
        assert!(Basis::of(&[], 1).is_err());
    }

    #[test]
    fn amplitudes_move_joints_as_far_as_their_limits() {
        let hand = fixture::body().model().clone();
        let mut along = vec![0.0; hand.dof()];
        along[1] = 0.3;
        let basis = Basis {
            mean: fixture::GRASP_Q.to_vec(),
            eigengrasps: vec![along],
            explained: 1.0,
        };
        let q = basis.joints(&[2.0], &hand);
        assert!((q[1] - 1.3).abs() < 1e-12);
        assert_eq!(q[0], fixture::GRASP_Q[0]);
        assert_eq!(basis.joints(&[9.0], &hand)[1], hand.joints()[1].upper);
    }
}
