//! Start poses of motions: those of demonstrations, carried to the object's place.

use std::sync::Arc;

use motion::{HandState, Motion, MotionError};
use nalgebra::{UnitQuaternion, Vector3};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use schemas::trajectories::{Trajectory, TrajectoryRates};
use spatial::{Object, Pose, Table};

use crate::ApproachError;

/// Turns about the vertical that are tried.
const YAWS: u32 = 24;
/// Length that a turn of one radian counts as, in meters: a hand's width.
const M_PER_RAD: f64 = 0.1;

/// The first step of a retargeted demonstration, above the table.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// The demonstration's sequence.
    pub sequence: String,
    /// The hand about the place where the demonstrated object lay.
    pub hand_in_table: HandState<Table>,
}

impl Start {
    /// Returns the starts of trajectories, with the joints in the hand's order.
    ///
    /// # Errors
    ///
    /// Fails if there is no trajectory, or one is of another hand.
    pub fn of(trajectories: &[Trajectory], joints: &[String]) -> Result<Vec<Self>, ApproachError> {
        let start = |trajectory: &Trajectory| {
            let motion = reordered(trajectory, joints)?;
            let first = motion.first();
            Ok::<_, ApproachError>(Self {
                sequence: trajectory.sequence.clone(),
                hand_in_table: HandState {
                    frame_from_palm: trajectory.rest.table_from_object() * first.frame_from_palm,
                    q_rad: first.q_rad.clone(),
                },
            })
        };
        let starts: Vec<Self> = trajectories.iter().map(start).collect::<Result<_, _>>()?;
        if starts.is_empty() {
            return Err(ApproachError::NoStart);
        }
        Ok(starts)
    }

    /// Draws one of several starts, each as often.
    ///
    /// # Panics
    ///
    /// Panics if there is none.
    pub fn draw<'s>(starts: &'s [Self], rng: &mut ChaCha8Rng) -> &'s Self {
        &starts[rng.random_range(0..starts.len())]
    }

    /// Returns the mean of the joint positions at the grasp of trajectories, in the hand's order.
    ///
    /// # Errors
    ///
    /// Fails if there is no trajectory, or one is of another hand.
    pub fn mean_grasp(
        trajectories: &[Trajectory],
        joints: &[String],
    ) -> Result<Vec<f64>, ApproachError> {
        let grasps = grasps(trajectories, joints)?;
        let n = grasps.len() as f64;
        let mean = |joint: usize| grasps.iter().map(|q| q[joint]).sum::<f64>() / n;
        Ok((0..joints.len()).map(mean).collect())
    }

    /// Returns starts of a motion toward a hand, as high above the table and as far from the object's origin as the
    /// demonstration's. They differ in the side from which the hand comes; the one with the shortest way, of the palm
    /// and of its orientation, is first.
    pub fn carried(
        &self,
        table_from_object: &Pose<Table, Object>,
        toward: &HandState<Object>,
    ) -> Vec<HandState<Object>> {
        let object_from_table = table_from_object.inverse();
        let here = &self.hand_in_table.frame_from_palm;
        let turned = |yaw: u32| {
            let angle = std::f64::consts::TAU * f64::from(yaw) / f64::from(YAWS);
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
            let in_table: Pose<Table, spatial::Palm> =
                Pose::from_parts(turn * here.translation.vector, turn * here.rotation);
            object_from_table * in_table
        };
        let way = |from: &Pose<Object, spatial::Palm>| {
            let to = &toward.frame_from_palm;
            let along = (to.translation.vector - from.translation.vector).norm();
            along + M_PER_RAD * from.rotation.angle_to(&to.rotation)
        };
        let mut poses: Vec<Pose<Object, spatial::Palm>> = (0..YAWS).map(turned).collect();
        poses.sort_by(|a, b| way(a).total_cmp(&way(b)));
        let hand = |frame_from_palm| HandState {
            frame_from_palm,
            q_rad: self.hand_in_table.q_rad.clone(),
        };
        poses.into_iter().map(hand).collect()
    }
}

/// Returns the joint positions at the grasp of each trajectory, in the hand's order.
///
/// # Errors
///
/// Fails if there is no trajectory, or one is of another hand.
pub fn grasps(
    trajectories: &[Trajectory],
    joints: &[String],
) -> Result<Vec<Vec<f64>>, ApproachError> {
    if trajectories.is_empty() {
        return Err(ApproachError::NoStart);
    }
    let grasp = |trajectory: &Trajectory| Ok(reordered(trajectory, joints)?.grasp().q_rad.clone());
    trajectories.iter().map(grasp).collect()
}

/// Returns the hands at the grasp of trajectories, above the table, with the joints in the hand's order.
///
/// # Errors
///
/// Fails if a trajectory is of another hand.
pub fn grasping_hands(
    trajectories: &[Trajectory],
    joints: &[String],
) -> Result<Vec<HandState<Table>>, ApproachError> {
    let hand = |trajectory: &Trajectory| {
        let motion = reordered(trajectory, joints)?;
        let grasp = motion.grasp();
        Ok(HandState {
            frame_from_palm: trajectory.rest.table_from_object() * grasp.frame_from_palm,
            q_rad: grasp.q_rad.clone(),
        })
    };
    trajectories.iter().map(hand).collect()
}

/// Returns a trajectory's motion with the joints in the hand's order.
fn reordered(
    trajectory: &Trajectory,
    joints: &[String],
) -> Result<Motion<Object, TrajectoryRates>, ApproachError> {
    trajectory
        .motion
        .reordered(joints)
        .map_err(|err| match err {
            MotionError::Joints(source) => ApproachError::AnotherHand {
                sequence: trajectory.sequence.clone(),
                source,
            },
            other => ApproachError::Motion(other),
        })
}

/// Returns the names of the joints of trajectories, all of one hand; `None` if there is no trajectory.
///
/// # Errors
///
/// Fails if two trajectories are of hands with different joints.
pub fn joints_of(trajectories: &[Trajectory]) -> Result<Option<Arc<[String]>>, ApproachError> {
    let Some(first) = trajectories.first() else {
        return Ok(None);
    };
    let joints = first.motion.joints();
    let mut all = trajectories.iter();
    match all.find(|other| other.motion.joints() != joints) {
        None => Ok(Some(Arc::clone(joints))),
        Some(other) => Err(ApproachError::DifferentHands {
            first: first.sequence.clone(),
            second: other.sequence.clone(),
        }),
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI};

    use motion::Step;
    use schemas::trajectories::Tracking;
    use spatial::RestingPose;

    use super::*;

    fn trajectory(joints: &[&str]) -> Trajectory {
        let step = |time_s: f64| Step {
            time_s,
            frame_from_palm: Pose::from_parts(
                [0.0, -0.3, 0.1 - time_s],
                UnitQuaternion::identity(),
            ),
            q_rad: (0..joints.len()).map(|joint| joint as f64).collect(),
            rates: TrajectoryRates::zero(joints.len()),
        };
        Trajectory {
            sequence: "a".to_owned(),
            object: "can".to_owned(),
            keypoints: Vec::new(),
            tips: Vec::new(),
            // It lies on its side: the object's x is up.
            rest: RestingPose {
                up_in_object: Vector3::x_axis(),
                height_m: 0.04,
            },
            motion: Motion::new(joints, vec![step(0.0), step(0.1)]).unwrap(),
            tracking: vec![Tracking::default(); 2],
        }
    }

    fn names(joints: &[&str]) -> Vec<String> {
        joints.iter().map(|&joint| joint.to_owned()).collect()
    }

    #[test]
    fn a_start_is_the_first_step_on_the_table_with_the_joints_of_the_hand() {
        let starts = Start::of(&[trajectory(&["a", "b"])], &names(&["b", "a"])).unwrap();
        let hand = &starts[0].hand_in_table;
        assert_eq!(hand.q_rad, [1.0, 0.0]);
        // The shortest turn of x to z takes z to -x and leaves y: (0, -0.3, 0.1) to (-0.1, -0.3, 0), 4 cm up.
        let place = hand.frame_from_palm.translation.vector;
        assert!(
            (place - Vector3::new(-0.1, -0.3, 0.04)).norm() < 1e-12,
            "{place}"
        );
        // The grasp is 0.1 m lower in the object's frame, which is 0.1 m along the table's x.
        let grasping = grasping_hands(&[trajectory(&["a", "b"])], &names(&["b", "a"])).unwrap();
        let place = grasping[0].frame_from_palm.translation.vector;
        assert!(
            (place - Vector3::new(0.0, -0.3, 0.04)).norm() < 1e-12,
            "{place}"
        );
        assert_eq!(grasping[0].q_rad, [1.0, 0.0]);
        let both = [trajectory(&["a", "b"]), trajectory(&["b", "a"])];
        let mean = Start::mean_grasp(&both, &names(&["a", "b"])).unwrap();
        assert_eq!(mean, [0.5, 0.5]);
        assert!(matches!(Start::of(&[], &[]), Err(ApproachError::NoStart)));
        let other = Start::of(&[trajectory(&["a", "b"])], &names(&["a", "c"]));
        assert!(
            matches!(other, Err(ApproachError::AnotherHand { .. })),
            "{other:?}"
        );
    }

    #[test]
    fn a_start_comes_from_the_side_of_the_grasp_at_its_own_height() {
        let start = Start {
            sequence: "a".to_owned(),
            hand_in_table: HandState {
                frame_from_palm: Pose::from_parts([-0.4, 0.0, 0.25], UnitQuaternion::identity()),
                q_rad: vec![0.5],
            },
        };
        let check = |yaw: f64| {
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
            let table_from_object = Pose::from_parts([0.0, 0.0, 0.1], UnitQuaternion::identity());
            let toward = HandState {
                frame_from_palm: Pose::from_parts(turn * Vector3::new(-0.1, 0.0, 0.0), turn),
                q_rad: vec![1.0],
            };
            let all = start.carried(&table_from_object, &toward);
            assert_eq!(all.len(), 24);
            let found = &all[0];
            let expected = turn * Vector3::new(-0.4, 0.0, 0.15);
            let place = found.frame_from_palm.translation.vector;
            assert!((place - expected).norm() < 1e-9, "{yaw}: {place}");
            assert!(found.frame_from_palm.rotation.angle_to(&turn) < 1e-7);
            assert_eq!(found.q_rad, [0.5]);
        };
        for yaw in [0.0, FRAC_PI_2, PI, -FRAC_PI_2] {
            check(yaw);
        }
    }
}
