//! A soup can, and grasps from its side that are drawn at random.

use std::f64::consts::TAU;

use nalgebra::{Isometry3, Matrix3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use robot::RobotModel;
use simulation::{Motion, ObjectShape};
use spatial::Rest;

const RADIUS_M: f64 = 0.034;
const HEIGHT_M: f64 = 0.102;
const MASS_KG: f64 = 0.349;

/// The can about its center: a hull of 32 vertices.
pub(crate) fn can() -> ObjectShape {
    let rim = (0..16).map(|idx| TAU * f64::from(idx) / 16.0);
    let points = rim
        .flat_map(|angle| {
            let (sin, cos) = angle.sin_cos();
            [-0.5, 0.5].map(|end| Point3::new(RADIUS_M * cos, RADIUS_M * sin, end * HEIGHT_M))
        })
        .collect();
    let across = MASS_KG * (3.0 * RADIUS_M.powi(2) + HEIGHT_M.powi(2)) / 12.0;
    let along = MASS_KG * RADIUS_M.powi(2) / 2.0;
    ObjectShape {
        parts_m: vec![points],
        mass_kg: MASS_KG,
        center_of_mass_m: Point3::origin(),
        inertia_kg_m2: Matrix3::from_diagonal(&Vector3::new(across, across, along)),
    }
}

/// The can stands.
pub(crate) fn upright() -> Rest {
    Rest {
        up_in_object: Vector3::z_axis(),
        height_m: HEIGHT_M / 2.0,
    }
}

/// Draws grasps: the palm comes from the side over 15 cm, its fingers around the can, the thumb up;
/// where it stands and how far it closes is drawn from ranges in which some fail in each way.
pub(crate) fn grasps(hand: &RobotModel, n: usize) -> Vec<Motion> {
    let mut rng = ChaCha8Rng::seed_from_u64(62);
    (0..n).map(|_| grasp(hand, &mut rng)).collect()
}

fn grasp(hand: &RobotModel, rng: &mut ChaCha8Rng) -> Motion {
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
    let shares = (0..=steps).map(|step| f64::from(step) / f64::from(steps));
    Motion {
        time_s: shares.clone().collect(),
        object_from_palm: shares
            .map(|share| {
                let y = at[1] - 0.15 * (1.0 - share);
                Isometry3::from_parts(Translation3::new(at[0], y, at[2]), turn)
            })
            .collect(),
        q: vec![q; 9],
        rates: None,
    }
}
