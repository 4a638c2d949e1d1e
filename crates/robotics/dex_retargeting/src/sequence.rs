//! A whole recording.

use motion::{Motion, Step};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use posture::{Posture, Side};
use retargeting::LandmarkStep;
use spatial::{Object, Palm, Pose};

use crate::{Follower, LANDMARKS, ObjectiveKind, Problem, ProblemError, wrist_axes};

/// How landmarks are shown to a robot hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Showing {
    /// As they are: their frame is that of a root link that stands still, or in which a free one moves.
    AsTheyAre,
    /// In the axes of this hand of a person ([`wrist_axes`]): a root link that does not move goes along with the
    /// person's wrist. A free one starts there, and follows landmarks as they are.
    AlongTheWrist(Side),
}

/// A recording, retargeted to a robot hand.
#[derive(Debug, Clone, PartialEq)]
pub struct Sequence {
    /// The hand in the landmarks' frame, with the joints of its model, at the times of the landmarks.
    pub motion: Motion<Object>,
    /// The distance of each point or vector from what it follows at each step, before the filter, in meters.
    pub errors_m: Vec<Vec<f64>>,
    /// Postures that were tried.
    pub iterations_n: usize,
}

/// Retargets a recording, the first step first; `None` of no step.
///
/// # Errors
///
/// Fails if a landmark is not finite, if times do not increase, or if a hand that is to be followed along its wrist
/// has wrist and knuckles on a line.
pub fn retarget(
    problem: &Problem,
    steps: &[LandmarkStep],
    showing: Showing,
) -> Result<Option<Sequence>, ProblemError> {
    let mut live = Follower::new(problem);
    let (mut moved, mut errors_m, mut iterations_n) = (Vec::new(), Vec::new(), 0);
    let wrist = wrist_link(problem);
    for (idx, step) in steps.iter().enumerate() {
        let frame_from_wrist = match showing {
            Showing::AsTheyAre => None,
            Showing::AlongTheWrist(side) => Some(
                wrist_pose(&step.keypoints_m, side).ok_or(ProblemError::NoWrist { step: idx })?,
            ),
        };
        let (found, placed) = match frame_from_wrist {
            Some(frame_from_wrist) if !problem.has_free_root() => {
                let shown = seen_from(&frame_from_wrist, &step.keypoints_m);
                let found = live.step(&shown)?;
                let palm = problem.palm_at(&frame_from_wrist, wrist, &found.posture.q);
                (found, palm)
            }
            frame_from_wrist => {
                if let (0, Some(at)) = (idx, &frame_from_wrist) {
                    let start = Posture::new(&Pose::new(*at), problem.start.q.clone());
                    live.start_at(&start);
                }
                let found = live.step(&step.keypoints_m)?;
                (found, found.posture.root.pose())
            }
        };
        moved.push(Step {
            time_s: step.time_s,
            frame_from_palm: placed,
            q_rad: found.posture.q.clone(),
            rates: (),
        });
        errors_m.push(found.errors_m.to_vec());
        iterations_n += found.iterations;
    }
    if moved.is_empty() {
        return Ok(None);
    }
    Ok(Some(Sequence {
        motion: Motion::new(&problem.model.joint_names(), moved)?.differentiated()?,
        errors_m,
        iterations_n,
    }))
}

/// Returns the pose of the wrist with the person's axes in the frame of the landmarks.
fn wrist_pose(landmarks_m: &[[f64; 3]; LANDMARKS], side: Side) -> Option<Isometry3<f64>> {
    let axes: UnitQuaternion<f64> = wrist_axes(landmarks_m, side)?;
    let at = Vector3::from(landmarks_m[0]);
    Some(Isometry3::from_parts(at.into(), axes))
}

/// Returns the landmarks in the coordinates of the wrist.
fn seen_from(
    frame_from_wrist: &Isometry3<f64>,
    landmarks_m: &[[f64; 3]; LANDMARKS],
) -> [[f64; 3]; LANDMARKS] {
    landmarks_m.map(|at| {
        frame_from_wrist
            .inverse_transform_point(&Point3::from(at))
            .coords
            .into()
    })
}

/// Returns the link that stands for the person's wrist: where the first vector from it starts.
fn wrist_link(problem: &Problem) -> Option<usize> {
    match &problem.objective.kind {
        ObjectiveKind::Position { .. } => None,
        ObjectiveKind::Vector { vectors, .. } | ObjectiveKind::DexPilot { vectors, .. } => {
            let of_wrist = vectors.iter().find(|vector| vector.landmarks[0] == 0)?;
            problem.model.link(&of_wrist.links[0])
        }
    }
}

impl Problem {
    /// Returns the pose of the root link with its axes along the wrist's and the link that stands for the wrist in it;
    /// the root link itself where none does.
    fn palm_at(
        &self,
        frame_from_wrist: &Isometry3<f64>,
        wrist: Option<usize>,
        q: &[f64],
    ) -> Pose<Object, Palm> {
        let poses = self.model.link_poses::<Palm>(|joint| q[joint]);
        let offset = wrist.map_or(Vector3::zeros(), |link| poses[link].translation.vector);
        let mut frame_from_palm = *frame_from_wrist;
        frame_from_palm.translation.vector -= frame_from_wrist.rotation * offset;
        Pose::new(frame_from_palm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const URDF: &str = include_str!("../../../../data/robots/allegro_right.urdf");
    const VECTOR: &str = "
retargeting:
  type: vector
  urdf_path: allegro_right.urdf
  target_origin_link_names: [ base_link, base_link ]
  target_task_link_names: [ link_15.0_tip, link_3.0_tip ]
  target_link_human_indices: [ [ 0, 0 ], [ 4, 8 ] ]
  scaling_factor: 1.6
  low_pass_alpha: 1
";

    /// A hand that is turned and carried along while it closes.
    fn steps(by: &Isometry3<f64>) -> Vec<LandmarkStep> {
        let step = |idx: u32| {
            let bend = 0.002 * f64::from(idx);
            let keypoints_m = std::array::from_fn(|landmark| {
                let (finger, joint) = (landmark.saturating_sub(1) / 4, landmark % 4);
                let at = match landmark {
                    0 => Point3::origin(),
                    _ => Point3::new(
                        bend * joint as f64,
                        0.05 - 0.02 * finger as f64,
                        0.08 + 0.02 * joint as f64,
                    ),
                };
                (by * at).coords.into()
            });
            LandmarkStep {
                time_s: 0.1 * f64::from(idx),
                keypoints_m,
            }
        };
        (0..10).map(step).collect()
    }

    #[test]
    fn a_hand_along_the_wrist_is_carried_with_it() {
        let problem = Problem::new(&VECTOR.parse().unwrap(), URDF).unwrap();
        let by = Isometry3::new(Vector3::new(0.1, -0.2, 0.3), Vector3::new(0.5, 1.0, -0.7));
        let along = Showing::AlongTheWrist(Side::Right);
        let still = retarget(&problem, &steps(&Isometry3::identity()), along);
        let carried = retarget(&problem, &steps(&by), along);
        let (still, carried) = (still.unwrap().unwrap(), carried.unwrap().unwrap());
        for (one, other) in still.motion.steps().iter().zip(carried.motion.steps()) {
            for (one, other) in one.q_rad.iter().zip(&other.q_rad) {
                assert!((one - other).abs() < 1e-6);
            }
            let difference = (by * *one.frame_from_palm).inverse() * *other.frame_from_palm;
            assert!(difference.translation.vector.norm() < 1e-9);
            assert!(difference.rotation.angle() < 1e-6);
        }
    }

    #[test]
    fn a_hand_without_axes_is_refused() {
        let problem = Problem::new(&VECTOR.parse().unwrap(), URDF).unwrap();
        let mut steps = steps(&Isometry3::identity());
        steps[3].keypoints_m = [[0.0; 3]; LANDMARKS];
        let found = retarget(&problem, &steps, Showing::AlongTheWrist(Side::Right));
        assert!(matches!(found, Err(ProblemError::NoWrist { step: 3 })));
        let found = retarget(&problem, &[], Showing::AsTheyAre).unwrap();
        assert_eq!(found, None);
    }
}
