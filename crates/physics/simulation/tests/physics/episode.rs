//! Episodes: copies go on from the same bits, and commands do what they do in a rollout.

use motion::{HandState, Motion};
use simulation::{
    Approach, ControllerKind, Episode, EpisodeState, PalmComplianceConfig, SettledScene,
    SimulationError, TraceMode,
};
use spatial::Object;

use crate::scene::{protocol, q, scene, settled, side_grasp};

/// A grasp from the side.
fn motion() -> Motion<Object, ()> {
    side_grasp([-0.02, -0.055, 0.02], &q([1.0; 3], [1.3, 0.5, 0.5, 0.9]))
}

/// Returns the commands of a grasp from the side, the start first, one per control step of the reach.
fn commands() -> Vec<HandState<Object>> {
    let motion = motion();
    let at = |step: i32| HandState::from(motion.at_fraction(f64::from(step) / 40.0));
    (0..=40).map(at).collect()
}

/// Every bit of what is seen.
fn bits(state: &EpisodeState) -> Vec<u64> {
    let poses = [
        state.table_from_palm.to_array(),
        state.table_from_object.to_array(),
    ];
    let numbers = poses.iter().flatten().chain(&state.q);
    numbers.map(|number| number.to_bits()).collect()
}

/// Advances by commands; returns what is seen after each.
fn advance(scene: &SettledScene, episode: &mut Episode, by: &[HandState<Object>]) -> Vec<Vec<u64>> {
    let step = |command: &HandState<Object>| {
        scene.advance(episode, command).unwrap();
        bits(&scene.observe(episode))
    };
    by.iter().map(step).collect()
}

#[test]
fn a_copy_made_in_contact_goes_on_from_the_same_bits() {
    let scene = settled(&scene());
    let commands = commands();
    let whole = advance(
        &scene,
        &mut scene.begin(&commands[0]).unwrap(),
        &commands[1..],
    );
    // The object was moved: the hand touches it.
    assert_ne!(whole[0][7..14], whole[39][7..14]);
    for before in [0, 25, 33, 39] {
        let mut episode = scene.begin(&commands[0]).unwrap();
        advance(&scene, &mut episode, &commands[1..=before]);
        let mut copy = episode.fork();
        // What is done to the original does not matter to the copy.
        let mut elsewhere = commands[40].clone();
        elsewhere.q_rad = vec![0.0; elsewhere.q_rad.len()];
        for _ in 0..5 {
            scene.advance(&mut episode, &elsewhere).unwrap();
        }
        let rest = advance(&scene, &mut copy, &commands[before + 1..]);
        assert_eq!(rest, whole[before..], "after {before} steps");
    }
}

#[test]
fn commands_do_what_they_do_in_the_reach_of_a_rollout() {
    let scene = settled(&scene());
    let commands = commands();
    let motion = motion();
    let mut protocol = protocol();
    protocol.approach = Approach::Follow;
    // Fingers that are closed all the way come near the can before they should.
    protocol.early_tolerance_m = 1.0;
    let rollout = scene.rollout(&motion, &protocol, TraceMode::Trace).unwrap();
    let trace = rollout.trace.unwrap();
    let mut episode = scene.begin(&commands[0]).unwrap();
    // It ends where the can falls: the hand has touched it before.
    let [first, .., last] = &trace.steps[..] else {
        panic!("nothing was simulated");
    };
    assert!(trace.steps.len() > 20 && first.table_from_object != last.table_from_object);
    for (step, command) in trace.steps[1..].iter().zip(&commands[1..]) {
        scene.advance(&mut episode, command).unwrap();
        let found = scene.observe(&episode);
        assert_eq!(found.table_from_palm, step.table_from_palm);
        assert_eq!(found.table_from_object, step.table_from_object);
        assert_eq!(found.q, step.q);
    }
}

#[test]
fn drives_that_look_ahead_or_are_late_palms_that_yield_and_other_hands_are_refused() {
    let start = commands().remove(0);
    let mut ahead = scene();
    ahead.drive.controller = ControllerKind::PdFeedforward;
    let mut late = scene();
    late.drive.delay_s = 0.02;
    let mut yielding = scene();
    yielding.palm_compliance = Some(PalmComplianceConfig::default());
    for (scene, key) in [
        (ahead, "drive.controller"),
        (late, "drive.delay_s"),
        (yielding, "palm_compliance"),
    ] {
        match settled(&scene).begin(&start) {
            Err(SimulationError::Setting(fault)) => assert_eq!(fault.key, key),
            _ => panic!("not refused"),
        }
    }
    let short = HandState {
        q_rad: vec![0.0; 3],
        ..start
    };
    let refused = settled(&scene()).begin(&short);
    assert!(matches!(refused, Err(SimulationError::Motion(_))));
}

#[test]
fn a_command_below_the_table_is_as_deep_as_its_lowest_link() {
    let scene = settled(&scene());
    let above = commands().remove(0);
    assert_eq!(scene.below_table_m(&above), 0.0);
    let lowered = |by_m: f64| {
        let down = scene.table_from_estimate().rotation.inverse() * -nalgebra::Vector3::z();
        scene.below_table_m(&HandState {
            frame_from_palm: above.frame_from_palm.translated(&(down * by_m)),
            q_rad: above.q_rad.clone(),
        })
    };
    let [some, more] = [0.2, 0.23].map(lowered);
    assert!(
        some > 0.0 && (more - some - 0.03).abs() < 1e-9,
        "{some} {more}"
    );
}
