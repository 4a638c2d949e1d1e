//! A whole motion, step by step, backward from the grasp.

use motion::{Motion, Step};
use posture::{Environment, Hand, Posture};
use spatial::Object;

use crate::{
    LandmarkStep, RetargetingConfig, RetargetingError, Tracking,
    follow::{Follower, StepSolution},
    goal::{Goal, goal},
    smoothing::smoothed,
};

/// A step whose mean error exceeds that of the grasp by this much, in meters, is searched afresh:
/// the search may have stayed behind in a poor minimum.
const SUSPICIOUS_ERROR_M: f64 = 0.010;

/// Share of the old cost that a fresh search must reach to replace what follows its neighbor.
const WORTH_A_JUMP: f64 = 0.7;

/// A motion of a person, retargeted to a robot hand.
#[derive(Debug, Clone, PartialEq)]
pub struct Retargeted {
    /// The hand in the object's frame, with the hand's joints, at the times of the landmarks.
    pub motion: Motion<Object>,
    /// Its tracking of the landmarks at each step.
    pub tracking: Vec<Tracking>,
    /// Root mean square distance to the followed landmarks at the grasp, in meters.
    pub grasp_keypoint_error_m: f64,
    /// Number of steps that were searched afresh and found a better minimum.
    pub restarts_n: usize,
    /// Postures that were tried on the way from step to step, by the searches that lead to the answer
    /// and those made afresh.
    pub iterations_n: usize,
}

/// Retargets the landmarks of a person's hand, of which the last step is the grasp; `None` of no step.
///
/// # Errors
///
/// Fails if the wrist is to be fixed and the hand's points do not say where it is
/// ([`RetargetingConfig::check_wrist`]), or the times do not increase.
pub fn retarget(
    hand: &Hand,
    environment: &Environment,
    config: &RetargetingConfig,
    steps: &[LandmarkStep],
) -> Result<Option<Retargeted>, RetargetingError> {
    config.check_wrist(hand)?;
    let goals = goals(hand, environment, config, steps);
    let mut follower = Follower::new(hand, environment, config);
    let Some(grasp) = follower.grasp(&goals)? else {
        return Ok(None);
    };
    let grasp_error_m = grasp.tracking.keypoint_error_m();
    let (mut restarts_n, mut iterations_n) = (0, grasp.iterations);
    let mut solved: Vec<StepSolution> = vec![grasp];
    for goal in goals.iter().rev().skip(1) {
        let Some(after) = solved.last() else { break };
        let mut best = follower.step(goal, after)?;
        iterations_n += best.iterations;
        if best.tracking.keypoint_error_m() > grasp_error_m + SUSPICIOUS_ERROR_M
            && let Some(fresh) = follower.afresh(goal, Some(after))?
        {
            iterations_n += fresh.iterations;
            if fresh.cost < WORTH_A_JUMP * best.cost {
                best = fresh;
                restarts_n += 1;
            }
        }
        solved.push(best);
    }
    solved.reverse();
    let (mut moved, mut tracking) = (Vec::new(), Vec::new());
    for (shown, solved) in steps.iter().zip(solved) {
        moved.push(Step {
            time_s: shown.time_s,
            frame_from_palm: solved.posture.root.pose(),
            q_rad: solved.posture.q,
            rates: (),
        });
        tracking.push(solved.tracking);
    }
    Ok(Some(Retargeted {
        motion: Motion::new(&hand.model.joint_names(), moved)?.differentiated()?,
        tracking,
        grasp_keypoint_error_m: grasp_error_m,
        restarts_n,
        iterations_n,
    }))
}

/// Measures how well a motion, whoever made it, follows the landmarks at the same times.
///
/// # Errors
///
/// Fails if the motion has other joints than the hand.
pub fn tracking(
    hand: &Hand,
    environment: &Environment,
    config: &RetargetingConfig,
    steps: &[LandmarkStep],
    motion: &Motion<Object>,
) -> Result<Vec<Tracking>, RetargetingError> {
    let goals = goals(hand, environment, config, steps);
    let mut follower = Follower::new(hand, environment, config);
    let steps = motion.steps().iter().zip(&goals);
    steps
        .map(|(step, goal)| {
            let posture = Posture::new(&step.frame_from_palm, step.q_rad.clone());
            follower.measured(goal, &posture)
        })
        .collect()
}

/// Returns the goal of each step, the grasp's last.
fn goals(
    hand: &Hand,
    environment: &Environment,
    config: &RetargetingConfig,
    steps: &[LandmarkStep],
) -> Vec<Goal> {
    let Some(end) = steps.last() else {
        return Vec::new();
    };
    steps
        .iter()
        .zip(smoothed(steps, config.smoothing_s))
        .map(|(step, keypoints_m)| {
            let to_grasp_s = end.time_s - step.time_s;
            goal(
                hand,
                environment,
                config,
                &step.keypoints_m,
                &keypoints_m,
                to_grasp_s,
            )
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, UnitQuaternion, Vector3};
    use posture::{KEYPOINTS, RootPose};
    use proptest::prelude::*;
    use spatial::{Palm, Pose};

    use super::*;
    use crate::{Wrist, fixture};

    fn run(
        config: &RetargetingConfig,
        keypoints: Vec<[[f64; 3]; KEYPOINTS]>,
    ) -> (Hand, Retargeted) {
        let hand = fixture::hand();
        let steps = fixture::steps(keypoints);
        let retargeted = retarget(&hand, &fixture::environment(), config, &steps);
        (hand, retargeted.unwrap().unwrap())
    }

    /// Returns a posture with its palm turned to the box from the side, `bend` between the limits.
    fn reaching(x: f64, bend: f64) -> Posture {
        let hand = fixture::hand();
        let joints = hand.model.joints().iter();
        let q = joints.map(|joint| joint.lower + bend * (joint.upper - joint.lower));
        Posture::new(
            &Pose::new(Isometry3::new(
                Vector3::new(x, 0.0, 0.05),
                Vector3::new(0.1, 0.2, 0.0),
            )),
            q.collect(),
        )
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        /// A robot that is shown its own points takes its own posture, to 1 mm.
        #[test]
        fn own_posture_is_recovered(
            q in prop::collection::vec(0.15..0.85, 16),
            turn in prop::array::uniform3(-2.0..2.0),
        ) {
            let config = fixture::following_only();
            let hand = fixture::hand();
            let mut posture = reaching(-0.3, 0.5);
            for ((q, share), joint) in posture.q.iter_mut().zip(q).zip(hand.model.joints()) {
                *q = joint.lower + share * (joint.upper - joint.lower);
            }
            let turned = *posture.root.pose() * UnitQuaternion::new(Vector3::from(turn));
            posture.root = RootPose::from_pose(&Pose::new(turned));
            let (_, tracked) = run(&config, vec![fixture::own_points(&hand, &posture)]);
            prop_assert!(tracked.grasp_keypoint_error_m < 1e-3, "{} m", tracked.grasp_keypoint_error_m);
        }

        /// Whatever is shown, no joint leaves its limits.
        #[test]
        fn limits_hold(points in prop::collection::vec(prop::array::uniform3(-0.2..0.2), KEYPOINTS)) {
            let config = fixture::config();
            let mut keypoints = [[0.0; 3]; KEYPOINTS];
            keypoints.copy_from_slice(&points);
            let mut later = keypoints;
            later.reverse();
            let (hand, tracked) = run(&config, vec![keypoints, later]);
            for step in tracked.motion.steps() {
                for (q, joint) in step.q_rad.iter().zip(hand.model.joints()) {
                    prop_assert!((joint.lower..=joint.upper).contains(q), "{q} outside {joint:?}");
                }
            }
        }
    }

    #[test]
    fn links_are_pushed_out_of_the_object() {
        let shown = |config: &RetargetingConfig| {
            let hand = fixture::hand();
            // The palm is shown inside the box.
            run(
                config,
                vec![fixture::own_points(&hand, &reaching(-0.02, 0.3))],
            )
            .1
            .tracking[0]
                .penetration_m
        };
        let without = shown(&fixture::following_only());
        let with = shown(&RetargetingConfig {
            contact_weight: 0.0,
            ..fixture::config()
        });
        assert!(
            without > 0.015 && with < 0.006,
            "{without} m, then {with} m"
        );
    }

    #[test]
    fn links_are_lifted_off_the_table() {
        let shown = |config: &RetargetingConfig| {
            let hand = fixture::hand();
            let mut pose = *reaching(-0.3, 0.3).root.pose();
            pose.translation.z = -0.06;
            let posture = Posture::new(&Pose::new(pose), reaching(-0.3, 0.3).q);
            run(config, vec![fixture::own_points(&hand, &posture)])
                .1
                .tracking[0]
                .table_penetration_m
        };
        let without = shown(&fixture::following_only());
        let with = shown(&RetargetingConfig {
            table_weight: 3.0,
            ..fixture::following_only()
        });
        assert!(without > 0.05 && with < 0.01, "{without} m, then {with} m");
    }

    #[test]
    fn clearance_is_kept_until_the_hand_closes() {
        let config = RetargetingConfig {
            contact_weight: 0.0,
            ..fixture::config()
        };
        let hand = fixture::hand();
        // The palm rests against a side of the box.
        let grasp = fixture::own_points(&hand, &reaching(-0.042, 0.2));
        let (hand, tracked) = run(&config, vec![grasp; 31]);
        let environment = fixture::environment();
        let gap = |idx: usize| {
            let step: &Step<Object> = &tracked.motion.steps()[idx];
            let links = hand.model.forward_kinematics::<Palm>(&step.q_rad).unwrap();
            let object_from_palm = step.frame_from_palm;
            let spheres = hand
                .model
                .links()
                .iter()
                .zip(links)
                .flat_map(|(link, pose)| {
                    let spheres = link.collisions.iter().flat_map(robot::spheres::fill);
                    spheres.map(move |sphere| (pose * sphere.center_in_link, sphere.radius_m))
                });
            spheres
                .map(|(center, radius)| {
                    environment
                        .signed_distance(&(object_from_palm * center))
                        .distance_m
                        - radius
                })
                .fold(f64::MAX, f64::min)
        };
        assert!(gap(10) > 0.004, "{} m", gap(10));
        assert!(gap(30) < 0.003, "{} m", gap(30));
    }

    #[test]
    fn tips_near_the_surface_touch_it() {
        let config = fixture::config();
        let hand = fixture::hand();
        let mut keypoints = fixture::own_points(&hand, &reaching(-0.07, 0.5));
        let [x, y, _] = fixture::BOX_HALF_M;
        // Fingertips 5 mm off the far side, the thumb's off a near one.
        for (finger, keypoint) in [8, 12, 16].into_iter().enumerate() {
            keypoints[keypoint] = [x + 0.005, 0.03 - 0.03 * finger as f64, 0.02];
        }
        keypoints[4] = [-0.01, y + 0.005, 0.0];
        let (_, tracked) = run(&config, vec![keypoints]);
        let gaps = &tracked.tracking[0].contact_gaps_m;
        assert_eq!(gaps.len(), 4);
        let gap = gaps.iter().map(|gap| gap.abs()).sum::<f64>() / 4.0;
        assert!(gap < 0.004, "{gaps:?} m");
    }

    #[test]
    fn a_fixed_wrist_follows_the_palm_alone() {
        let hand = fixture::hand();
        let posture = reaching(-0.3, 0.4);
        let mut keypoints = fixture::own_points(&hand, &posture);
        // Fingers that no posture reaches must not draw the palm along.
        for keypoint in [4, 8, 12, 16] {
            keypoints[keypoint][0] += 0.1;
        }
        let config = RetargetingConfig {
            wrist: Wrist::Fixed,
            ..fixture::following_only()
        };
        let off = |config: &RetargetingConfig| {
            let (_, tracked) = run(config, vec![keypoints; 2]);
            let steps = tracked.motion.steps().iter();
            let poses = steps.map(|step| step.frame_from_palm);
            poses
                .map(|pose| {
                    (pose.inverse() * posture.root.pose())
                        .translation
                        .vector
                        .norm()
                })
                .fold(0.0, f64::max)
        };
        assert!(off(&config) < 1e-9, "{} m", off(&config));
        assert!(off(&fixture::following_only()) > 0.01);
    }

    #[test]
    fn linear_loss_is_robust_to_outliers() {
        let hand = fixture::hand();
        let mut keypoints = fixture::own_points(&hand, &reaching(-0.3, 0.4));
        keypoints[4][2] += 0.15;
        let error = |loss| {
            let config = RetargetingConfig {
                loss,
                ..fixture::following_only()
            };
            let (_, tracked) = run(&config, vec![keypoints]);
            // Of the fingertips but the one that is shown elsewhere.
            tracked.tracking[0].tip_errors_m[1..].iter().sum::<f64>() / 3.0
        };
        let (squared, linear) = (error(crate::Loss::Squared), error(crate::Loss::SmoothL1));
        assert!(linear < 0.8 * squared, "{linear} m, {squared} m");
    }
}
