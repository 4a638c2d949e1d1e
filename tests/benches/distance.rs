//! Distance between two shapes: `robot::distance_bounds` beside `parry3d`, pair by pair in one run.
//!
//! Clearance of an arm asks for a distance that is certainly not overestimated, so that it can skip as
//! far along the motion as nothing can come closer. `robot::distance_bounds` returns such a bound, `parry3d` a
//! number in single precision.

#![expect(clippy::print_stdout, reason = "a bench prints what it measured")]
#![expect(clippy::unwrap_used, reason = "a bench may break off")]

mod limits;

use std::{hint::black_box, process::ExitCode};

use limits::Limits;
use nalgebra::{UnitQuaternion, Vector3};
use parry3d::{
    math::{Pose, Rot3, Vector},
    query,
    shape::{Ball, Capsule, Cuboid, Cylinder, Shape as ParryShape},
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use robot::Shape;
use spatial::World;

/// Pairs of shapes.
const PAIRS: usize = 20_000;
/// Rounds, of which the fastest counts.
const ROUNDS: usize = 5;
/// Beyond this, in meters, a distance is not a matter of rounding.
const ROUNDING_M: f64 = 1e-6;

/// A shape of a hand's or an arm's link, for both, with its pose.
struct Placed {
    world_from_shape: spatial::Pose<World, Shape>,
    shape: Shape,
    parry_pose: Pose,
    parry: Box<dyn ParryShape>,
}

fn main() -> ExitCode {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let pairs: Vec<[Placed; 2]> = (0..PAIRS)
        .map(|_| [placed(&mut rng), placed(&mut rng)])
        .collect();
    let ours = |[a, b]: &[Placed; 2]| {
        robot::distance_bounds(
            (&a.world_from_shape, &a.shape),
            (&b.world_from_shape, &b.shape),
        )
    };
    let parrys = |[a, b]: &[Placed; 2]| {
        let found = query::distance(&a.parry_pose, &*a.parry, &b.parry_pose, &*b.parry);
        f64::from(found.unwrap().distance)
    };

    let mut worst_over_m: f64 = 0.0;
    let mut overs = 0;
    for pair in &pairs {
        let over_m = parrys(pair) - ours(pair).at_most_m;
        overs += usize::from(over_m > ROUNDING_M);
        worst_over_m = worst_over_m.max(over_m);
    }
    let widest_m = pairs
        .iter()
        .map(ours)
        .map(|gap| gap.at_most_m - gap.at_least_m);
    let widest_m = widest_m.fold(0.0, f64::max);

    let ours_us = fastest_us(&pairs, |pair| ours(pair).at_least_m);
    let parrys_us = fastest_us(&pairs, parrys);
    println!("{PAIRS} pairs of boxes, cylinders, capsules and balls, 0 to 20 cm apart");
    println!(
        "robot::distance_bounds          {ours_us:>8.3} µs a pair, bounds at most {:.4} mm apart",
        1e3 * widest_m
    );
    println!(
        "parry3d::distance   {parrys_us:>8.3} µs a pair, too far in {overs} pairs, by up to {:.4} mm",
        1e3 * worst_over_m
    );
    let mut limits = Limits::with_noise(0.2);
    limits.keep(
        "widest bounds of robot::distance_bounds, mm",
        1e3 * widest_m,
        ..=0.0201,
    );
    limits.keep(
        "time of robot::distance_bounds over parry3d's",
        ours_us / parrys_us,
        ..=4.0,
    );
    limits.end()
}

/// A shape of 1 to 10 cm within 20 cm of another.
fn placed(rng: &mut ChaCha8Rng) -> Placed {
    let mut size_m = || rng.random_range(0.005..0.05);
    let [x, y, z] = [size_m(), size_m(), size_m()];
    let (shape, parry): (Shape, Box<dyn ParryShape>) = match rng.random_range(0..4) {
        0 => (
            Shape::Box {
                half_extents_m: Vector3::new(x, y, z),
            },
            Box::new(Cuboid::new(Vector::new(single(x), single(y), single(z)))),
        ),
        1 => (
            Shape::Cylinder {
                radius_m: x,
                half_length_m: y,
            },
            Box::new(Cylinder::new(single(y), single(x))),
        ),
        2 => (
            Shape::Capsule {
                radius_m: x,
                half_length_m: y,
            },
            Box::new(Capsule::new_y(single(y), single(x))),
        ),
        _ => (
            Shape::Sphere { radius_m: x },
            Box::new(Ball::new(single(x))),
        ),
    };
    let mut between = |least: f64, most: f64| rng.random_range(least..most);
    let axis = Vector3::from_fn(|_, _| between(-2.0, 2.0));
    let at_m = Vector3::from_fn(|_, _| between(-0.1, 0.1));
    let rotation = UnitQuaternion::from_scaled_axis(axis);
    // A cylinder or capsule of `parry3d` lies along y, one of a URDF along z.
    let along_y = match shape {
        Shape::Cylinder { .. } | Shape::Capsule { .. } => {
            UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2)
        }
        _ => UnitQuaternion::identity(),
    };
    let q = rotation * along_y;
    Placed {
        world_from_shape: spatial::Pose::from_parts(at_m, rotation),
        shape,
        parry_pose: Pose::from_parts(
            Vector::new(single(at_m.x), single(at_m.y), single(at_m.z)),
            Rot3::from_xyzw(single(q.i), single(q.j), single(q.k), single(q.w)),
        ),
        parry,
    }
}

/// The CPU time of the fastest round, in microseconds a pair.
fn fastest_us(pairs: &[[Placed; 2]], distance: impl Fn(&[Placed; 2]) -> f64) -> f64 {
    let rounds = (0..ROUNDS).map(|_| {
        let start_s = cpu_time::thread_s();
        for pair in pairs {
            black_box(distance(pair));
        }
        cpu_time::thread_s() - start_s
    });
    1e6 * rounds.fold(f64::INFINITY, f64::min) / pairs.len() as f64
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "`parry3d` computes in single precision"
)]
fn single(number: f64) -> f32 {
    number as f32
}
