use super::*;
use crate::Config;

const URDF: &str = include_str!("../../../../../data/robots/allegro_right.urdf");

const POSITION: &str = "
retargeting:
  type: position
  urdf_path: allegro_right.urdf
  target_link_names: [ link_15.0_tip, link_3.0_tip, link_7.0_tip, link_11.0_tip ]
  target_link_human_indices: [ 4, 8, 12, 16 ]
  add_dummy_free_joint: True
  low_pass_alpha: 1
";
const VECTOR: &str = "
retargeting:
  type: vector
  urdf_path: allegro_right.urdf
  target_origin_link_names: [ base_link, base_link, link_15.0_tip ]
  target_task_link_names: [ link_15.0_tip, link_3.0_tip, link_3.0_tip ]
  target_link_human_indices: [ [ 0, 0, 4 ], [ 4, 8, 8 ] ]
  scaling_factor: 1.6
  low_pass_alpha: 1
";
const DEXPILOT: &str = "
retargeting:
  type: DexPilot
  urdf_path: allegro_right.urdf
  wrist_link_name: base_link
  finger_tip_link_names: [ link_15.0_tip, link_3.0_tip, link_7.0_tip, link_11.0_tip ]
  scaling_factor: 1.6
  low_pass_alpha: 1
";

/// A hand that closes and opens its thumb and fingers.
fn frames() -> impl Iterator<Item = [[f64; 3]; LANDMARKS]> {
    (0..40).map(|frame| {
        let bend = 0.5 - 0.5 * (0.15 * f64::from(frame)).cos();
        std::array::from_fn(|landmark| {
            if landmark == 0 {
                return [0.0; 3];
            }
            let (finger, joint) = ((landmark - 1) / 4, (landmark - 1) % 4);
            let along = 0.03 * (joint + 1) as f64;
            if finger == 0 {
                return [0.02 + 0.03 * bend, 0.06 - 0.03 * bend, along];
            }
            let across = 0.05 - 0.02 * finger as f64;
            let ahead = 0.06 * bend * joint as f64 / 3.0;
            [ahead, across, along * (1.2 - 0.4 * bend)]
        })
    })
}

fn problem(text: &str) -> Problem {
    Problem::new(&text.parse::<Config>().unwrap(), URDF).unwrap()
}

impl Follower<'_> {
    /// Returns the objective of the last frame at full convergence from its answer.
    fn converged(&mut self) -> f64 {
        // The frame before: answers take turns.
        let near = Near::Before(&self.answer);
        let task = self.aim.task(&self.problem.objective, near);
        let options = SearchOptions {
            relative_tolerance: 1e-12,
            min_decrease: 1e-18,
            max_iterations: 500,
            root_motion: RootMotion::Free,
        };
        let mut posture = self.before.clone();
        let found = self
            .solver
            .minimize(&task, &mut posture, &options, &mut NoTerms);
        found.unwrap().cost
    }
}

#[test]
fn searches_end_at_minima_within_limits() {
    for text in [POSITION, VECTOR, DEXPILOT] {
        let problem = problem(text);
        let mut live = Follower::new(&problem);
        for landmarks in frames() {
            let answer = live.step(&landmarks).unwrap();
            for (q, &(lower, upper)) in answer.posture.q.iter().zip(problem.limits()) {
                assert!((lower..=upper).contains(q));
            }
            let found = answer.objective_m;
            let least = live.converged();
            assert!(found <= 1.01 * least + 1e-6, "{found} {least}");
        }
    }
}

#[test]
fn the_filter_goes_a_share_of_the_way() {
    let plain = problem(POSITION);
    let filtered = problem(&POSITION.replace("alpha: 1", "alpha: 0.25"));
    let (mut plain, mut filtered) = (Follower::new(&plain), Follower::new(&filtered));
    let mut expected: Option<Vec<f64>> = None;
    for landmarks in frames().take(5) {
        let answer = plain.step(&landmarks).unwrap().posture.q.clone();
        let smooth = match expected {
            None => answer,
            Some(before) => {
                let both = before.iter().zip(&answer);
                both.map(|(from, to)| from + 0.25 * (to - from)).collect()
            }
        };
        let found = filtered.step(&landmarks).unwrap();
        for (found, smooth) in found.posture.q.iter().zip(&smooth) {
            assert!((found - smooth).abs() < 1e-12);
        }
        expected = Some(smooth);
    }
}

#[test]
fn after_a_reset_the_same_frames_have_the_same_answers() {
    let problem = problem(DEXPILOT);
    let mut follower = Follower::new(&problem);
    let mut run = || -> Vec<Vec<f64>> {
        follower.reset();
        let mut answer = |frame| follower.step(&frame).unwrap().posture.q.clone();
        frames().map(&mut answer).collect()
    };
    assert_eq!(run(), run());
}

#[test]
fn refuses_what_cannot_be_followed_and_goes_on() {
    let problem = problem(VECTOR);
    let mut follower = Follower::new(&problem);
    let frame = frames().next().unwrap();
    let mut broken = frame;
    broken[4][0] = f64::NAN;
    assert!(matches!(
        follower.step(&broken),
        Err(ProblemError::NotFinite)
    ));
    let few = follower.step_reference(&[[0.0; 3]]);
    let expected = ProblemError::References {
        found: 1,
        expected: 3,
    };
    assert_eq!(few.unwrap_err().to_string(), expected.to_string());
    assert!(follower.step(&frame).is_ok());
}

#[test]
fn names_that_the_robot_lacks_are_refused_with_near_ones() {
    let text = VECTOR.replace("link_3.0_tip", "link_3_tip");
    let err = Problem::new(&text.parse().unwrap(), URDF).unwrap_err();
    assert!(err.to_string().contains("link_3_tip"), "{err}");
    let hint = err.hint().unwrap();
    assert!(hint.contains("link_3.0_tip"), "{hint}");
}

#[test]
fn joints_that_are_left_out_stay() {
    let names = "  target_joint_names: [ joint_0.0, joint_1.0 ]\n  scaling";
    let problem = problem(&VECTOR.replace("  scaling", names));
    let mut follower = Follower::new(&problem);
    for landmarks in frames() {
        let q = follower.step(&landmarks).unwrap().posture.q.clone();
        for (joint, q) in problem.model().joints().iter().zip(q) {
            if !["joint_0.0", "joint_1.0"].contains(&joint.name.as_str()) {
                assert_eq!(q, 0.0_f64.clamp(joint.lower, joint.upper), "{}", joint.name);
            }
        }
    }
}
