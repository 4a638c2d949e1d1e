//! Gaps of two shapes against closed forms, and against a search over directions that knows nothing of corners.

use std::f64::consts::PI;

use nalgebra::{Unit, UnitQuaternion};
use proptest::prelude::*;
use spatial::World;

use super::*;
use crate::distance::tests::{pose, shape as shape_of_size};

const FAR_M: f64 = 10.0;

fn shape() -> impl Strategy<Value = Shape> {
    shape_of_size(0.005..0.03)
}

fn rounded_shape(link: usize, shape: &Shape) -> RoundedShape {
    let (core, radius_m) = rounded(shape);
    RoundedShape {
        link,
        link_from_shape: PlacedShape::of(&Pose::<Link, Shape>::identity()),
        reach_m: core.radius_m() + radius_m,
        core,
        radius_m,
    }
}

fn gap_of(a: (&Shape, &Pose<World, Shape>), b: (&Shape, &Pose<World, Shape>)) -> SelfGap {
    let [first, second] = [rounded_shape(0, a.0), rounded_shape(1, b.0)];
    let [at_a, at_b] = [a.1, b.1].map(PlacedShape::of);
    gap(
        (&first, &at_a),
        (&second, &at_b),
        FAR_M,
        &mut Vector3::zeros(),
    )
    .unwrap()
}

/// Returns a point's signed distance from a box about the origin.
fn from_box(half_m: Vector3<f64>, at: &Vector3<f64>) -> f64 {
    let off = at.abs() - half_m;
    off.map(|side| side.max(0.0)).norm() + off.max().min(0.0)
}

/// Returns a point's signed distance from the rounded shape, in closed form.
fn signed_distance(shape: &Shape, at: &Vector3<f64>) -> f64 {
    match shape {
        Shape::Sphere { radius_m } => at.norm() - radius_m,
        Shape::Box { half_extents_m } => {
            from_box(half_extents_m.add_scalar(-ROUNDING_M), at) - ROUNDING_M
        }
        Shape::Convex(body) => from_box(body.farthest(&Vector3::repeat(1.0)), at),
        Shape::Cylinder {
            radius_m,
            half_length_m,
        } => {
            let across = at.xy().norm() - (radius_m - ROUNDING_M);
            let along = at.z.abs() - (half_length_m - ROUNDING_M);
            across.max(0.0).hypot(along.max(0.0)) + across.max(along).min(0.0) - ROUNDING_M
        }
        Shape::Capsule {
            radius_m,
            half_length_m,
        } => {
            let z = at.z - at.z.clamp(-half_length_m, *half_length_m);
            Vector3::new(at.x, at.y, z).norm() - radius_m
        }
    }
}

/// Returns how far the rounded shape reaches along a unit vector of its frame, in closed form.
fn reach_m(shape: &Shape, way: &Vector3<f64>) -> f64 {
    match shape {
        Shape::Sphere { radius_m } => *radius_m,
        Shape::Box { half_extents_m } => {
            way.abs().dot(&half_extents_m.add_scalar(-ROUNDING_M)) + ROUNDING_M
        }
        Shape::Convex(body) => way.abs().dot(&body.farthest(&Vector3::repeat(1.0))),
        Shape::Cylinder {
            radius_m,
            half_length_m,
        } => {
            let across = (radius_m - ROUNDING_M) * way.xy().norm();
            across + (half_length_m - ROUNDING_M) * way.z.abs() + ROUNDING_M
        }
        Shape::Capsule {
            radius_m,
            half_length_m,
        } => radius_m + half_length_m * way.z.abs(),
    }
}

/// Returns how far two shapes are apart along a unit vector from the first to the second, in closed form.
fn gap_along(
    a: (&Shape, &Pose<World, Shape>),
    b: (&Shape, &Pose<World, Shape>),
    way: &Vector3<f64>,
) -> f64 {
    let offset = b.1.translation.vector - a.1.translation.vector;
    let reach = |(shape, pose): (&Shape, &Pose<World, Shape>)| {
        reach_m(shape, &pose.rotation.inverse_transform_vector(way))
    };
    way.dot(&offset) - reach(a) - reach(b)
}

/// Searches the direction along which two shapes are farthest apart, or least deep, and returns how much.
fn gap_by_directions(a: (&Shape, &Pose<World, Shape>), b: (&Shape, &Pose<World, Shape>)) -> f64 {
    let gap_along = |way: &Unit<Vector3<f64>>| gap_along(a, b, way);
    // A spiral over the sphere (Swinbank and Purser, *Fibonacci grids*, 2006).
    let n = 3000;
    let spiral = (0..n).map(|idx| {
        let z = 1.0 - (2.0 * f64::from(idx) + 1.0) / f64::from(n);
        let (sine, cosine) = (f64::from(idx) * 2.399_963_229_728_653).sin_cos();
        let across = (1.0 - z * z).sqrt();
        Unit::new_normalize(Vector3::new(across * cosine, across * sine, z))
    });
    let ways: Vec<_> = spiral.collect();
    let best = ways
        .iter()
        .max_by(|p, q| gap_along(p).total_cmp(&gap_along(q)));
    let (mut way, mut step) = (*best.unwrap(), 0.05);
    while step > 1e-7 {
        let near = ways.iter().step_by(37);
        let near = near.map(|by| Unit::new_normalize(way.into_inner() + by.into_inner() * step));
        let found = near
            .max_by(|p, q| gap_along(p).total_cmp(&gap_along(q)))
            .unwrap();
        if gap_along(&found) > gap_along(&way) {
            way = found;
        } else {
            step *= 0.5;
        }
    }
    gap_along(&way)
}

#[test]
fn gaps_of_primitives_have_closed_forms() {
    let at = |x: f64, y: f64, z: f64| Pose::from_parts([x, y, z], UnitQuaternion::identity());
    let turned = |x: f64, y: f64, z: f64| {
        let quarter = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI / 2.0);
        Pose::from_parts([x, y, z], quarter)
    };
    let ball = |radius_m: f64| Shape::Sphere { radius_m };
    let rod = Shape::Capsule {
        radius_m: 0.01,
        half_length_m: 0.03,
    };
    let cube = |half: f64| Shape::Box {
        half_extents_m: Vector3::repeat(half),
    };
    let check = |a: (&Shape, Pose<World, Shape>), b: (&Shape, Pose<World, Shape>), gap_m: f64| {
        let found = gap_of((a.0, &a.1), (b.0, &b.1));
        assert!((found.gap_m - gap_m).abs() < 1e-9, "{found:?}, not {gap_m}");
        assert!((found.normal.norm() - 1.0).abs() < 1e-9, "{found:?}");
    };
    let origin = || at(0.0, 0.0, 0.0);
    check(
        (&ball(0.01), origin()),
        (&ball(0.02), at(0.05, 0.0, 0.0)),
        0.02,
    );
    check(
        (&ball(0.01), origin()),
        (&ball(0.02), at(0.01, 0.0, 0.0)),
        -0.02,
    );
    // Two balls about one point are parted by any way as long as both radii.
    check((&ball(0.01), origin()), (&ball(0.02), origin()), -0.03);
    // Rods side by side, crossing, and crossing through each other's middle.
    check((&rod, origin()), (&rod, at(0.03, 0.0, 0.0)), 0.01);
    check((&rod, origin()), (&rod, turned(0.015, 0.0, 0.01)), -0.005);
    check((&rod, origin()), (&rod, turned(0.0, 0.0, 0.0)), -0.02);
    // A ball about a disk's axis: all ways to its wall are about as long, so that no number of corners is enough.
    let disk = Shape::Cylinder {
        radius_m: 0.01,
        half_length_m: 0.02,
    };
    for off_m in [0.0, 1e-7, 1e-5, 1e-4, 1e-3] {
        let point = ball(0.001);
        let found = gap_of((&disk, &origin()), (&point, &at(off_m, 0.0, 0.0)));
        let expected = off_m - 0.011;
        assert!(
            (found.gap_m - expected).abs() < 1e-7,
            "{found:?}, not {expected}"
        );
        let foot_m = signed_distance(&disk, &found.points[0].coords);
        assert!(foot_m.abs() < 1e-6, "{foot_m}: {found:?}");
    }
    // Cubes with their sides against each other, deeper than they are rounded, and about one center.
    check(
        (&cube(0.01), origin()),
        (&cube(0.01), at(0.03, 0.0, 0.0)),
        0.01,
    );
    check(
        (&cube(0.01), origin()),
        (&cube(0.01), at(0.0, 0.018, 0.001)),
        -0.002,
    );
    check(
        (&cube(0.01), origin()),
        (&cube(0.01), at(0.002, 0.001, 0.012)),
        -0.008,
    );
    check((&cube(0.01), origin()), (&cube(0.02), origin()), -0.03);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    /// A ball is as far or as deep as its center, and its nearest point lies on the other's surface.
    #[test]
    fn a_ball_is_as_far_or_deep_as_its_center(
        shape in shape(), a in pose(0.03), b in pose(0.03), radius_m in 0.001..0.02_f64,
    ) {
        let found = gap_of((&shape, &a), (&Shape::Sphere { radius_m }, &b));
        let center = a.inverse_transform_point(&b.translation.vector.into());
        let expected = signed_distance(&shape, &center.coords) - radius_m;
        prop_assert!((found.gap_m - expected).abs() < 1e-7, "{found:?}, not {expected}");
        let foot = a.inverse_transform_point(&found.points[0]);
        prop_assert!(signed_distance(&shape, &foot.coords).abs() < 1e-6, "{found:?}");
        let way = found.points[1] - found.points[0] - found.normal * found.gap_m;
        prop_assert!(way.norm() < 1e-9, "{found:?}");
    }

    /// No direction parts two shapes more, and along its normal the gap is what it says.
    #[test]
    fn a_gap_is_the_greatest_along_any_direction(
        one in shape(), two in shape(), a in pose(0.03), b in pose(0.03),
    ) {
        let found = gap_of((&one, &a), (&two, &b));
        let expected = gap_by_directions((&one, &a), (&two, &b));
        prop_assert!(found.gap_m >= expected - 1e-6, "{found:?}, not {expected}");
        let along_normal = gap_along((&one, &a), (&two, &b), &found.normal);
        prop_assert!((found.gap_m - along_normal).abs() < 1e-6, "{found:?}, not {along_normal}");
        // Both nearest points are where the surfaces are.
        for ((point, pose), shape) in found.points.iter().zip([a, b]).zip([&one, &two]) {
            let at = pose.inverse_transform_point(point);
            let off_m = signed_distance(shape, &at.coords);
            prop_assert!(off_m.abs() < 1e-5, "{off_m}: {found:?}");
        }
        // The way along the normal parts them, if they overlap.
        let way_m = 1e-6 - found.gap_m.min(0.0);
        let parted = Pose::from_parts(b.translation.vector + found.normal * way_m, b.rotation);
        let apart = gap_of((&one, &a), (&two, &parted)).gap_m;
        prop_assert!(apart > -1e-6, "{apart} after {found:?}");
    }

    /// It does not matter which of the two is named first.
    #[test]
    fn gaps_are_symmetric(one in shape(), two in shape(), a in pose(0.03), b in pose(0.03)) {
        let found = gap_of((&one, &a), (&two, &b));
        let other = gap_of((&two, &b), (&one, &a));
        prop_assert!((found.gap_m - other.gap_m).abs() < 1e-6, "{found:?} {other:?}");
    }

    /// The gap's rate is the velocity of the second point along the normal, less that of the first.
    #[test]
    fn the_gap_changes_as_its_points_move(
        one in shape(), two in shape(), a in pose(0.03), b in pose(0.03),
        along in prop::array::uniform3(-1.0..1.0_f64), turn in prop::array::uniform3(-1.0..1.0_f64),
    ) {
        const H: f64 = 1e-6;
        let found = gap_of((&one, &a), (&two, &b));
        let [along, turn] = [along, turn].map(Vector3::from);
        let gap_at = |by: f64| {
            let turned = UnitQuaternion::from_scaled_axis(turn * by);
            let moved = Pose::from_parts(
                b.translation.vector + along * by,
                turned * b.rotation,
            );
            gap_of((&one, &a), (&two, &moved)).gap_m
        };
        let arm = found.points[1].coords - b.translation.vector;
        let expected = found.normal.dot(&(along + turn.cross(&arm)));
        let [ahead, behind] = [gap_at(H) - found.gap_m, found.gap_m - gap_at(-H)].map(|way| way / H);
        // Where two ways out are equally short the rate has two values.
        prop_assume!((ahead - behind).abs() < 1e-3);
        prop_assert!((ahead + behind - 2.0 * expected).abs() < 4e-3, "{ahead} {behind}, not {expected}");
    }
}
