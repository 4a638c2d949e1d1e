//! Resting orientations of an object: those seen in the demonstrations first, then those that are
//! stable by its shape.

use nalgebra::{Unit, Vector3};
use schemas::objects::{Object, RestingOrientation};
use spatial::RestingPose;

/// Orientations closer than this are merged: 20 degrees, in radians.
const SAME_RAD: f64 = 20.0 * std::f64::consts::PI / 180.0;
/// An observed orientation matches a stable one within this: 10 degrees, in radians. Tables and tags
/// are measured to a few degrees.
const SNAP_RAD: f64 = 10.0 * std::f64::consts::PI / 180.0;
/// Stable orientations less probable than this are left out unless they were seen.
const MIN_PROBABILITY: f64 = 0.02;

/// Returns the resting orientations, most often seen first, then most probable first.
///
/// `seen` holds the up direction of each demonstration, in the object frame; `object` has the
/// orientations in which it is stable. Heights always follow from the mesh.
pub fn rests(object: &Object, seen: &[Unit<Vector3<f64>>]) -> Vec<RestingOrientation> {
    let stable = &object.rests;
    let mut found: Vec<RestingOrientation> = Vec::new();
    for (up, seen_n) in clusters(seen) {
        let nearest = stable
            .iter()
            .map(|stable| (stable.rest.up_in_object.angle(&up), stable))
            .min_by(|(a, _), (b, _)| a.total_cmp(b))
            .filter(|&(angle, _)| angle <= SNAP_RAD);
        let (up, probability) = nearest.map_or((up, 0.0), |(_, stable)| {
            (stable.rest.up_in_object, stable.probability)
        });
        // Two groups of demonstrations may mean the same stable orientation.
        if let Some(same) = found.iter_mut().find(|other| other.rest.up_in_object == up) {
            same.seen_n += seen_n;
            continue;
        }
        found.push(RestingOrientation {
            rest: lying(object, up),
            seen_n,
            probability,
        });
    }
    let mut unseen: Vec<RestingOrientation> = stable
        .iter()
        .filter(|stable| stable.probability > MIN_PROBABILITY)
        .filter(|stable| {
            let up = stable.rest.up_in_object;
            found
                .iter()
                .all(|seen| seen.rest.up_in_object.angle(&up) > SNAP_RAD)
        })
        .map(|stable| RestingOrientation {
            rest: lying(object, stable.rest.up_in_object),
            seen_n: 0,
            probability: stable.probability,
        })
        .collect();
    found.sort_by_key(|rest| std::cmp::Reverse(rest.seen_n));
    unseen.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    found.append(&mut unseen);
    found
}

/// Groups directions: the one with the most others around it takes them, then the next.
fn clusters(directions: &[Unit<Vector3<f64>>]) -> Vec<(Unit<Vector3<f64>>, u32)> {
    let mut left = directions.to_vec();
    let mut found = Vec::new();
    while !left.is_empty() {
        let around = |center: &Unit<Vector3<f64>>| {
            left.iter()
                .filter(|other| center.angle(other) <= SAME_RAD)
                .count()
        };
        let mut best = (0, Vector3::z_axis());
        for center in &left {
            let count = around(center);
            if count > best.0 {
                best = (count, *center);
            }
        }
        let (_, center) = best;
        let (near, far): (Vec<_>, Vec<_>) = left
            .iter()
            .copied()
            .partition(|other| center.angle(other) <= SAME_RAD);
        if near.is_empty() {
            // Only directions that are not numbers are near to nothing, not even themselves.
            break;
        }
        let sum: Vector3<f64> = near.iter().map(|up| up.into_inner()).sum();
        let seen_n = u32::try_from(near.len()).unwrap_or(u32::MAX);
        found.push((Unit::new_normalize(sum), seen_n));
        left = far;
    }
    found
}

/// Returns the rest in which the mesh's lowest point touches the table.
fn lying(object: &Object, up_in_object: Unit<Vector3<f64>>) -> RestingPose {
    let lowest_m = object
        .vertices_m
        .iter()
        .map(|&vertex| Vector3::from(vertex).dot(&up_in_object))
        .fold(f64::INFINITY, f64::min);
    RestingPose {
        up_in_object,
        height_m: if lowest_m.is_finite() { -lowest_m } else { 0.0 },
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Rotation3};

    use super::*;
    use crate::{MeshedObject, ShapeOptions};

    /// A box of 4 × 6 × 20 cm about the origin, shifted up by 1 cm.
    fn brick() -> Object {
        let section = |z: f64| {
            [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
                .map(|(x, y)| Point3::new(0.02 * x, 0.03 * y, z))
                .to_vec()
        };
        let mesh = geometry::solid::loft(&[section(-0.09), section(0.11)]);
        let meshed = MeshedObject {
            name: "brick",
            mass_kg: 0.5,
            mesh: &mesh,
            options: &ShapeOptions {
                points_n: 10,
                max_convex_parts_n: 1,
                part_tolerance_m: 0.0,
            },
            seed: 0,
        };
        meshed.shape().unwrap()
    }

    fn tilted(up: Vector3<f64>, degrees: f64) -> Unit<Vector3<f64>> {
        let tilt = Rotation3::from_axis_angle(&Vector3::y_axis(), degrees.to_radians());
        Unit::new_normalize(tilt * up)
    }

    #[test]
    fn seen_orientations_come_first_and_snap_to_the_stable_ones() {
        let seen = [
            tilted(Vector3::y(), 3.0),
            tilted(Vector3::z(), 4.0),
            tilted(Vector3::z(), -3.0),
        ];
        let rests = rests(&brick(), &seen);
        let seen_n: Vec<u32> = rests.iter().map(|rest| rest.seen_n).collect();
        assert_eq!(&seen_n[..2], &[2, 1]);
        assert!(seen_n[2..].iter().all(|&n| n == 0));
        let upright = &rests[0].rest;
        assert!(upright.up_in_object.angle(&Vector3::z_axis()) < 1e-6);
        assert!(
            (upright.height_m - 0.09).abs() < 1e-9,
            "{}",
            upright.height_m
        );
        assert!(
            rests[2..]
                .windows(2)
                .all(|two| two[0].probability >= two[1].probability)
        );
    }

    #[test]
    fn an_orientation_that_is_not_stable_stays_as_it_was_seen() {
        let seen = [tilted(Vector3::z(), 30.0)];
        let rests = rests(&brick(), &seen);
        assert!(rests[0].rest.up_in_object.angle(&seen[0]) < 1e-9);
        assert!(rests[0].probability.abs() < 1e-12);
    }
}
