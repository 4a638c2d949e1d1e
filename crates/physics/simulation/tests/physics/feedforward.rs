//! Whole rollouts under PD with feedforward, beside PD alone.

use motion::{JointRates, Motion, Rates, Step};
use simulation::{
    Approach, ControllerKind, Offset, Protocol, Rollout, SceneConfig, SettledScene, TraceMode,
    TraceStep, Verdict,
};
use spatial::Object;

use crate::scene::{hand, protocol, q, scene, settled, side_grasp};

const BESIDE: [f64; 3] = [-0.015, -0.055, 0.02];

fn with(controller: ControllerKind) -> SceneConfig {
    let mut scene = scene();
    scene.drive.controller = controller;
    scene
}

/// Returns the position of a wave after a share of the reach, with its first two derivatives by the share.
fn wave(share: f64) -> [f64; 3] {
    let turns = 1.5 * std::f64::consts::TAU;
    let (sin, cos) = (turns * share).sin_cos();
    [0.3 * sin, 0.3 * turns * cos, -0.3 * turns * turns * sin]
}

/// 1 for each joint that flexes, else 0.
fn flexes() -> Vec<f64> {
    let names = hand().joint_names();
    let flexes = |name| f64::from(u8::from(protocol().flexion_joints.contains(name)));
    names.iter().map(flexes).collect()
}

/// A side grasp whose fingers stay open until the last quarter of the reach, in which they close.
fn closing(q: &[f64]) -> Motion<Object, ()> {
    let grasp = side_grasp(BESIDE, q);
    let last = grasp.steps().len() - 1;
    let step = |(idx, step): (usize, &Step<Object, ()>)| {
        let closed = (4.0 * idx as f64 / last as f64 - 3.0).max(0.0);
        let opened = flexes()
            .into_iter()
            .map(|weight| 0.3 * weight * (1.0 - closed));
        Step {
            q_rad: q.iter().zip(opened).map(|(q, opened)| q - opened).collect(),
            ..step.clone()
        }
    };
    let steps = grasp.steps().iter().enumerate().map(step);
    Motion::of_joints(grasp.joints().clone(), steps.collect()).unwrap()
}

/// A hand that waves all flexion joints on its way, and knows how fast.
fn waving() -> Motion<Object, JointRates> {
    const DURATION_S: f64 = 0.8;
    const N: u32 = 20;
    let hand = hand();
    let middle = q([0.7, 0.7, 0.7], [0.8, 0.5, 0.7, 0.7]);
    let first = side_grasp(BESIDE, &middle).first().clone();
    let flexes = flexes();
    let step = |step: u32| {
        let share = f64::from(step) / f64::from(N);
        let waved = |order: usize, by: f64| -> Vec<f64> {
            let number = wave(share)[order] / by;
            flexes.iter().map(|weight| weight * number).collect()
        };
        let joints = middle.iter().zip(waved(0, 1.0));
        Step {
            time_s: DURATION_S * share,
            frame_from_palm: first.frame_from_palm,
            q_rad: joints.map(|(q, wave)| q + wave).collect(),
            rates: JointRates {
                velocity: waved(1, DURATION_S),
                acceleration: waved(2, DURATION_S.powi(2)),
            },
        }
    };
    Motion::new(&hand.joint_names(), (0..=N).map(step).collect()).unwrap()
}

/// The same hand, which does not know how fast it is.
fn waving_unaware() -> Motion<Object, ()> {
    let motion = waving();
    let steps = motion.steps().iter().map(|step| Step {
        time_s: step.time_s,
        frame_from_palm: step.frame_from_palm,
        q_rad: step.q_rad.clone(),
        rates: (),
    });
    Motion::of_joints(motion.joints().clone(), steps.collect()).unwrap()
}

/// Returns the most that a flexion joint is off the wave at the ends of the control steps, the first
/// fifth of the reach left out, in which the hand picks up its speed.
fn most_lag(steps: &[TraceStep], reach_n: usize) -> f64 {
    let middle = q([0.7, 0.7, 0.7], [0.8, 0.5, 0.7, 0.7]);
    let names = hand().joint_names();
    let mut most: f64 = 0.0;
    for (number, step) in steps.iter().enumerate().take(reach_n).skip(reach_n / 5) {
        let expected = wave(number as f64 / reach_n as f64)[0];
        for (joint, name) in names.iter().enumerate() {
            if protocol().flexion_joints.contains(name) {
                most = most.max((step.q[joint] - middle[joint] - expected).abs());
            }
        }
    }
    most
}

#[test]
fn a_motion_with_its_rates_is_followed_far_closer_than_by_pd_and_closer_than_without() {
    fn lag<R: Rates>(motion: &Motion<Object, R>, controller: ControllerKind, reach_n: u32) -> f64 {
        let mut scene = with(controller);
        // Nothing is in the way.
        scene.object_offset = Offset {
            x_m: 0.5,
            ..Offset::default()
        };
        let mut protocol = protocol();
        protocol.approach = Approach::Follow;
        protocol.reach_s = scene.control_step_s() * f64::from(reach_n);
        let rollout = settled(&scene)
            .rollout(motion, &protocol, TraceMode::Trace)
            .unwrap();
        most_lag(&rollout.trace.unwrap().steps, reach_n as usize)
    }
    let (aware, unaware) = (waving(), waving_unaware());
    // At the speed of the motion, and at half of it.
    for reach_n in [40, 80] {
        let pd = lag(&aware, ControllerKind::Pd, reach_n);
        let held = lag(&aware, ControllerKind::PdVelocity, reach_n);
        let interpolated = lag(&aware, ControllerKind::PdVelocityInterpolated, reach_n);
        let exact = lag(&aware, ControllerKind::PdFeedforward, reach_n);
        let guessed = lag(&unaware, ControllerKind::PdFeedforward, reach_n);
        println!(
            "{reach_n} steps: PD {pd} rad, with velocity {held} rad, interpolated {interpolated} rad, \
             feedforward {exact} rad, of differences {guessed} rad"
        );
        assert!(pd > 0.05, "{pd}");
        // Each arm is closer than the one before.
        assert!(held < 0.5 * pd, "{held} of {pd}");
        assert!(interpolated < held, "{interpolated} of {held}");
        assert!(exact < interpolated, "{exact} of {interpolated}");
        assert!(10.0 * exact < pd, "{exact} of {pd}");
        assert!(exact < guessed && guessed < 0.3 * pd, "{guessed} of {pd}");
    }
}

#[test]
fn a_good_grasp_holds_under_feedforward_too() {
    let grasp = q([0.8, 0.9, 0.7], [1.3, 0.5, 0.5, 0.7]);
    for (approach, motion) in [
        (Approach::Open, side_grasp(BESIDE, &grasp)),
        (Approach::Follow, closing(&grasp)),
    ] {
        let mut protocol = protocol();
        protocol.approach = approach;
        let settled = settled(&with(ControllerKind::PdFeedforward));
        let run = |settled: &SettledScene| -> Rollout {
            settled
                .rollout(&motion, &protocol, TraceMode::Trace)
                .unwrap()
        };
        let rollout = run(&settled);
        assert_eq!(rollout.verdict, Verdict::Held, "{approach:?}: {rollout:?}");
        assert_eq!(rollout, run(&settled));
        // Nothing is in the way before the fingers close.
        let steps = rollout.trace.unwrap().steps;
        let before = steps
            .iter()
            .filter(|step| step.time_s < 0.7 * protocol.reach_s);
        let errors = before.flat_map(|step| {
            let pairs = step.q.iter().zip(&step.q_command);
            pairs
                .map(|(q, command)| (q - command).abs())
                .collect::<Vec<_>>()
        });
        let most_rad = errors.fold(0.0, f64::max);
        assert!(most_rad < 0.02, "{approach:?}: {most_rad} rad off");
    }
}

#[test]
fn hand_mass_changes_the_motion() {
    let trace = |hand_mass_scale: f64| {
        let mut scene = scene();
        scene.hand_mass_scale = hand_mass_scale;
        let mut protocol = protocol();
        protocol.approach = Approach::Follow;
        let rollout = settled(&scene)
            .rollout(&waving(), &protocol, TraceMode::Trace)
            .unwrap();
        most_lag(&rollout.trace.unwrap().steps, 40)
    };
    let (light, heavy) = (trace(1.0), trace(3.0));
    assert!(light != heavy, "{light}");
}

/// Returns the steps of a hand that waves, `delay_n` physics steps late.
fn waved(controller: ControllerKind, steps_per_control: u32, delay_n: u32) -> Vec<TraceStep> {
    let mut scene = with(controller);
    scene.steps_per_control = steps_per_control;
    scene.drive.delay_s = f64::from(delay_n) * scene.time_step_s;
    let protocol = Protocol {
        approach: Approach::Follow,
        ..protocol()
    };
    let rollout = settled(&scene).rollout(&waving(), &protocol, TraceMode::Trace);
    rollout.unwrap().trace.unwrap().steps
}

/// With a delay the fingers are where they were so many physics steps before without one; until then they wait
/// at their start.
#[test]
fn delayed_fingers_follow_the_same_course_later() {
    for controller in [ControllerKind::Pd, ControllerKind::PdFeedforward] {
        // One physics step in a control step: each is in the trace.
        let at = |delay_n: u32| waved(controller, 1, delay_n);
        let most = |a: &[TraceStep], b: &[TraceStep]| {
            let joints = a.iter().zip(b).flat_map(|(a, b)| a.q.iter().zip(&b.q));
            joints.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
        };
        let prompt = at(0);
        let reach_n = 150;
        for delay_n in [1, 7, 20] {
            let late = at(delay_n);
            let shift = delay_n as usize;
            let apart = most(&prompt[..reach_n], &late[shift..]);
            assert!(apart < 3e-3, "{controller:?}, {delay_n} steps: {apart}");
            let apart = most(&prompt[..reach_n], &late);
            assert!(apart > 5e-3 * f64::from(delay_n), "{controller:?}: {apart}");
            // The palm and the commands are unchanged.
            assert_eq!(prompt[50].q_command, late[50].q_command);
            assert_eq!(prompt[50].table_from_palm, late[50].table_from_palm);
        }
    }
}

/// The fingers' commands are the same within a control step, and so is when they arrive.
#[test]
fn a_delay_may_be_a_part_of_a_control_step() {
    let at = |delay_n: u32| waved(ControllerKind::Pd, scene().steps_per_control, delay_n);
    let steps: Vec<Vec<TraceStep>> = (0..=5).map(at).collect();
    let joint = hand().joint("joint_2.0").unwrap();
    // On a rising course, the later its command, the less far a finger is.
    let rising = (1..=5).map(|idx| {
        steps
            .iter()
            .map(|of| of[idx].q[joint])
            .collect::<Vec<f64>>()
    });
    for q in rising {
        assert!(q.windows(2).all(|pair| pair[1] <= pair[0] + 1e-6), "{q:?}");
    }
    let first: Vec<f64> = steps.iter().map(|of| of[3].q[joint]).collect();
    assert!(first[0] - first[5] > 0.02, "{first:?}");
    // Five physics steps are one control step.
    assert!((first[5] - steps[0][2].q[joint]).abs() < 3e-3, "{first:?}");
}
