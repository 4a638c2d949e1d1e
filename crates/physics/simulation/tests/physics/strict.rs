//! Conditions of a success that many benchmarks leave out.

use motion::Motion;
use simulation::{KnockedUntil, Protocol, Rollout, SettledScene, StrictConfig, TraceMode, Verdict};
use spatial::{Object, Pose};

use crate::scene::{protocol, q, scene, settled, side_grasp};

const BESIDE: [f64; 3] = [-0.015, -0.055, 0.02];
/// Step of a search along an axis, in meters.
const SEARCH_M: f64 = 0.0005;

fn closed() -> Vec<f64> {
    q([0.8, 0.9, 0.7], [1.3, 0.5, 0.5, 0.7])
}

fn strict(change: impl Fn(&mut StrictConfig)) -> Protocol {
    let mut protocol = protocol();
    change(&mut protocol.strict);
    protocol
}

fn roll(settled: &SettledScene, protocol: &Protocol) -> Rollout {
    let motion = side_grasp(BESIDE, &closed());
    settled
        .rollout(&motion, protocol, TraceMode::Nothing)
        .unwrap()
}

/// The least distance, in steps of the search, for which a motion is refused for this reason.
fn first_refused(
    settled: &SettledScene,
    protocol: &Protocol,
    verdict: Verdict,
    motion: impl Fn(f64) -> Motion<Object, ()>,
) -> f64 {
    let distances = (0..400).map(|step| f64::from(step) * SEARCH_M);
    let is_refused = |&distance_m: &f64| {
        let refusal = settled.refusal(&motion(distance_m), protocol).unwrap();
        refusal == Some(verdict)
    };
    { distances }.find(is_refused).unwrap()
}

#[test]
fn a_palm_may_be_less_deep_in_the_table_than_fingers() {
    let settled = settled(&scene());
    let lowered = |down_m| side_grasp([BESIDE[0], BESIDE[1], BESIDE[2] - down_m], &closed());
    let refused_from_m = |palm_m: f64| {
        let mut protocol = strict(|strict| strict.palm_table_tolerance_m = palm_m);
        // Fingers may be anywhere.
        protocol.table_tolerance_m = 1.0;
        first_refused(&settled, &protocol, Verdict::Table, lowered)
    };
    let later_m =
        refused_from_m(0.01) - refused_from_m(StrictConfig::default().palm_table_tolerance_m);
    assert!((later_m - 0.008).abs() < 1.5 * SEARCH_M, "{later_m}");
}

#[test]
fn a_hand_that_starts_inside_the_object_is_refused() {
    let settled = settled(&scene());
    // The palm starts so far beyond its final place beside the can.
    let started = |beyond_m| {
        let motion = side_grasp(BESIDE, &closed());
        let mut steps = motion.steps().to_vec();
        let mut pose = *steps[0].frame_from_palm;
        pose.translation.y = BESIDE[1] + beyond_m;
        steps[0].frame_from_palm = Pose::new(pose);
        Motion::of_joints(motion.joints().clone(), steps).unwrap()
    };
    let refused_from_m = |start_m: f64| {
        let mut protocol = strict(|strict| strict.start_tolerance_m = start_m);
        protocol.early_tolerance_m = 1.0;
        first_refused(&settled, &protocol, Verdict::EarlyContact, started)
    };
    let later_m = refused_from_m(0.012) - refused_from_m(StrictConfig::default().start_tolerance_m);
    assert!((later_m - 0.01).abs() < 3.0 * SEARCH_M, "{later_m}");
}

#[test]
fn contact_is_counted_by_fingers() {
    let settled = settled(&scene());
    // Three fingers and a thumb, and the palm.
    for (min_fingers, expected) in [(2, Verdict::Held), (6, Verdict::Dropped)] {
        let rollout = roll(&settled, &strict(|strict| strict.min_fingers = min_fingers));
        assert_eq!(rollout.verdict, expected, "{rollout:?}");
        assert!(rollout.measures.contacts_n > 2, "{rollout:?}");
    }
}

#[test]
fn an_object_that_turns_in_the_hand_slips() {
    // The limit is on either side of the spin that the trace shows.
    let settled = settled(&scene());
    let rollout = |max_spin_rad_per_s| {
        let protocol = strict(|strict| strict.max_spin_rad_per_s = max_spin_rad_per_s);
        let motion = side_grasp(BESIDE, &closed());
        settled
            .rollout(&motion, &protocol, TraceMode::Trace)
            .unwrap()
    };
    let held = rollout(StrictConfig::default().max_spin_rad_per_s);
    assert_eq!(held.verdict, Verdict::Held);
    let steps = held.trace.unwrap().steps;
    // The final window of half a second, at 50 Hz.
    let [before, after] = [steps.len() - 26, steps.len() - 1].map(|step| {
        let step = &steps[step];
        step.table_from_palm
            .inv_mul(&step.table_from_object)
            .rotation
    });
    let spin_rad_per_s = before.angle_to(&after) / 0.5;
    assert_eq!(rollout(1.1 * spin_rad_per_s).verdict, Verdict::Held);
    assert_eq!(rollout(0.9 * spin_rad_per_s).verdict, Verdict::Slipped);
}

#[test]
fn an_object_displaced_by_the_squeeze_is_knocked_over() {
    let settled = settled(&scene());
    let reach_m = roll(&settled, &protocol()).measures.displacement_m;
    let until = |knocked_until| {
        let mut protocol = strict(|strict| strict.knocked_until = knocked_until);
        protocol.knocked_m = reach_m + 1e-4;
        roll(&settled, &protocol).verdict
    };
    assert_eq!(until(KnockedUntil::Squeeze), Verdict::Held);
    assert_eq!(until(KnockedUntil::Lift), Verdict::KnockedOver);
}

#[test]
fn hand_that_bears_more_than_an_arm_does_is_overloaded() {
    let settled = settled(&scene());
    let verdict = |newtons: Option<f64>, newton_meters: Option<f64>| {
        let protocol = strict(|strict| {
            strict.max_palm_force_n = newtons;
            strict.max_palm_torque_nm = newton_meters;
        });
        roll(&settled, &protocol).verdict
    };
    assert_eq!(verdict(None, None), Verdict::Held);
    assert_eq!(verdict(Some(100.0), Some(10.0)), Verdict::Held);
    // No grasp presses so evenly from all sides.
    assert_eq!(verdict(Some(1e-3), None), Verdict::Overloaded);
    assert_eq!(verdict(None, Some(1e-4)), Verdict::Overloaded);
}
