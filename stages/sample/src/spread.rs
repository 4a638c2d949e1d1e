//! How different the motions drawn for an object are: where they are not, the function has collapsed.

use nalgebra::{Matrix4, Quaternion, UnitQuaternion, Vector3, Vector4};
use schemas::{
    candidates::{Candidate, Step},
    sampling::GraspDistance,
};

/// The hand over the motions of an object: means, and spread about them.
///
/// Motions with the object lying differently are not compared: each is measured from the mean of those
/// that share its resting orientation.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Diversity {
    /// For each candidate, the mean of those with which it is compared.
    pub(crate) group_of: Vec<usize>,
    /// The mean grasp of each of these.
    pub(crate) mean_grasps: Vec<MeanHand>,
    /// Root mean square distance from the mean at the grasp.
    pub(crate) at_grasp: GraspDistance,
    /// The same over all steps.
    pub(crate) over_time: GraspDistance,
    /// Motions that have another one to be compared with.
    pub(crate) compared_n: usize,
}

/// The mean of several hands.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct MeanHand {
    position: Vector3<f64>,
    rotation: UnitQuaternion<f64>,
    q: Vec<f64>,
}

impl MeanHand {
    /// Returns the mean of hands in one frame.
    fn of(steps: &[&Step]) -> Self {
        let n = steps.len().max(1) as f64;
        let poses = || steps.iter().map(|step| step.object_from_palm.isometry());
        let dof = steps.first().map_or(0, |step| step.q_rad.len());
        let mut q = vec![0.0; dof];
        for step in steps {
            for (mean, position) in q.iter_mut().zip(&step.q_rad) {
                *mean += position / n;
            }
        }
        Self {
            position: poses()
                .map(|pose| pose.translation.vector)
                .sum::<Vector3<f64>>()
                / n,
            rotation: mean_rotation(poses().map(|pose| pose.rotation)),
            q,
        }
    }

    /// Returns how far a hand is from the mean.
    pub(crate) fn distance(&self, step: &Step) -> GraspDistance {
        let pose = step.object_from_palm.isometry();
        GraspDistance {
            palm_m: (pose.translation.vector - self.position).norm(),
            palm_rad: pose.rotation.angle_to(&self.rotation),
            q_rad: root_mean_square(&step.q_rad, &self.q),
        }
    }
}

impl Diversity {
    /// Spread at the grasp below which motions are one and the same, whatever the latent code: far
    /// less than a hand notices.
    const SAME: GraspDistance = GraspDistance {
        palm_m: 1e-3,
        palm_rad: 1e-2,
        q_rad: 1e-2,
    };

    /// Measures motions of equally many steps.
    pub(crate) fn of(candidates: &[Candidate]) -> Self {
        let mut lying = Vec::new();
        let mut group_of = Vec::with_capacity(candidates.len());
        for candidate in candidates {
            let pose = candidate.table_from_object;
            let known = lying.iter().position(|other| *other == pose);
            group_of.push(known.unwrap_or_else(|| {
                lying.push(pose);
                lying.len() - 1
            }));
        }
        let n_steps = candidates
            .iter()
            .map(|candidate| candidate.steps.len())
            .min();
        let (mut mean_grasps, mut compared_n) = (Vec::new(), 0);
        let (mut at_grasp, mut over_time) = (Squares::default(), Squares::default());
        for group in 0..lying.len() {
            let members = candidates.iter().zip(&group_of);
            let members: Vec<&Candidate> = members
                .filter(|&(_, of)| *of == group)
                .map(|(candidate, _)| candidate)
                .collect();
            let grasps: Vec<&Step> = members.iter().filter_map(|m| m.steps.last()).collect();
            mean_grasps.push(MeanHand::of(&grasps));
            if members.len() < 2 {
                continue;
            }
            compared_n += members.len();
            at_grasp.add(&grasps);
            for step in 0..n_steps.unwrap_or(0) {
                let steps: Vec<&Step> = members.iter().filter_map(|m| m.steps.get(step)).collect();
                over_time.add(&steps);
            }
        }
        Self {
            group_of,
            mean_grasps,
            at_grasp: at_grasp.root_mean(),
            over_time: over_time.root_mean(),
            compared_n,
        }
    }

    /// Says whether the motions are all one: the latent code then decides nothing.
    pub(crate) fn is_collapsed(&self) -> bool {
        let GraspDistance {
            palm_m,
            palm_rad,
            q_rad,
        } = self.at_grasp;
        self.compared_n > 0
            && palm_m < Self::SAME.palm_m
            && palm_rad < Self::SAME.palm_rad
            && q_rad < Self::SAME.q_rad
    }
}

/// Returns the rotation with the least squared distance from all as matrices: the eigenvector of the
/// largest eigenvalue of the sum of q qᵀ (Markley et al., *Averaging Quaternions*, 2007, equation 12);
/// no rotation of none.
///
/// nalgebra's `mean_of` takes the eigenvector's numbers in another order than its quaternions'.
fn mean_rotation(rotations: impl Iterator<Item = UnitQuaternion<f64>>) -> UnitQuaternion<f64> {
    let sum: Matrix4<f64> = rotations.map(|q| q.coords * q.coords.transpose()).sum();
    let eigen = sum.symmetric_eigen();
    let largest = eigen.eigenvalues.imax();
    if eigen.eigenvalues[largest] <= 0.0 {
        return UnitQuaternion::identity();
    }
    let coords: Vector4<f64> = eigen.eigenvectors.column(largest).into_owned();
    UnitQuaternion::from_quaternion(Quaternion::from(coords))
}

/// Sums of squared distances from means.
#[derive(Default)]
struct Squares {
    sum: GraspDistance,
    n: usize,
}

impl Squares {
    fn add(&mut self, steps: &[&Step]) {
        let mean = MeanHand::of(steps);
        for step in steps {
            let distance = mean.distance(step);
            self.sum.palm_m += distance.palm_m.powi(2);
            self.sum.palm_rad += distance.palm_rad.powi(2);
            self.sum.q_rad += distance.q_rad.powi(2);
            self.n += 1;
        }
    }

    fn root_mean(&self) -> GraspDistance {
        let root = |sum: f64| (sum / self.n.max(1) as f64).sqrt();
        GraspDistance {
            palm_m: root(self.sum.palm_m),
            palm_rad: root(self.sum.palm_rad),
            q_rad: root(self.sum.q_rad),
        }
    }
}

/// Returns the root mean square difference of joint positions.
pub(crate) fn root_mean_square(a: &[f64], b: &[f64]) -> f64 {
    let squares: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
    (squares / a.len().max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;
    use schemas::candidates::Rates;
    use spatial::Pose;

    use super::*;

    /// A motion that ends at `x`, turned by `angle` about z, its joint at `q`.
    fn motion(height_m: f64, x: f64, angle: f64, q: f64) -> Candidate {
        let step = |share: f64| Step {
            time_s: share,
            object_from_palm: Pose::new(Isometry3::new(
                Vector3::new(x * share, 0.0, 0.3),
                Vector3::z() * angle,
            )),
            q_rad: vec![q, 0.5],
            rates: Rates::still(2),
        };
        Candidate {
            candidate_id: String::new(),
            generator: String::new(),
            latent: Vec::new(),
            table_from_object: Pose::new(Isometry3::translation(0.0, 0.0, height_m)),
            limit_excess_rad: 0.0,
            steps: vec![step(0.0), step(1.0)],
        }
    }

    #[test]
    fn spread_is_the_standard_deviation_about_the_mean() {
        let found = Diversity::of(&[motion(0.1, 0.02, 0.3, 0.2), motion(0.1, -0.02, -0.3, -0.2)]);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} {b}");
        near(found.at_grasp.palm_m, 0.02);
        near(found.at_grasp.palm_rad, 0.3);
        near(found.at_grasp.q_rad, 0.2 / 2.0_f64.sqrt());
        // At the first step both palms are in one place.
        near(found.over_time.palm_m, 0.02 / 2.0_f64.sqrt());
        assert!(!found.is_collapsed());
    }

    #[test]
    fn one_motion_for_all_codes_is_a_collapse_even_in_two_orientations() {
        let collapsed = [
            motion(0.1, 0.2, 0.0, 0.3),
            motion(0.1, 0.2, 0.0, 0.3),
            motion(0.3, -0.2, 1.0, 0.1),
            motion(0.3, -0.2, 1.0, 0.1),
        ];
        let found = Diversity::of(&collapsed);
        assert!(found.is_collapsed(), "{found:?}");
        assert_eq!(found.group_of, [0, 0, 1, 1]);
        assert_eq!(found.compared_n, 4);
        // One motion cannot be told from a collapse.
        assert!(!Diversity::of(&collapsed[..1]).is_collapsed());
        assert!(!Diversity::of(&[]).is_collapsed());
    }
}
