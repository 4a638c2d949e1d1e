//! Mean hands, and distances from them: if drawn motions do not differ, the function has collapsed.

use motion::{HandRates, Step};
use nalgebra::{Matrix4, Quaternion, UnitQuaternion, Vector3, Vector4};
use schemas::{candidates::Candidate, sampling::GraspDistance};
use spatial::{Object, Pose, Table};

/// Cosine of the angle between up directions, in the object's frame, up to which an object lies alike: 10 degrees.
/// Recorded orientations differ by a few degrees; the resting orientations of an object differ by more.
const SAME_UP: f64 = 0.984_807_753;

/// A motion that is compared with others.
#[derive(Debug, Clone)]
pub struct ComparedMotion<'a, R = HandRates<Object>> {
    /// Resting pose of the object.
    pub table_from_object: Pose<Table, Object>,
    /// The hand at equal parts of the motion's time; the last one is the grasp.
    pub steps: Vec<&'a Step<Object, R>>,
}

impl<'a> From<&'a Candidate> for ComparedMotion<'a> {
    fn from(candidate: &'a Candidate) -> Self {
        Self {
            table_from_object: candidate.table_from_object,
            steps: candidate.motion.steps().iter().collect(),
        }
    }
}

/// The hand over the motions of an object: means, and spread around them.
///
/// Only motions in which the object lies alike are compared, its up directions within 10 degrees: each is measured from
/// their mean.
#[derive(Debug, Clone, PartialEq)]
pub struct Diversity {
    /// Distance of each motion's grasp from the mean of its group; `None` if it has no step.
    pub from_mean: Vec<Option<GraspDistance>>,
    /// Whether each motion's group has another motion.
    pub is_compared: Vec<bool>,
    /// Root mean square distance from the mean at the grasp.
    pub at_grasp: GraspDistance,
    /// Root mean square distance over all steps.
    pub over_time: GraspDistance,
    /// Root mean square distance at each step.
    pub by_step: Vec<GraspDistance>,
    /// Root mean square distance of each joint at the grasp, in radians (meters if prismatic).
    pub joints_rad: Vec<f64>,
    /// Number of motions whose group has another one.
    pub compared_n: usize,
}

/// The mean of several hands.
#[derive(Debug, Clone, PartialEq)]
struct MeanHand {
    position: Vector3<f64>,
    rotation: UnitQuaternion<f64>,
    q: Vec<f64>,
}

impl MeanHand {
    /// Returns the mean of hands in one frame.
    fn of<R>(steps: &[&Step<Object, R>]) -> Self {
        let n = steps.len().max(1) as f64;
        let poses = || steps.iter().map(|step| step.frame_from_palm);
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

    /// Returns a hand's distance from the mean.
    fn distance<R>(&self, step: &Step<Object, R>) -> GraspDistance {
        let pose = step.frame_from_palm;
        GraspDistance {
            palm_m: (pose.translation.vector - self.position).norm(),
            palm_rad: pose.rotation.angle_to(&self.rotation),
            q_rad: root_mean_square(&step.q_rad, &self.q),
        }
    }
}

impl Diversity {
    /// Spread at the grasp below which motions count as equal, whatever the latent code: far below
    /// what matters to a hand.
    const SAME_GRASP: GraspDistance = GraspDistance {
        palm_m: 1e-3,
        palm_rad: 1e-2,
        q_rad: 1e-2,
    };

    /// Measures motions with equal numbers of steps.
    pub fn of<R>(motions: &[ComparedMotion<R>]) -> Self {
        // The up direction of each group's first motion, in the object's frame.
        let mut lying: Vec<Vector3<f64>> = Vec::new();
        let mut group_of = Vec::with_capacity(motions.len());
        for motion in motions {
            let up_in_object = motion.table_from_object.rotation.inverse() * Vector3::z();
            let is_alike = |other: &Vector3<f64>| other.dot(&up_in_object) > SAME_UP;
            let known = lying.iter().position(is_alike);
            group_of.push(known.unwrap_or_else(|| {
                lying.push(up_in_object);
                lying.len() - 1
            }));
        }
        let n_steps = motions.iter().map(|motion| motion.steps.len()).min();
        let mut over_time = Squares::default();
        let mut by_step = vec![Squares::default(); n_steps.unwrap_or(0)];
        let mut at_grasp = Squares::default();
        let mut from_mean = vec![None; motions.len()];
        let mut is_compared = vec![false; motions.len()];
        for group in 0..lying.len() {
            let members: Vec<usize> = (0..motions.len())
                .filter(|&number| group_of[number] == group)
                .collect();
            let grasp_of = |&number: &usize| motions[number].steps.last().copied();
            let grasps: Vec<&Step<Object, R>> = members.iter().filter_map(grasp_of).collect();
            let mean = MeanHand::of(&grasps);
            for number in &members {
                from_mean[*number] = grasp_of(number).map(|grasp| mean.distance(grasp));
            }
            if members.len() < 2 {
                continue;
            }
            for number in &members {
                is_compared[*number] = true;
            }
            at_grasp.add(&grasps);
            for (step, squares) in by_step.iter_mut().enumerate() {
                let steps: Vec<&Step<Object, R>> = members
                    .iter()
                    .filter_map(|&number| motions[number].steps.get(step).copied())
                    .collect();
                squares.add(&steps);
                over_time.add(&steps);
            }
        }
        Self {
            from_mean,
            compared_n: is_compared.iter().filter(|is_one| **is_one).count(),
            is_compared,
            at_grasp: at_grasp.root_mean(),
            over_time: over_time.root_mean(),
            by_step: by_step.iter().map(Squares::root_mean).collect(),
            joints_rad: at_grasp.joints(),
        }
    }

    /// Whether all motions are equal: the latent code then has no effect.
    pub fn is_collapsed(&self) -> bool {
        let GraspDistance {
            palm_m,
            palm_rad,
            q_rad,
        } = self.at_grasp;
        self.compared_n > 0
            && palm_m < Self::SAME_GRASP.palm_m
            && palm_rad < Self::SAME_GRASP.palm_rad
            && q_rad < Self::SAME_GRASP.q_rad
    }
}

/// Returns the rotation with the least sum of squared matrix distances: the eigenvector of the
/// largest eigenvalue of the sum of q qᵀ (Markley et al., *Averaging Quaternions*, 2007, equation
/// 12); the identity for no rotations.
///
/// nalgebra's `mean_of` orders the eigenvector's numbers differently from its quaternions'.
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
#[derive(Debug, Clone, Default)]
struct Squares {
    sum: GraspDistance,
    of_joints: Vec<f64>,
    n: usize,
}

impl Squares {
    fn add<R>(&mut self, steps: &[&Step<Object, R>]) {
        let mean = MeanHand::of(steps);
        self.of_joints.resize(mean.q.len(), 0.0);
        for step in steps {
            let joints = step.q_rad.iter().zip(&mean.q);
            for (sum, (q, mean)) in self.of_joints.iter_mut().zip(joints) {
                *sum += (q - mean).powi(2);
            }
            let distance = mean.distance(step);
            self.sum.palm_m += distance.palm_m.powi(2);
            self.sum.palm_rad += distance.palm_rad.powi(2);
            self.sum.q_rad += distance.q_rad.powi(2);
            self.n += 1;
        }
    }

    fn root_mean(&self) -> GraspDistance {
        GraspDistance {
            palm_m: self.root(self.sum.palm_m),
            palm_rad: self.root(self.sum.palm_rad),
            q_rad: self.root(self.sum.q_rad),
        }
    }

    fn joints(&self) -> Vec<f64> {
        self.of_joints.iter().map(|sum| self.root(*sum)).collect()
    }

    fn root(&self, sum: f64) -> f64 {
        (sum / self.n.max(1) as f64).sqrt()
    }
}

/// Returns the distance between two hands.
pub fn distance<R, S>(a: &Step<Object, R>, b: &Step<Object, S>) -> GraspDistance {
    let (from, to) = (a.frame_from_palm, b.frame_from_palm);
    GraspDistance {
        palm_m: (from.translation.vector - to.translation.vector).norm(),
        palm_rad: from.rotation.angle_to(&to.rotation),
        q_rad: root_mean_square(&a.q_rad, &b.q_rad),
    }
}

/// Returns the root mean square difference of joint positions.
fn root_mean_square(a: &[f64], b: &[f64]) -> f64 {
    let squares: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
    (squares / a.len().max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;
    use schemas::candidates::DrawSource;
    use spatial::Pose;

    use super::*;

    /// A motion for an object tilted by `tilt_rad`, that ends at `x`, turned by `angle` about z, its joint at `q`.
    fn motion(tilt_rad: f64, x: f64, angle: f64, q: f64) -> Candidate {
        let step = |share: f64| Step {
            time_s: share,
            frame_from_palm: Pose::new(Isometry3::new(
                Vector3::new(x * share, 0.0, 0.3),
                Vector3::z() * angle,
            )),
            q_rad: vec![q, 0.5],
            rates: HandRates::zero(2),
        };
        Candidate {
            candidate_id: String::new(),
            generator: String::new(),
            source: DrawSource::replayed("a"),
            latent: Vec::new(),
            table_from_object: Pose::new(Isometry3::rotation(Vector3::x() * tilt_rad)),
            limit_excess_rad: 0.0,
            depth_m: None,
            residual_m2: None,
            motion: motion::Motion::new(&["j", "k"], vec![step(0.0), step(1.0)]).unwrap(),
        }
    }

    fn of(candidates: &[Candidate]) -> Diversity {
        Diversity::of(
            &candidates
                .iter()
                .map(ComparedMotion::from)
                .collect::<Vec<_>>(),
        )
    }

    #[test]
    fn spread_is_the_standard_deviation_about_the_mean() {
        let found = of(&[
            motion(0.1, 0.02, 0.3, 0.2),
            // Nearly as the first.
            motion(0.2, -0.02, -0.3, -0.2),
            // No other object lies like this one: it is not compared.
            motion(0.3, 9.0, 0.0, 9.0),
        ]);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} {b}");
        near(found.at_grasp.palm_m, 0.02);
        near(found.at_grasp.palm_rad, 0.3);
        near(found.at_grasp.q_rad, 0.2 / 2.0_f64.sqrt());
        // At the first step both palms are in one place.
        near(found.over_time.palm_m, 0.02 / 2.0_f64.sqrt());
        near(found.by_step[0].palm_m, 0.0);
        near(found.by_step[1].palm_m, 0.02);
        near(found.joints_rad[0], 0.2);
        near(found.joints_rad[1], 0.0);
        near(found.from_mean[1].unwrap().palm_m, 0.02);
        assert_eq!(found.is_compared, [true, true, false]);
        assert!(!found.is_collapsed());
    }

    #[test]
    fn one_motion_for_all_codes_is_a_collapse_in_any_orientation() {
        let collapsed = [
            motion(0.1, 0.2, 0.0, 0.3),
            motion(0.1, 0.2, 0.0, 0.3),
            motion(0.3, -0.2, 1.0, 0.1),
            motion(0.3, -0.2, 1.0, 0.1),
        ];
        let found = of(&collapsed);
        assert!(found.is_collapsed(), "{found:?}");
        assert_eq!(found.is_compared, [true; 4]);
        assert_eq!(found.compared_n, 4);
        // One motion cannot be told apart from a collapse.
        assert!(!of(&collapsed[..1]).is_collapsed());
        assert!(!of(&[]).is_collapsed());
    }
}
