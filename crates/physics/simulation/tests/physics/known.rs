//! Grasps of six bodies that are known to hold or known not to, in both trials.

use simulation::{PullConfig, Rollout, SceneConfig, SettledScene, TraceMode, Trial, Verdict};

use crate::{
    bodies::bodies,
    scene::{hand, protocol, q, scene, side_grasp},
};

/// Closing of the fingers around each body, in radians per joint: to its middle.
const CLOSED: [(&str, f64); 6] = [
    ("can", 0.85),
    ("wide can", 0.75),
    ("box", 0.7),
    ("brick", 0.7),
    ("block", 0.7),
    ("hexagonal prism", 0.85),
];

/// Grasps a body from the side, the fingers closed by `closed`.
fn roll(name: &str, closed: f64, scene: &SceneConfig, trial: Trial, pull: PullConfig) -> Rollout {
    let (_, object, rest) = bodies().into_iter().find(|body| body.0 == name).unwrap();
    let settled = SettledScene::new(scene, &hand(), &object, &rest).unwrap();
    let q = q(
        [closed, closed + 0.1, closed],
        [1.3, 0.5 * closed, 0.6 * closed, 0.8 * closed],
    );
    let mut protocol = protocol();
    (protocol.trial, protocol.pull) = (trial, pull);
    settled
        .rollout(
            &side_grasp([-0.02, -0.054, 0.02], &q),
            &protocol,
            TraceMode::Nothing,
        )
        .unwrap()
}

fn lift(name: &str, closed: f64, scene: &SceneConfig) -> Verdict {
    roll(name, closed, scene, Trial::Lift, PullConfig::default()).verdict
}

#[test]
fn fingers_closed_around_a_body_hold_it() {
    for (name, closed) in CLOSED {
        assert_eq!(lift(name, closed, &scene()), Verdict::Held, "{name}");
    }
}

#[test]
fn open_fingers_hold_nothing() {
    for (name, _) in CLOSED {
        assert_eq!(lift(name, 0.2, &scene()), Verdict::NotGrasped, "{name}");
    }
}

#[test]
fn slippery_or_heavy_bodies_are_not_held() {
    for (name, closed) in CLOSED {
        let mut slippery = scene();
        slippery.friction = 0.02;
        assert_ne!(lift(name, closed, &slippery), Verdict::Held, "{name}");
        let mut heavy = scene();
        heavy.mass_scale = 60.0;
        assert_ne!(lift(name, closed, &heavy), Verdict::Held, "{name}");
    }
}

fn pulled(name: &str, closed: f64, pull: PullConfig) -> Rollout {
    roll(name, closed, &scene(), Trial::SixDirections, pull)
}

#[test]
fn enclosing_grasp_withstands_pulls_in_six_directions() {
    for (name, closed) in CLOSED {
        let rollout = pulled(name, closed, PullConfig::default());
        assert_eq!(rollout.verdict, Verdict::Held, "{name}: {rollout:?}");
        // 0.8 s reach, 0.3 s squeeze, 0.3 s pause, six pulls of 2 s, at 50 Hz.
        assert_eq!(rollout.measures.control_steps_n, 670);
        assert!(rollout.measures.slip_m < 0.05 && rollout.measures.contacts_n >= 2);
    }
}

#[test]
fn pull_beyond_grip_strength_removes_the_can() {
    let pull = PullConfig {
        force_n_per_kg: 500.0,
        ..PullConfig::default()
    };
    let rollout = pulled("can", 0.85, pull);
    assert!(
        matches!(rollout.verdict, Verdict::Slipped | Verdict::Dropped),
        "{rollout:?}"
    );
    assert!(
        rollout.measures.slip_m > 0.02 && rollout.measures.control_steps_n < 75,
        "{rollout:?}"
    );
}

#[test]
fn object_in_open_fingers_is_pulled_away() {
    for (name, _) in CLOSED {
        let rollout = pulled(name, 0.2, PullConfig::default());
        let lost = matches!(rollout.verdict, Verdict::Slipped | Verdict::Dropped);
        assert!(
            lost && rollout.measures.control_steps_n < 200,
            "{name}: {rollout:?}"
        );
    }
}

#[test]
fn partial_enclosure_holds_a_thin_can_in_neither_trial() {
    assert_eq!(lift("thin can", 0.7, &scene()), Verdict::NotGrasped);
    let rollout = pulled("thin can", 0.7, PullConfig::default());
    let lost = matches!(rollout.verdict, Verdict::Slipped | Verdict::Dropped);
    assert!(lost, "{rollout:?}");
}
