//! A cloud of points as the depth image of a camera at the place from which it was seen.

use depth_view::{DepthView, Intrinsics, looking_at};
use nalgebra::{Isometry3, Point3, UnitQuaternion, UnitVector3, Vector3};
use spatial::{Camera, Pose, World};

use crate::{error::Fault, object};

/// Depth of the number 1 in stored images, in meters.
pub(crate) const DEPTH_STEP_M: f64 = 1e-4;
/// Least number of points.
const LEAST_POINTS: usize = 200;
/// Range of distances that a depth camera measures, in meters.
const DISTANCES_M: [f64; 2] = [0.01, 100.0];
/// A table with an object is wider than this about its middle, in meters.
const LEAST_WIDTH_M: f64 = 0.01;
/// Cosine of the greatest angle between a point and the middle of the image: 60 degrees, half the view of a wide camera.
const LEAST_COSINE: f64 = 0.5;
/// Largest share of the points beyond that angle.
const BEYOND_SHARE: f64 = 0.01;
/// Points of a cell in which they are counted, if they fill the image evenly.
const CELL_POINTS: f64 = 64.0;
/// Most cells along a side.
const MAX_CELLS: f64 = 1024.0;
/// Pixels from a point to the next: more keep the outline, whose outermost pixels count for nothing later, and leave more
/// pixels to be filled. Shapes of clouds are nearest to the true ones from 1.2 to 1.4.
const PIXELS_APART: f64 = 1.3;
/// Most pixels along a side.
const MAX_SIDE: f64 = 4096.0;
/// Empty pixels about the points, so that no surface ends at the border.
const MARGIN: usize = 3;
/// Neighboring pixels of one surface differ by at most this in depth, in meters.
const JUMP_M: f64 = 0.015;
/// Passes that close holes, each pixel between two of a surface: points leave half of the pixels empty, and where they are
/// spread at random, this many passes leave a twentieth. No pass closes a straight gap of two pixels.
const CLOSING_PASSES: usize = 4;

/// Returns the points in meters, without those that were not measured: three numbers that are not finite, or all 0.
pub(crate) fn measured(points: &[[f64; 3]], unit_m: f64) -> Result<Vec<Point3<f64>>, Fault> {
    let mut measured = Vec::new();
    for (idx, point) in points.iter().enumerate() {
        let point = Point3::from(*point);
        match point.iter().filter(|number| number.is_finite()).count() {
            3 if point.coords.amax() > 0.0 => measured.push(point * unit_m),
            0 | 3 => {}
            _ => {
                return Err(Fault::new(
                    format!("point {idx} has numbers that are finite, and others that are not"),
                    "write a point that was not measured as three NaN, or leave it out",
                ));
            }
        }
    }
    enough(&measured)?;
    Ok(measured)
}

fn enough<T>(points: &[T]) -> Result<(), Fault> {
    if points.len() < LEAST_POINTS {
        return Err(Fault::new(
            format!(
                "{} points, at least {LEAST_POINTS} are needed",
                points.len()
            ),
            "points at the origin, and of numbers that are not finite, are none",
        ));
    }
    Ok(())
}

/// Returns the depth image that a camera at this place sees of a cloud in meters, its pixels a little narrower than
/// neighboring points are apart; `unit_m` is the cloud's unit, for messages. The world is the cloud's frame.
pub(crate) fn depth_image(
    points: &[Point3<f64>],
    camera_in_world: &Point3<f64>,
    unit_m: f64,
) -> Result<DepthView, Fault> {
    let off: Vec<Vector3<f64>> = points.iter().map(|point| point - camera_in_world).collect();
    object::check_unit(off.iter().map(Vector3::norm), "unit_m", unit_m)?;
    let range = DISTANCES_M[0]..=DISTANCES_M[1];
    let off: Vec<Vector3<f64>> = off
        .into_iter()
        .filter(|off| range.contains(&off.norm()))
        .collect();
    enough(&off)?;
    let middle = off.iter().sum::<Vector3<f64>>() / off.len() as f64;
    let mut width_m: Vec<f64> = off.iter().map(|off| (off - middle).norm()).collect();
    let width_m = object::quantile(&mut width_m, 0.5).unwrap_or(0.0);
    if width_m < LEAST_WIDTH_M {
        return Err(Fault::new(
            format!("half of the points are within {width_m:.4} m of their middle"),
            "set `unit_m` to the meters of the cloud's unit, e.g. 1.0",
        ));
    }
    let directions: Vector3<f64> = off.iter().map(Vector3::normalize).sum();
    let forward = UnitVector3::try_new(directions, 1e-3);
    let forward = forward.ok_or_else(|| around(1.0))?;
    let world_from_camera = facing(camera_in_world, &forward);
    let is_within = |off: &&Vector3<f64>| forward.dot(off) > LEAST_COSINE * off.norm();
    let in_camera = off.iter().filter(is_within);
    let in_camera: Vec<Vector3<f64>> = in_camera
        .map(|off| world_from_camera.rotation.inverse() * off)
        .collect();
    let beyond = 1.0 - in_camera.len() as f64 / off.len() as f64;
    if beyond > BEYOND_SHARE {
        return Err(around(beyond));
    }
    // Where a ray meets the plane at a depth of 1.
    let slopes: Vec<[f64; 2]> = in_camera
        .iter()
        .map(|at| [at.x / at.z, at.y / at.z])
        .collect();
    let intrinsics = intrinsics(&slopes);
    let mut depth_m = vec![0.0; intrinsics.pixels_n()];
    for point in in_camera {
        let at = intrinsics.project(&point.into());
        let Some(pixel) = at.and_then(|at| intrinsics.pixel(at)) else {
            continue;
        };
        if depth_m[pixel] <= 0.0 || point.z < depth_m[pixel] {
            depth_m[pixel] = point.z;
        }
    }
    close(&mut depth_m, intrinsics.width);
    Ok(DepthView {
        intrinsics,
        world_from_camera,
        mask: vec![false; depth_m.len()],
        depth_m,
    })
}

fn around(beyond: f64) -> Fault {
    let percent = 100.0 * beyond;
    Fault::new(
        format!(
            "the points are around the camera: {percent:.0} % are 60 degrees or more off its view"
        ),
        "set `camera_m` to the camera's place in the cloud's frame",
    )
}

/// Returns the pose of a camera that looks in a direction. If the frame looks there too, as a camera's does, its image is
/// upright in the frame's x and y, and else in its z.
fn facing(camera: &Point3<f64>, forward: &UnitVector3<f64>) -> Pose<World, Camera> {
    let z = Vector3::z();
    let turn = UnitQuaternion::rotation_between(&z, forward);
    match turn.filter(|_| forward.z > 0.5) {
        Some(turn) => Pose::new(Isometry3::from_parts(camera.coords.into(), turn)),
        None => looking_at(*camera, camera + forward.into_inner()),
    }
}

/// Returns the intrinsics of an image that holds these slopes of rays, about one in two pixels.
fn intrinsics(slopes: &[[f64; 2]]) -> Intrinsics {
    let ends = [0, 1].map(|axis| {
        let along = slopes.iter().map(|slope| slope[axis]);
        along.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], at| {
            [low.min(at), high.max(at)]
        })
    });
    let extents = ends.map(|[low, high]| high - low);
    let longest = extents[0].max(extents[1]).max(1e-6);
    let most = MAX_SIDE - 2.0 * MARGIN as f64 - 1.0;
    let focal = (PIXELS_APART / spacing(slopes, ends, longest)).min(most / longest);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "sides of an image, bounded by the focal length"
    )]
    let [width, height] = extents.map(|extent| (extent * focal).ceil() as usize + 1 + 2 * MARGIN);
    Intrinsics {
        width,
        height,
        focal: [focal; 2],
        center: ends.map(|[low, _]| MARGIN as f64 - low * focal),
    }
}

/// Returns the median distance of neighboring slopes: where their number in a square cell is the median over all of them.
fn spacing(slopes: &[[f64; 2]], ends: [[f64; 2]; 2], longest: f64) -> f64 {
    let area: f64 = ends.iter().map(|[low, high]| high - low).product();
    let cell = (area * CELL_POINTS / slopes.len() as f64).sqrt();
    let cell = cell.max(longest / MAX_CELLS);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "cells of a side, at most a thousand"
    )]
    let cell_of = |axis: usize, at: f64| ((at - ends[axis][0]) / cell) as usize;
    let columns = cell_of(0, ends[0][1]) + 1;
    let mut counts = vec![0_u32; columns * (cell_of(1, ends[1][1]) + 1)];
    let cells = slopes
        .iter()
        .map(|&[x, y]| cell_of(1, y) * columns + cell_of(0, x));
    let cells: Vec<usize> = cells.collect();
    for &cell in &cells {
        counts[cell] += 1;
    }
    let mut counts: Vec<f64> = cells.iter().map(|&cell| f64::from(counts[cell])).collect();
    cell / object::quantile(&mut counts, 0.5).unwrap_or(1.0).sqrt()
}

/// Fills the pixels between two of one surface which are empty, or which show something behind it: between the points of a
/// surface a camera sees the surface. The outermost pixels stay empty.
fn close(depth_m: &mut [f64], width: usize) {
    // The pixels about one in pairs, each on opposite sides.
    let steps = [1, width - 1, width, width + 1];
    for _ in 0..CLOSING_PASSES {
        let before = depth_m.to_vec();
        for pixel in width + 1..before.len().saturating_sub(width + 1) {
            let own_m = before[pixel];
            let pairs = steps.map(|step| [before[pixel - step], before[pixel + step]]);
            let is_before = |a: f64| a > 0.0 && (own_m <= 0.0 || a < own_m - JUMP_M);
            let jump_m = |[a, b]: &[f64; 2]| (a - b).abs();
            let nearest = pairs
                .into_iter()
                .filter(|&[a, b]| is_before(a) && is_before(b) && jump_m(&[a, b]) < JUMP_M)
                .min_by(|one, other| jump_m(one).total_cmp(&jump_m(other)));
            if let Some([a, b]) = nearest {
                // Inverse depths of a plane are linear in the image.
                depth_m[pixel] = 2.0 * a * b / (a + b);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// A grid of points on a plane of this depth before a camera at the origin.
    fn grid(step: f64, depth_m: f64) -> Vec<Point3<f64>> {
        let at = |k: usize| (k as f64 - 49.5) * step * depth_m;
        (0..100 * 80)
            .map(|k| Point3::new(at(k % 100), at(k / 100), depth_m))
            .collect()
    }

    /// Share of the pixels of each row, from the first to the last with a depth, that have one.
    fn filled(view: &DepthView) -> f64 {
        let (mut filled_n, mut pixels_n) = (0, 0);
        for row in view.depth_m.chunks(view.intrinsics.width) {
            let filled: Vec<usize> = (0..row.len()).filter(|&idx| row[idx] > 0.0).collect();
            filled_n += filled.len();
            pixels_n += filled.last().map_or(0, |last| last - filled[0] + 1);
        }
        filled_n as f64 / pixels_n as f64
    }

    #[test]
    fn pixels_follow_from_the_spacing_of_points_and_surfaces_are_closed() {
        let origin = Point3::origin();
        let view = depth_image(&grid(0.002, 0.6), &origin, 1.0).unwrap();
        let focal = PIXELS_APART / 0.002;
        assert!((view.intrinsics.focal[0] / focal - 1.0).abs() < 0.05);
        assert!(filled(&view) > 0.999, "{}", filled(&view));
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let scattered = (0..20_000).map(|_| {
            let at = [0; 2].map(|_| random.random_range(-0.1..0.1));
            Point3::new(at[0], at[1], 0.6 + 0.5 * at[0])
        });
        let view = depth_image(&scattered.collect::<Vec<_>>(), &origin, 1.0).unwrap();
        assert!(filled(&view) > 0.95, "{}", filled(&view));
        for (pixel, &depth_m) in view.depth_m.iter().enumerate() {
            if depth_m > 0.0 {
                let at = view.world_from_camera * view.point_in_camera(pixel).unwrap();
                assert!((at.z - 0.6 - 0.5 * at.x).abs() < 0.001);
            }
        }
    }

    #[test]
    fn a_farther_surface_is_not_seen_through_a_nearer_one() {
        let far = grid(0.0019, 0.8);
        let view = depth_image(&[grid(0.002, 0.6), far].concat(), &Point3::origin(), 1.0).unwrap();
        let nearer = view
            .depth_m
            .iter()
            .filter(|&&depth_m| depth_m > 0.7)
            .count();
        assert!(nearer < view.depth_m.len() / 200, "{nearer}");
    }

    #[test]
    fn the_image_of_a_camera_is_upright() {
        let view = depth_image(&grid(0.002, 0.6), &Point3::origin(), 1.0).unwrap();
        assert!(view.world_from_camera.rotation.angle() < 0.05);
        let from_above = grid(0.002, 0.6)
            .into_iter()
            .map(|p| Point3::new(p.x, p.y, -p.z));
        let eye = Point3::new(0.0, 0.2, 0.0);
        let view = depth_image(&from_above.collect::<Vec<_>>(), &eye, 1.0).unwrap();
        assert!((view.world_from_camera.rotation * Vector3::z()).z < -0.9);
        assert_eq!(view.world_from_camera.translation.vector, eye.coords);
    }

    #[test]
    fn says_what_is_wrong_with_other_clouds() {
        let check = |points: Vec<Point3<f64>>, camera: [f64; 3], expected: &str| {
            let said = depth_image(&points, &camera.into(), 1.0)
                .unwrap_err()
                .reason();
            assert!(said.contains(expected), "{expected}: {said}");
        };
        let scaled = |by: f64| grid(0.002, 0.6).into_iter().map(|p| p * by).collect();
        check(
            scaled(1000.0),
            [0.0; 3],
            "`unit_m` of 0.001 would be plausible",
        );
        check(scaled(0.01), [0.0; 3], "`unit_m` of 100 would be plausible");
        check(scaled(1.0), [0.0, 0.0, 0.599], "`unit_m` of");
        let around: Vec<Point3<f64>> = (0..1000)
            .map(|k| Point3::new(f64::from(k).cos(), f64::from(k).sin(), 0.1))
            .collect();
        check(around, [0.0; 3], "around the camera");
        check(scaled(1e300), [0.0; 3], "`unit_m` of");
        check(
            vec![Point3::new(0.1, 0.2, 0.5); 150],
            [0.0; 3],
            "150 points",
        );
        // On one line: no surface, but no panic either.
        check(
            vec![Point3::new(0.1, 0.2, 0.5); 250],
            [0.0; 3],
            "within 0.0000 m of",
        );
        for step in [[1e-4, 0.0], [0.0, 1e-4], [1e-300, 1e-4], [1e-4, 1e-4]] {
            let at = |k: i32| Point3::new(step[0], step[1], 0.0) * f64::from(k) + Vector3::z();
            let view = depth_image(
                &(0..1000).map(at).collect::<Vec<_>>(),
                &Point3::origin(),
                1.0,
            );
            assert!(view.unwrap().depth_m.len() < 1 << 17);
        }
    }

    #[test]
    fn points_that_were_not_measured_are_left_out() {
        let mut points = vec![[100.0, 200.0, 500.0]; 300];
        points[0] = [f64::NAN; 3];
        points[1] = [0.0; 3];
        points[2] = [f64::INFINITY; 3];
        let found = measured(&points, 0.001).unwrap();
        assert_eq!(found, vec![Point3::new(0.1, 0.2, 0.5); 297]);
        points[7][1] = f64::NAN;
        let said = measured(&points, 1.0).unwrap_err().to_string();
        assert!(said.contains("point 7 "), "{said}");
        let said = measured(&[[f64::NAN; 3]; 500], 1.0)
            .unwrap_err()
            .to_string();
        assert!(said.contains("0 points"), "{said}");
    }
}
