//! Postures as landmarks come, one step at a time.

use posture::{Environment, Hand, KEYPOINTS, Posture};

use crate::{
    RetargetingConfig, RetargetingError, Tracking,
    follow::{Follower, StepSolution},
    goal::goal,
};

/// A step that is followed worse than the best one so far by this much, in meters, is searched afresh, and so much a
/// fresh search has to gain to be taken: after a landmark far off, the search may have stayed in a poor minimum.
const SUSPICIOUS_ERROR_M: f64 = 0.010;

/// Follows a person's hand while it moves: each posture starts from the one before and stays near it.
///
/// Nobody knows yet when the hand will grasp, so that it keeps its clearance from the object throughout, and
/// landmarks are not smoothed over time.
pub struct LiveRetargeting<'a> {
    hand: &'a Hand,
    environment: &'a Environment,
    config: &'a RetargetingConfig,
    follower: Follower<'a>,
    before: Option<StepSolution>,
    /// Least error of a step so far, in meters.
    least_error_m: f64,
}

/// The robot hand at one step.
#[derive(Debug, Clone, PartialEq)]
pub struct LivePosture {
    /// The palm in the frame of the landmarks, and the joints in the order of the model.
    pub posture: Posture,
    /// How well it follows.
    pub tracking: Tracking,
}

impl<'a> LiveRetargeting<'a> {
    /// Returns a follower that has seen nothing yet.
    ///
    /// # Errors
    ///
    /// Fails if the wrist is to be fixed and the hand's points do not say where it is
    /// ([`RetargetingConfig::check_wrist`]).
    pub fn new(
        hand: &'a Hand,
        environment: &'a Environment,
        config: &'a RetargetingConfig,
    ) -> Result<Self, RetargetingError> {
        config.check_wrist(hand)?;
        Ok(Self {
            hand,
            environment,
            config,
            follower: Follower::new(hand, environment, config),
            before: None,
            least_error_m: f64::INFINITY,
        })
    }

    /// Returns the posture for the landmarks of a step, in meters in the object's frame, finite: the wrist; thumb,
    /// index, middle, ring and little finger, four each from base to tip.
    ///
    /// # Errors
    ///
    /// Fails if a landmark is not finite.
    pub fn step(
        &mut self,
        keypoints_m: &[[f64; 3]; KEYPOINTS],
    ) -> Result<LivePosture, RetargetingError> {
        let goal = goal(
            self.hand,
            self.environment,
            self.config,
            keypoints_m,
            keypoints_m,
            f64::INFINITY,
        );
        let found = match &self.before {
            Some(before) => {
                let followed = self.follower.step(&goal, before)?;
                let error_m = followed.tracking.keypoint_error_m();
                if error_m <= self.least_error_m + SUSPICIOUS_ERROR_M {
                    followed
                } else {
                    let fresh = self.follower.first(&goal)?;
                    let is_worth_a_jump =
                        fresh.tracking.keypoint_error_m() < error_m - SUSPICIOUS_ERROR_M;
                    if is_worth_a_jump { fresh } else { followed }
                }
            }
            None => self.follower.first(&goal)?,
        };
        let error_m = found.tracking.keypoint_error_m();
        self.least_error_m = self.least_error_m.min(error_m);
        let (posture, tracking) = (found.posture.clone(), found.tracking.clone());
        self.before = Some(found);
        Ok(LivePosture { posture, tracking })
    }

    /// Forgets the steps so far: the next one is searched afresh.
    pub fn reset(&mut self) {
        self.before = None;
        self.least_error_m = f64::INFINITY;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{LandmarkStep, fixture, retarget};

    /// A hand that opens and closes slowly, shown with the robot's own points.
    fn shown(hand: &Hand) -> Vec<[[f64; 3]; KEYPOINTS]> {
        let bends = (0..30).map(|step| 0.5 + 0.3 * (0.1 * f64::from(step)).sin());
        let postures = bends.map(|bend| {
            let joints = hand.model.joints().iter();
            let q = joints.map(|joint| joint.lower + bend * (joint.upper - joint.lower));
            Posture::new(&spatial::Pose::identity(), q.collect())
        });
        postures
            .map(|posture| fixture::own_points(hand, &posture))
            .collect()
    }

    #[test]
    fn fingertips_of_a_hand_in_the_air_follow_to_a_millimeter() {
        let (hand, nothing) = (fixture::hand(), Environment::empty());
        let config = RetargetingConfig::default();
        let mut live = LiveRetargeting::new(&hand, &nothing, &config).unwrap();
        for keypoints in shown(&hand) {
            let tracking = live.step(&keypoints).unwrap().tracking;
            assert_eq!(tracking.tip_errors_m.len(), 4);
            assert!(
                tracking.tip_errors_m.iter().all(|error| *error < 1e-3),
                "{tracking:?}"
            );
            assert_eq!(tracking.table_penetration_m, 0.0);
        }
    }

    /// One image in millimeters instead of meters, as happens where two programs meet.
    #[test]
    fn a_step_far_off_does_not_spoil_those_after_it() {
        let (hand, nothing) = (fixture::hand(), Environment::empty());
        let config = RetargetingConfig::default();
        let mut live = LiveRetargeting::new(&hand, &nothing, &config).unwrap();
        let shown = shown(&hand);
        for keypoints in &shown {
            live.step(keypoints).unwrap();
        }
        let last = shown.last().unwrap();
        live.step(&last.map(|point| point.map(|x| 1000.0 * x)))
            .unwrap();
        let error_m = live.step(last).unwrap().tracking.keypoint_error_m();
        assert!(error_m < 0.01, "{error_m} m");
    }

    #[test]
    fn after_a_reset_the_same_step_has_the_same_posture() {
        let (hand, environment) = (fixture::hand(), fixture::environment());
        let config = fixture::config();
        let mut live = LiveRetargeting::new(&hand, &environment, &config).unwrap();
        let shown = shown(&hand);
        let first = live.step(&shown[0]).unwrap();
        live.step(&shown[9]).unwrap();
        live.reset();
        assert_eq!(live.step(&shown[0]).unwrap(), first);
    }

    #[test]
    fn one_step_is_searched_as_the_grasp_of_a_motion_of_one_step() {
        let (hand, nothing) = (fixture::hand(), Environment::empty());
        let config = RetargetingConfig {
            contact_weight: 0.0,
            ..RetargetingConfig::default()
        };
        let keypoints_m = shown(&hand)[0];
        let steps = [LandmarkStep {
            time_s: 0.0,
            keypoints_m,
        }];
        let whole = retarget(&hand, &nothing, &config, &steps).unwrap().unwrap();
        let mut live = LiveRetargeting::new(&hand, &nothing, &config).unwrap();
        let found = live.step(&keypoints_m).unwrap();
        assert_eq!(found.posture.q, whole.motion.steps()[0].q_rad);
    }

    #[test]
    fn a_landmark_that_is_no_number_is_refused_and_forgotten() {
        let (hand, nothing) = (fixture::hand(), Environment::empty());
        let config = RetargetingConfig::default();
        let mut live = LiveRetargeting::new(&hand, &nothing, &config).unwrap();
        let shown = shown(&hand);
        live.step(&shown[0]).unwrap();
        let mut broken = shown[1];
        broken[4][0] = f64::NAN;
        assert!(live.step(&broken).is_err());
        assert!(live.step(&shown[1]).is_ok());
    }
}
