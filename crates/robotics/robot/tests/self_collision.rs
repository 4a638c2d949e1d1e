//! Collisions of the bundled hands with themselves.

use std::path::Path;

use proptest::prelude::*;
use robot::{RobotModel, SelfCollision, SelfGaps, distance_bounds};
use spatial::Palm;

const HANDS: [&str; 4] = [
    "allegro_right",
    "allegro_left",
    "leap_right",
    "shadow_right",
];

fn hand(name: &str) -> RobotModel {
    let robots = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../data/robots");
    let urdf = std::fs::read_to_string(robots.join(format!("{name}.urdf"))).unwrap();
    RobotModel::from_urdf(&urdf).unwrap()
}

fn rest(hand: &RobotModel) -> Vec<f64> {
    hand.joints()
        .iter()
        .map(robot::Joint::nearest_zero)
        .collect()
}

/// Joint positions at shares of their ranges.
fn at(hand: &RobotModel, shares: &[f64]) -> Vec<f64> {
    let joints = hand.joints().iter().zip(shares);
    joints
        .map(|(joint, share)| joint.lower + share * (joint.upper - joint.lower))
        .collect()
}

#[test]
fn a_hand_at_rest_is_clear_of_itself() {
    for name in HANDS {
        let hand = hand(name);
        let collision = SelfCollision::new(&hand);
        let poses = hand.forward_kinematics::<Palm>(&rest(&hand)).unwrap();
        let mut gaps = SelfGaps::default();
        collision.gaps(&poses, 0.0, &mut gaps);
        assert_eq!(gaps.gaps(), [], "{name}");
        // Every finger's tip can meet that of every other.
        let is_shaped = |link: &usize| !hand.links()[*link].collisions.is_empty();
        let fingers = hand.fingers();
        let tips: Vec<usize> = fingers
            .iter()
            .filter_map(|finger| finger.links.iter().copied().rfind(is_shaped))
            .collect();
        assert_eq!(tips.len(), fingers.len());
        for (a, b) in tips.iter().flat_map(|a| tips.iter().map(move |b| (*a, *b))) {
            let meets = collision.link_pairs().any(|pair| pair == [a, b]);
            assert_eq!(meets, a < b, "{name}: {a} {b}");
        }
    }
}

/// Pairs are of different fingers, or of the palm and a link of a finger that is not next to it.
#[test]
fn fingers_meet_each_other_and_the_palm_but_not_themselves() {
    for name in HANDS {
        let hand = hand(name);
        let shapes = hand.hand_shapes();
        let mut fingers: Vec<usize> = shapes.iter().filter_map(|shape| shape.finger).collect();
        fingers.dedup();
        assert_eq!(fingers, (0..hand.fingers().len()).collect::<Vec<_>>());
        let finger_of = |link: usize| {
            let mut of_link = shapes.iter().filter(|shape| shape.link == link);
            of_link.next().and_then(|shape| shape.finger)
        };
        let collision = SelfCollision::new(&hand);
        let mut on_palm = 0;
        for [a, b] in collision.link_pairs() {
            assert_ne!(finger_of(a), finger_of(b), "{name}");
            let of_finger = match [a, b].map(finger_of) {
                [None, _] => b,
                [_, None] => a,
                _ => continue,
            };
            on_palm += 1;
            let joints = hand.up_from(of_finger);
            let joint_n = joints
                .filter(|&link| hand.links()[link].kind.is_some())
                .count();
            assert!(joint_n > 1, "{name}: {}", hand.links()[of_finger].name);
        }
        assert!(on_palm > 0, "{name}");
    }
}

/// Turned toward each other about their knuckles, fingers cross.
#[test]
fn crossed_fingers_are_in_each_other() {
    // The Allegro's fingers turn about their own length, so they cross when bent.
    let bent = ["joint_1.0", "joint_5.0"].as_slice();
    let check = |name: &str, joints: [(&str, f64); 2], bent: &[&str], fingers: [&str; 2]| {
        let hand = hand(name);
        let collision = SelfCollision::new(&hand);
        let mut gaps = SelfGaps::default();
        let mut crossed = |share: f64| {
            let mut q = rest(&hand);
            for joint in bent {
                q[hand.joint(joint).unwrap()] = 1.0;
            }
            for (joint, way) in joints {
                let idx = hand.joint(joint).unwrap();
                let joint = &hand.joints()[idx];
                q[idx] = joint.clamp(share * way * joint.upper.min(-joint.lower));
            }
            let poses = hand.forward_kinematics::<Palm>(&q).unwrap();
            let found = collision.gaps(&poses, 0.0, &mut gaps);
            let links = fingers.map(|link| hand.link(link).unwrap());
            let are_in = found.iter().any(|gap| gap.links == links);
            (are_in, gaps.depth_m())
        };
        let (are_in, depth_m) = crossed(1.0);
        assert!(are_in && depth_m > 0.002, "{name}: {are_in}, {depth_m} m");
        assert_eq!(crossed(0.0), (false, 0.0), "{name}");
        assert!(!crossed(-1.0).0, "{name}");
    };
    let allegro = ["link_3.0", "link_7.0"];
    check(
        "allegro_right",
        [("joint_0.0", -1.0), ("joint_4.0", 1.0)],
        bent,
        allegro,
    );
    check(
        "allegro_left",
        [("joint_0.0", 1.0), ("joint_4.0", -1.0)],
        bent,
        allegro,
    );
    check(
        "leap_right",
        [("0", 1.0), ("4", -1.0)],
        &[],
        ["dip", "dip_2"],
    );
    check(
        "shadow_right",
        [("FFJ4", 1.0), ("MFJ4", -1.0)],
        &[],
        ["ffmiddle", "mfmiddle"],
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// Pairs of shapes that are found are as far apart as the URDF's own shapes, but for their rounded edges, and none
    /// is missed.
    #[test]
    fn gaps_are_those_of_the_shapes(which in 0..HANDS.len(), shares in prop::collection::vec(0.0..1.0_f64, 30)) {
        const MARGIN_M: f64 = 0.004;
        // What is rounded off two corners.
        const ROUNDED_M: f64 = 2.0 * 0.0022;
        let hand = hand(HANDS[which]);
        let collision = SelfCollision::new(&hand);
        let poses = hand.forward_kinematics::<Palm>(&at(&hand, &shares)).unwrap();
        let (hand, poses) = (&hand, &poses);
        let mut gaps = SelfGaps::default();
        let found = collision.gaps(poses, MARGIN_M, &mut gaps);
        let mut pairs: Vec<[usize; 2]> = collision.link_pairs().collect();
        pairs.dedup();
        pairs.sort_unstable();
        pairs.dedup();
        for [a, b] in pairs {
            let of_pair = found.iter().filter(|gap| gap.links == [a, b]);
            let least_m = of_pair.map(|gap| gap.gap_m).fold(f64::INFINITY, f64::min);
            let shapes = |link: usize| {
                let collisions = hand.links()[link].collisions.iter();
                collisions.map(move |one| (poses[link] * one.link_from_shape, &one.shape))
            };
            let mut exact_m = f64::INFINITY;
            for (at_a, shape_a) in shapes(a) {
                for (at_b, shape_b) in shapes(b) {
                    let bounds = distance_bounds::<Palm>((&at_a, shape_a), (&at_b, shape_b));
                    exact_m = exact_m.min(bounds.at_most_m);
                }
            }
            let names = [a, b].map(|link| &hand.links()[link].name);
            if least_m.is_finite() {
                // Shapes that overlap at rest are no pair, so that others of the links are farther apart.
                prop_assert!(least_m.max(0.0) >= exact_m - 2e-5, "{names:?}: {least_m} {exact_m}");
            }
            let is_whole = [a, b].iter().all(|&link| hand.links()[link].collisions.len() == 1);
            if is_whole && exact_m + ROUNDED_M < MARGIN_M {
                prop_assert!(least_m <= exact_m + ROUNDED_M, "{names:?}: {least_m} {exact_m}");
            }
        }
    }

    /// What is remembered of other postures makes no difference.
    #[test]
    fn gaps_do_not_depend_on_the_postures_before(
        which in 0..HANDS.len(), ways in prop::collection::vec(prop::collection::vec(0.0..1.0_f64, 30), 2),
    ) {
        let hand = hand(HANDS[which]);
        let collision = SelfCollision::new(&hand);
        let mut gaps = SelfGaps::default();
        for idx in 0..=20 {
            let share = f64::from(idx) / 20.0;
            let shares: Vec<f64> = ways[0].iter().zip(&ways[1]).map(|(a, b)| a + share * (b - a)).collect();
            let poses = hand.forward_kinematics::<Palm>(&at(&hand, &shares)).unwrap();
            let found = collision.gaps(&poses, 0.002, &mut gaps);
            let mut unused = SelfGaps::default();
            prop_assert_eq!(found, collision.gaps(&poses, 0.002, &mut unused));
        }
    }

    /// The gradient by the joints is that of the gap.
    #[test]
    fn gradients_by_the_joints_are_slopes(which in 0..HANDS.len(), shares in prop::collection::vec(0.0..1.0_f64, 30)) {
        const H_RAD: f64 = 1e-6;
        let hand = hand(HANDS[which]);
        let collision = SelfCollision::new(&hand);
        let q = at(&hand, &shares);
        let gaps_at = |q: &[f64]| {
            let mut gaps = SelfGaps::default();
            let poses = hand.forward_kinematics::<Palm>(q).unwrap();
            collision.gaps(&poses, 1.0, &mut gaps).to_vec()
        };
        let here = gaps_at(&q);
        let poses = hand.forward_kinematics::<Palm>(&q).unwrap();
        let near: Vec<usize> = (0..here.len()).filter(|&idx| here[idx].gap_m < 0.01).collect();
        let gradients: Vec<Vec<f64>> = near.iter().map(|&idx| {
            let mut by_q = vec![0.0; q.len()];
            hand.add_gap_gradient(&poses, &here[idx], 1.0, &mut by_q);
            by_q
        }).collect();
        for joint in 0..q.len() {
            let moved = |by: f64| {
                let mut q = q.clone();
                q[joint] += by;
                gaps_at(&q)
            };
            let (ahead, behind) = (moved(H_RAD), moved(-H_RAD));
            for (gradient, &idx) in gradients.iter().zip(&near) {
                let slopes = [ahead[idx].gap_m - here[idx].gap_m, here[idx].gap_m - behind[idx].gap_m];
                let [ahead, behind] = slopes.map(|way| way / H_RAD);
                // Where two ways out are equally short, or sides parallel, the slope has two values.
                if (ahead - behind).abs() < 1e-4 {
                    let off = f64::midpoint(ahead, behind) - gradient[joint];
                    prop_assert!(off.abs() < 3e-4, "{off} {:?}", here[idx]);
                }
            }
        }
    }
}
