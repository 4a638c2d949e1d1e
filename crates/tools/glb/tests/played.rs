//! Playback shows the hand and the object where the motion had them, at any time.

mod motions;

use glb::{GlbError, Moment, Player};
use motions::{MotionSpectrum, hand, motion, object, scene};
use nalgebra::Isometry3;
use proptest::prelude::*;
use robot::Link;

/// Rounding of the file's numbers, beside [`glb::TOLERANCE_M`]: 16 bits in each joint of a chain.
const ROUNDING_M: f64 = 5e-5;

/// Checks every moment, and that halfway between two neighbors something between them is shown.
fn check(moments: &[Moment]) {
    let (hand, object) = (hand(), object());
    let bytes = scene(&hand, &object).to_glb(moments).unwrap();
    let player = Player::read(&bytes).unwrap();
    let last = moments.last().unwrap();
    assert!((player.duration_s() - last.time_s).abs() < 1e-6);
    for moment in moments {
        let time_s = f64::from(moment.time_s as f32);
        let near = |name: &str, expected: &Isometry3<f64>| {
            let found = player.table_from(name, time_s).unwrap();
            let off_m = (found.translation.vector - expected.translation.vector).norm();
            let off_rad = found.rotation.angle_to(&expected.rotation);
            assert!(
                off_m < glb::TOLERANCE_M + ROUNDING_M && off_rad < 0.1_f64.to_radians(),
                "`{name}` at {time_s} s is off by {off_m} m and {off_rad} rad"
            );
        };
        near("object", &moment.table_from_object);
        for (prefix, q) in [
            ("", &moment.q),
            ("ghost_", moment.q_command.as_ref().unwrap()),
        ] {
            let root_from_links = hand.forward_kinematics::<Link>(q).unwrap();
            for (link, root_from_link) in hand.links().iter().zip(root_from_links) {
                let table_from_link = moment.table_from_root * root_from_link;
                near(&format!("{prefix}{}", link.name), &table_from_link);
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn every_moment_is_shown_where_it_was(
        turns_per_s in 0.05..1.5_f64,
        reach_m in 0.0..0.4_f64,
        shake_m in 0.0..0.01_f64,
        steps in 1..150_u32,
    ) {
        let wild = MotionSpectrum { turns_per_s, reach_m, shake_m };
        check(&motion(&hand(), wild, steps));
    }
}

#[test]
fn a_slow_motion_needs_few_keys_and_a_still_one_fewer() {
    let (hand, object) = (hand(), object());
    let bytes_n = |moments: &[Moment]| scene(&hand, &object).to_glb(moments).unwrap().len();
    let slow = MotionSpectrum {
        turns_per_s: 0.1,
        reach_m: 0.1,
        shake_m: 0.0,
    };
    let moments = motion(&hand, slow, 600);
    let each_n = 600 * (2 * 16 * 8 + 2 * 28);
    let slow_n = bytes_n(&moments);
    assert!(slow_n < each_n / 2, "{slow_n} of {each_n}");
    let still = |moment: &Moment| Moment {
        time_s: moment.time_s,
        ..moments[0].clone()
    };
    let still_n = bytes_n(&moments.iter().map(still).collect::<Vec<_>>());
    assert!(still_n < slow_n, "{still_n} of {slow_n}");
}

#[test]
fn contacts_appear_and_vanish_with_the_size_of_their_force() {
    let (hand, object) = (hand(), object());
    let wild = MotionSpectrum {
        turns_per_s: 0.2,
        reach_m: 0.1,
        shake_m: 0.0,
    };
    let mut moments = motion(&hand, wild, 60);
    for moment in &mut moments {
        moment
            .contacts
            .retain(|_| (0.1..0.2).contains(&moment.time_s));
        for contact in &mut moment.contacts {
            contact.force_n = 2.0;
        }
        moment.contacts.truncate(1);
        let at = glb::Contact {
            point_in_table_m: [0.1, 0.2, 0.3],
            force_n: 2.0,
        };
        if (0.1..0.2).contains(&moment.time_s) {
            moment.contacts = vec![at];
        }
    }
    let bytes = scene(&hand, &object).to_glb(&moments).unwrap();
    let player = Player::read(&bytes).unwrap();
    assert_eq!(player.scale_of("contact_0", 0.02), Some(0.0));
    let size = player.scale_of("contact_0", 0.17).unwrap();
    assert!((0.003..0.004).contains(&size), "{size}");
    let point = player
        .table_from("contact_0", 0.17)
        .unwrap()
        .translation
        .vector;
    assert!(
        (point - nalgebra::Vector3::new(0.1, 0.2, 0.3)).norm() < 1e-6,
        "{point}"
    );
    assert_eq!(player.scale_of("contact_0", 0.235), Some(0.0));
}

#[test]
fn equal_motions_give_equal_bytes() {
    let (hand, object) = (hand(), object());
    let wild = MotionSpectrum {
        turns_per_s: 0.5,
        reach_m: 0.1,
        shake_m: 0.001,
    };
    let write = || {
        scene(&hand, &object)
            .to_glb(&motion(&hand, wild, 100))
            .unwrap()
    };
    assert!(write() == write());
}

#[test]
fn a_motion_that_cannot_be_shown_says_why() {
    let (hand, object) = (hand(), object());
    let wild = MotionSpectrum {
        turns_per_s: 0.5,
        reach_m: 0.1,
        shake_m: 0.0,
    };
    let moments = motion(&hand, wild, 3);
    let fault = |change: fn(&mut Vec<Moment>)| {
        let mut moments = moments.clone();
        change(&mut moments);
        scene(&hand, &object).to_glb(&moments).unwrap_err()
    };
    assert_eq!(fault(Vec::clear), GlbError::Empty);
    assert!(matches!(
        fault(|all| all[2].time_s = 0.0),
        GlbError::Order { idx: 2, .. }
    ));
    assert!(matches!(
        fault(|all| all[1].q[3] = f64::NAN),
        GlbError::NotFinite { idx: 1 }
    ));
    let short = fault(|all| {
        all[1].q.pop();
    });
    assert_eq!(
        short,
        GlbError::Joints {
            idx: 1,
            found: 15,
            expected: 16
        }
    );
    let mut torn = object.clone();
    torn.triangles[2][1] = 8;
    let err = scene(&hand, &torn).to_glb(&moments).unwrap_err();
    assert_eq!(
        err,
        GlbError::Vertex {
            triangle: 2,
            vertex: 8,
            vertices_n: 8
        }
    );
    assert!(matches!(Player::read(b"glTF"), Err(GlbError::Malformed(_))));
}
