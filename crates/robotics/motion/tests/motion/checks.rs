//! Validation of motions, and their invariants under reordered joints and changes of frame.

use motion::{HandRates, JointRates, Motion, MotionError, MotionSpline, Step};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use spatial::{Object, Pose, Table};

use crate::swings::motions;

const JOINTS: [&str; 2] = ["a", "b"];

fn step(time_s: f64) -> Step<Object> {
    Step {
        time_s,
        frame_from_palm: Pose::new(Isometry3::new(
            Vector3::new(0.1, -0.2, 0.5 - 0.1 * time_s),
            Vector3::new(0.3 * time_s, 0.0, 0.1),
        )),
        q_rad: vec![0.5, time_s],
        rates: HandRates {
            joints: JointRates {
                velocity: vec![0.0, 1.0],
                acceleration: vec![0.0; 2],
            },
            ..HandRates::zero(2)
        },
    }
}

#[test]
fn invalid_steps_are_refused_by_number() {
    let refused = |change: &dyn Fn(&mut Vec<Step<Object>>)| {
        let mut steps: Vec<Step<Object>> = [0.0, 0.1, 0.2].map(step).to_vec();
        change(&mut steps);
        Motion::new(&JOINTS, steps).unwrap_err()
    };
    let number: [fn(&mut Step<Object>); 8] = [
        |s| s.time_s = f64::NAN,
        |s| s.q_rad[1] = f64::NAN,
        |s| s.q_rad.truncate(1),
        |s| s.frame_from_palm = Pose::new(Isometry3::translation(f64::INFINITY, 0.0, 0.0)),
        |s| s.rates.palm_velocity.linear.x = f64::NAN,
        |s| s.rates.palm_acceleration.angular.z = f64::INFINITY,
        |s| s.rates.joints.velocity.push(0.0),
        |s| s.rates.joints.acceleration[0] = f64::NAN,
    ];
    for change in number {
        let err = refused(&|steps| change(&mut steps[1]));
        assert_eq!(err, MotionError::Number { step: 1 });
    }
    let (none, one) = (refused(&Vec::clear), Motion::new(&JOINTS, vec![step(0.0)]));
    assert!(matches!(none, MotionError::Steps { found: 0, .. }));
    let err = MotionSpline::through(one.unwrap()).unwrap_err();
    assert!(matches!(err, MotionError::Steps { found: 1, .. }));
    for time_s in [0.0, -1.0] {
        let err = refused(&|steps| steps[1].time_s = time_s);
        assert!(matches!(err, MotionError::Times { step: 1, .. }), "{err}");
    }
}

#[test]
fn joints_of_another_hand_are_named() {
    let motion = Motion::new(&JOINTS, vec![step(0.0)]).unwrap();
    for (joints, named) in [
        (&["a", "c"][..], "`b`"),
        (&["a", "b", "c"], "`c`"),
        (&["a"], "`b`"),
    ] {
        let joints: Vec<String> = joints.iter().map(|&joint| joint.to_owned()).collect();
        let err = motion.reordered(&joints).unwrap_err().to_string();
        assert!(err.contains(named), "{err}");
    }
}

#[test]
fn between_two_steps_a_motion_is_straight_and_beyond_them_it_rests() {
    let motion = Motion::new(&JOINTS, vec![step(0.0), step(1.0), step(4.0)]).unwrap();
    let middle = motion.at(2.5);
    assert!((middle.q_rad[1] - 2.5).abs() < 1e-12);
    let place = middle.frame_from_palm.translation.vector;
    assert!((place.z - 0.25).abs() < 1e-12);
    for (time_s, expected) in [(-1.0, 0.0), (0.0, 0.0), (4.0, 4.0), (9.0, 4.0)] {
        assert!((motion.at(time_s).q_rad[1] - expected).abs() < 1e-12);
    }
    assert_eq!(motion.at_fraction(0.0).q_rad, [0.5, 0.0]);
    assert_eq!(motion.at_fraction(0.625), motion.at(2.5));
    let (q, rates) = motion.joints_at(2.5).unwrap();
    assert!((q[1] - 2.5).abs() < 1e-12 && (rates.velocity[1] - 1.0).abs() < 1e-12);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    /// Order and place are put back by their inverses.
    #[test]
    fn orders_and_places_have_inverses(motion in motions(&["a", "b", "c"]), share in 0.0..1.0_f64) {
        let joints = ["c", "a", "b"].map(str::to_owned);
        let other = motion.reordered(&joints).unwrap();
        prop_assert_eq!(&other.grasp().q_rad[0], &motion.grasp().q_rad[2]);
        let own = motion.joints().to_vec();
        prop_assert_eq!(&other.reordered(&own).unwrap(), &motion);
        let turn = UnitQuaternion::from_euler_angles(0.4, -1.1, 2.0);
        let by: Pose<Object, Object> = Pose::from_parts(Vector3::new(0.1, -0.2, 0.3), turn);
        let there = motion.moved(&by);
        let at = |motion: &Motion<Object>| motion.at_fraction(share).frame_from_palm;
        let off = at(&motion).inv_mul(&(by.inverse() * at(&there)));
        prop_assert!(off.translation.vector.norm() < 1e-12 && off.rotation.angle() < 1e-6);
        // In its own frame, the palm moves as before.
        let palm_velocity = |motion: &Motion<Object>| {
            let step = motion.grasp();
            step.frame_from_palm.rotation.inverse() * step.rates.palm_velocity.linear
        };
        prop_assert!((palm_velocity(&there) - palm_velocity(&motion)).norm() < 1e-12);
    }
}

#[test]
fn motion_is_equivariant_under_frame_changes() {
    let positions = |time_s: f64| Step {
        time_s,
        frame_from_palm: step(time_s).frame_from_palm,
        q_rad: vec![time_s],
        rates: (),
    };
    let motion = Motion::new(&["a"], vec![positions(0.0), positions(1.0)]).unwrap();
    let table_from_object =
        Pose::<Table, Object>::new(Isometry3::new(Vector3::new(0.4, 0.0, 0.1), Vector3::z()));
    let seen = motion.expressed_in(&table_from_object);
    let expected = table_from_object * motion.at(0.3).frame_from_palm;
    let off = expected.inverse() * seen.at(0.3).frame_from_palm;
    assert!(off.translation.vector.norm() < 1e-12);
    assert!(motion.joints_at(0.3).is_none());
}
