//! Grasps from the side that are drawn at random.

use motion::{Motion, Step};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use robot::RobotModel;
use simulation::{Approach, Protocol};
use spatial::{Object, Pose};

/// Returns the protocol of scripted grasps: their fingers are closed all the way, so they wait open.
pub(crate) fn opened(protocol: Protocol) -> Protocol {
    Protocol {
        approach: Approach::Open,
        ..protocol
    }
}

/// Draws grasps: the palm comes from the side over 15 cm, its fingers around the can, the thumb up;
/// where it stands and how far it closes is drawn from ranges in which some fail in each way.
pub(crate) fn grasps(hand: &RobotModel, n: usize) -> Vec<Motion<Object, ()>> {
    let mut rng = ChaCha8Rng::seed_from_u64(62);
    (0..n).map(|_| grasp(hand, &mut rng)).collect()
}

fn grasp(hand: &RobotModel, rng: &mut ChaCha8Rng) -> Motion<Object, ()> {
    let at = [
        rng.random_range(-0.045..-0.01),
        rng.random_range(-0.062..-0.047),
        rng.random_range(0.0..0.03),
    ];
    let finger = [0; 3].map(|_| rng.random_range(0.6..1.2));
    let thumb = [0; 3].map(|_| rng.random_range(0.2..0.9));
    let mut q = vec![0.0; hand.dof()];
    let mut set = |joint: usize, position: f64| {
        q[hand.joint(&format!("joint_{joint}.0")).unwrap()] = position;
    };
    for first in [1, 5, 9] {
        for (idx, position) in finger.into_iter().enumerate() {
            set(first + idx, position);
        }
    }
    set(12, 1.3);
    for (idx, position) in thumb.into_iter().enumerate() {
        set(13 + idx, position);
    }
    let turn = UnitQuaternion::from_quaternion(Quaternion::new(0.5, 0.5, 0.5, 0.5));
    let steps = 8;
    let step = |step: i32| {
        let share = f64::from(step) / f64::from(steps);
        let y = at[1] - 0.15 * (1.0 - share);
        let palm = Isometry3::from_parts(Translation3::new(at[0], y, at[2]), turn);
        Step {
            time_s: share,
            frame_from_palm: Pose::new(palm),
            q_rad: q.clone(),
            rates: (),
        }
    };
    Motion::new(&hand.joint_names(), (0..=steps).map(step).collect()).unwrap()
}
