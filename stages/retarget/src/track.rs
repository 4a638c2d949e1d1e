//! A whole demonstration, step by step, backward from the grasp.

use std::collections::BTreeMap;

use schemas::{
    demonstrations::Demonstration,
    trajectories::{self, Rates, Tracking},
};
use spatial::Pose;

use crate::{
    RetargetConfig,
    goal::{Goal, Previous, goal},
    hand::{Hand, Posture},
    objective::{Evaluation, Memory, Objective},
    scene::Scene,
    smoothing::smoothed,
    solver::minimize,
    start::{laid_on, starts},
};

/// Iterations at the grasp relative to other steps: it starts from nothing.
const GRASP_ITERATIONS: usize = 3;

/// A step whose mean error exceeds that of the grasp by this much, in meters, is searched afresh:
/// the search may have stayed behind in a poor minimum.
const SUSPICIOUS_ERROR_M: f64 = 0.010;

/// Share of the old cost that a fresh search must reach to replace what follows its neighbor.
const WORTH_A_JUMP: f64 = 0.7;

/// Steps, counted from the grasp, at which the approach is tried as another start for the grasp.
const APPROACH: [usize; 5] = [16, 11, 7, 4, 2];

/// What a demonstration became.
pub(crate) struct Tracked {
    /// The steps in time order, without their rates.
    pub(crate) steps: Vec<trajectories::Step>,
    /// Keypoint error at the grasp, in meters.
    pub(crate) grasp_keypoint_error_m: f64,
    /// Number of steps that were searched afresh and found a better minimum.
    pub(crate) restarts_n: usize,
}

impl Tracked {
    /// Returns the figures of the trajectory.
    pub(crate) fn metrics(&self) -> BTreeMap<String, f64> {
        let tracking = || self.steps.iter().map(|step| &step.tracking);
        let keypoint_errors: f64 = tracking().map(Tracking::keypoint_error_m).sum();
        let still = Tracking::default();
        let grasp = tracking().next_back().unwrap_or(&still);
        let gaps = grasp.contact_gaps_m.iter().map(|gap| gap.abs());
        let contacts_n = grasp.contact_gaps_m.len().max(1) as f64;
        [
            ("steps_n", self.steps.len() as f64),
            (
                "keypoint_error_m",
                keypoint_errors / self.steps.len().max(1) as f64,
            ),
            ("fingertip_error_m", grasp.fingertip_error_m()),
            ("penetration_m", grasp.penetration_m),
            (
                "table_penetration_m",
                tracking()
                    .map(|t| t.table_penetration_m)
                    .fold(0.0, f64::max),
            ),
            ("tip_gap_m", gaps.sum::<f64>() / contacts_n),
            ("restarts_n", self.restarts_n as f64),
        ]
        .map(|(name, value)| (name.to_owned(), value))
        .into()
    }
}

/// Retargets a demonstration; `None` if it has no step.
pub(crate) fn track(
    hand: &Hand,
    scene: &Scene,
    config: &RetargetConfig,
    demonstration: &Demonstration,
) -> Option<Tracked> {
    let end_s = demonstration.steps.last()?.time_s;
    let goals: Vec<Goal> = demonstration
        .steps
        .iter()
        .zip(smoothed(&demonstration.steps, config.smoothing_s))
        .map(|(step, keypoints_m)| goal(hand, scene, config, &keypoints_m, end_s - step.time_s))
        .collect();
    let tracker = Tracker {
        hand,
        scene,
        config,
        mid_range: hand.model.mid_range(),
    };
    let mut memory = Memory::default();
    let grasp = tracker.grasp(&goals, &mut memory)?;
    let grasp_error_m = errors(hand, &grasp, goals.last()?).0;

    let mut restarts_n = 0;
    let mut solved: Vec<Evaluation> = vec![grasp.clone()];
    for goal in goals.iter().rev().skip(1) {
        let after = solved.last().unwrap_or(&grasp);
        let mut goal = goal.clone();
        goal.previous = Some(previous(after));
        let mut best = tracker.step(&goal, &after.posture, config.max_iterations, &mut memory);
        if errors(hand, &best, &goal).0 > grasp_error_m + SUSPICIOUS_ERROR_M {
            let fresh = tracker.afresh(&goal, &mut memory);
            if let Some(fresh) = fresh.filter(|fresh| fresh.cost < WORTH_A_JUMP * best.cost) {
                best = fresh;
                restarts_n += 1;
            }
        }
        solved.push(best);
    }
    solved.reverse();
    let steps = demonstration.steps.iter().zip(&goals).zip(&solved);
    Some(Tracked {
        steps: steps
            .map(|((shown, goal), solved)| trajectories::Step {
                time_s: shown.time_s,
                object_from_palm: Pose::new(solved.posture.object_from_palm),
                q_rad: solved.posture.q.clone(),
                rates: Rates::still(solved.posture.q.len()),
                tracking: tracking(hand, scene, goal, solved),
            })
            .collect(),
        grasp_keypoint_error_m: grasp_error_m,
        restarts_n,
    })
}

/// What does not change from step to step.
struct Tracker<'a> {
    hand: &'a Hand,
    scene: &'a Scene,
    config: &'a RetargetConfig,
    mid_range: Vec<f64>,
}

impl Tracker<'_> {
    /// Searches one step from a posture.
    fn step(
        &self,
        goal: &Goal,
        start: &Posture,
        iterations: usize,
        memory: &mut Memory,
    ) -> Evaluation {
        let objective = Objective {
            hand: self.hand,
            scene: Some(self.scene),
            config: self.config,
            goal,
            mid_range: &self.mid_range,
        };
        minimize(&objective, start, iterations, memory)
    }

    /// Searches one step without knowledge of its neighbors: first as if the object and the table
    /// were not there, then with them, from several starts.
    fn afresh(&self, goal: &Goal, memory: &mut Memory) -> Option<Evaluation> {
        let iterations = GRASP_ITERATIONS * self.config.max_iterations;
        let free = Objective {
            hand: self.hand,
            scene: None,
            config: self.config,
            goal,
            mid_range: &self.mid_range,
        };
        starts(self.hand, goal)
            .iter()
            .map(|start| {
                let followed = minimize(&free, start, self.config.max_iterations, memory);
                self.step(goal, &followed.posture, iterations, memory)
            })
            .reduce(cheaper)
    }

    /// Searches the grasp, the last step: afresh, and along the approach, where the fingers come
    /// from outside and so end on the right side of thin things.
    fn grasp(&self, goals: &[Goal], memory: &mut Memory) -> Option<Evaluation> {
        let (goal, before) = goals.split_last()?;
        let afresh = self.afresh(goal, memory)?;
        let mut along: Option<Posture> = None;
        for back in APPROACH {
            let Some(goal) = before
                .len()
                .checked_sub(back)
                .and_then(|idx| before.get(idx))
            else {
                continue;
            };
            let start = match along {
                Some(posture) => laid_on(self.hand, posture.q, goal),
                None => laid_on(self.hand, self.mid_range.clone(), goal),
            };
            along = Some(
                self.step(goal, &start, self.config.max_iterations, memory)
                    .posture,
            );
        }
        Some(match along {
            Some(start) => {
                let iterations = GRASP_ITERATIONS * self.config.max_iterations;
                cheaper(afresh, self.step(goal, &start, iterations, memory))
            }
            None => afresh,
        })
    }
}

/// Returns the one of lower cost, the first if they are equal.
fn cheaper(a: Evaluation, b: Evaluation) -> Evaluation {
    if b.cost < a.cost { b } else { a }
}

/// Returns what the next step is to stay near.
fn previous(solved: &Evaluation) -> Previous {
    Previous {
        points: solved.points.clone(),
        q: solved.posture.q.clone(),
    }
}

/// Returns the root mean square distance of the points to their landmarks, and the largest distance
/// of a finger tip to its own, in meters.
fn errors(hand: &Hand, solved: &Evaluation, goal: &Goal) -> (f64, f64) {
    let (mut sum, mut worst_tip) = (0.0, 0.0_f64);
    for ((point, goal), found) in hand.points.iter().zip(&goal.points).zip(&solved.points) {
        let distance = (found - goal.landmark).norm();
        sum += distance * distance;
        if point.tip_radius_m.is_some() {
            worst_tip = worst_tip.max(distance);
        }
    }
    ((sum / hand.points.len() as f64).sqrt(), worst_tip)
}

/// Returns how well a step follows, and what it keeps from.
fn tracking(hand: &Hand, scene: &Scene, goal: &Goal, solved: &Evaluation) -> Tracking {
    let mut tracking = Tracking {
        limit_margin_rad: hand.limit_margin(&solved.posture.q),
        penetration_m: solved.object_depth_m(scene, hand),
        table_penetration_m: solved.table_depth_m(scene, hand),
        ..Tracking::default()
    };
    for ((point, goal), found) in hand.points.iter().zip(&goal.points).zip(&solved.points) {
        let distance = (found - goal.landmark).norm();
        tracking.keypoint_errors_m.push(distance);
        if let Some(radius_m) = point.tip_radius_m {
            tracking.tip_errors_m.push(distance);
            if goal.contact.is_some() {
                tracking
                    .contact_gaps_m
                    .push(scene.gap(found).distance_m - radius_m);
            }
        }
    }
    tracking
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Vector3};
    use proptest::prelude::*;
    use schemas::demonstrations::{KEYPOINTS, Side, Step};

    use super::*;
    use crate::fixture;

    /// A posture and what a person's landmarks would be if the person had the robot's hand.
    fn own_points(hand: &Hand, posture: &Posture) -> [[f64; 3]; KEYPOINTS] {
        let links = hand.object_from_links(posture);
        let mut keypoints = [[0.0; 3]; KEYPOINTS];
        for point in &hand.points {
            keypoints[point.keypoint] = (links[point.link] * point.point_in_link).into();
        }
        keypoints
    }

    fn demonstration(keypoints: Vec<[[f64; 3]; KEYPOINTS]>) -> Demonstration {
        Demonstration {
            sequence: "s".to_owned(),
            object: "box".to_owned(),
            subject: "p".to_owned(),
            hand: Side::Right,
            mirrored: false,
            start_reason: String::new(),
            end_reason: String::new(),
            rest: fixture::rest(),
            steps: keypoints
                .into_iter()
                .zip(0_u32..)
                .map(|(keypoints_m, image)| Step {
                    image,
                    time_s: f64::from(image) / 30.0,
                    cameras_n: 1,
                    bridged: false,
                    keypoints_m,
                })
                .collect(),
        }
    }

    fn run(config: &RetargetConfig, keypoints: Vec<[[f64; 3]; KEYPOINTS]>) -> (Hand, Tracked) {
        let hand = fixture::hand();
        let tracked = track(&hand, &fixture::scene(), config, &demonstration(keypoints)).unwrap();
        (hand, tracked)
    }

    /// Returns a posture with its palm turned to the box from the side, `bend` between the limits.
    fn reaching(config: &RetargetConfig, x: f64, bend: f64) -> Posture {
        let hand = fixture::hand();
        let between = |(lower, upper): (&f64, &f64)| lower + bend * (upper - lower);
        Posture {
            object_from_palm: Isometry3::new(
                Vector3::new(x, 0.0, 0.05),
                Vector3::new(0.1, 0.2, 0.0),
            ),
            q: hand.lower.iter().zip(&hand.upper).map(between).collect(),
        }
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
            let mut posture = reaching(&config, -0.3, 0.5);
            for ((q, share), (lower, upper)) in posture.q.iter_mut().zip(q).zip(hand.lower.iter().zip(&hand.upper)) {
                *q = lower + share * (upper - lower);
            }
            posture.object_from_palm *= nalgebra::UnitQuaternion::new(Vector3::from(turn));
            let (_, tracked) = run(&config, vec![own_points(&hand, &posture)]);
            prop_assert!(tracked.grasp_keypoint_error_m < 1e-3, "{} m", tracked.grasp_keypoint_error_m);
        }

        /// Whatever is shown, no joint leaves its limits.
        #[test]
        fn limits_hold(points in prop::collection::vec(prop::array::uniform3(-0.2..0.2), KEYPOINTS)) {
            let config = RetargetConfig { max_keypoint_error_m: 1.0, ..fixture::config() };
            let mut keypoints = [[0.0; 3]; KEYPOINTS];
            keypoints.copy_from_slice(&points);
            let mut later = keypoints;
            later.reverse();
            let (hand, tracked) = run(&config, vec![keypoints, later]);
            for step in &tracked.steps {
                for (q, (lower, upper)) in step.q_rad.iter().zip(hand.lower.iter().zip(&hand.upper)) {
                    prop_assert!((lower..=upper).contains(&q), "{q} outside {lower} to {upper}");
                }
            }
        }
    }

    #[test]
    fn links_are_pushed_out_of_the_object() {
        let shown = |config: &RetargetConfig| {
            let hand = fixture::hand();
            // The palm is shown inside the box.
            run(
                config,
                vec![own_points(&hand, &reaching(config, -0.02, 0.3))],
            )
            .1
            .steps[0]
                .tracking
                .penetration_m
        };
        let without = shown(&fixture::following_only());
        let with = shown(&RetargetConfig {
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
        let shown = |config: &RetargetConfig| {
            let hand = fixture::hand();
            let mut posture = reaching(config, -0.3, 0.3);
            posture.object_from_palm.translation.z = -0.06;
            run(config, vec![own_points(&hand, &posture)]).1.steps[0]
                .tracking
                .table_penetration_m
        };
        let without = shown(&fixture::following_only());
        let with = shown(&RetargetConfig {
            table_weight: 3.0,
            ..fixture::following_only()
        });
        assert!(without > 0.05 && with < 0.01, "{without} m, then {with} m");
    }

    #[test]
    fn clearance_is_kept_until_the_hand_closes() {
        let config = RetargetConfig {
            contact_weight: 0.0,
            ..fixture::config()
        };
        let hand = fixture::hand();
        // The palm rests against a side of the box.
        let grasp = own_points(&hand, &reaching(&config, -0.042, 0.2));
        let (hand, tracked) = run(&config, vec![grasp; 31]);
        let scene = fixture::scene();
        let gap = |step: &trajectories::Step| {
            let posture = Posture {
                object_from_palm: *step.object_from_palm.isometry(),
                q: step.q_rad.clone(),
            };
            let links = hand.object_from_links(&posture);
            hand.balls
                .iter()
                .map(|ball| {
                    scene
                        .gap(&(links[ball.link] * ball.center_in_link))
                        .distance_m
                        - ball.radius_m
                })
                .fold(f64::MAX, f64::min)
        };
        assert!(
            gap(&tracked.steps[10]) > 0.004,
            "{} m",
            gap(&tracked.steps[10])
        );
        assert!(
            gap(&tracked.steps[30]) < 0.003,
            "{} m",
            gap(&tracked.steps[30])
        );
    }

    #[test]
    fn tips_near_the_surface_touch_it() {
        let config = fixture::config();
        let hand = fixture::hand();
        let mut keypoints = own_points(&hand, &reaching(&config, -0.07, 0.5));
        let [x, y, _] = fixture::BOX_HALF_M;
        // Finger tips 5 mm off the far side, the thumb's off a near one.
        for (finger, keypoint) in [8, 12, 16].into_iter().enumerate() {
            keypoints[keypoint] = [x + 0.005, 0.03 - 0.03 * finger as f64, 0.02];
        }
        keypoints[4] = [-0.01, y + 0.005, 0.0];
        let (_, tracked) = run(&config, vec![keypoints]);
        let gaps = &tracked.steps[0].tracking.contact_gaps_m;
        assert_eq!(gaps.len(), 4);
        let gap = gaps.iter().map(|gap| gap.abs()).sum::<f64>() / 4.0;
        assert!(gap < 0.004, "{gaps:?} m");
    }
}
