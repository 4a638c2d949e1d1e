//! Settled orientation of an object: the recorded one, corrected for the camera's error.

use nalgebra::{Point3, Unit, Vector3};
use spatial::RestingPose;

/// Largest tilt that is taken for an error of measurement, in radians: 15 degrees. What is recorded
/// farther from any stable orientation was leaning on something, and is left as it is.
const MAX_TILT_RAD: f64 = 0.26;
/// First step of the descent, in radians: 0.4 degrees, below the angle between a can's facets.
const FIRST_STEP_RAD: f64 = 0.007;
/// Each step relative to the one before: all together reach 40 degrees, on a way that zigzags.
const SHRINK: f64 = 0.99;
/// Number of steps: the last one is 10 µrad.
const STEPS: i32 = 650;

/// Returns the stable orientation into which an object tips from the recorded one, with its lowest
/// point on the table; the recorded one, if that is farther than errors of the recording explain.
///
/// The vertices of the object's hull and its center of mass are in its own frame, in meters.
///
/// A body at rest has come down as far as it can: the height of its center of mass over the lowest
/// vertex is smallest. From the recorded orientation this follows the way down, by subgradients
/// with geometrically shrinking steps (Shor, *Minimization Methods for Non-Differentiable Functions*,
/// 1985, §2.3).
pub fn settled(
    hull_in_object: &[Point3<f64>],
    center_of_mass_in_object: &Point3<f64>,
    recorded: &RestingPose,
) -> RestingPose {
    let mut up = recorded.up_in_object;
    for step in 0..STEPS {
        let step_rad = FIRST_STEP_RAD * SHRINK.powi(step);
        let Some(arm) = lowest(hull_in_object, &up).map(|vertex| vertex - center_of_mass_in_object)
        else {
            break;
        };
        let level = arm - up.into_inner() * up.dot(&arm);
        let Some(way) = level.try_normalize(1e-9) else {
            break;
        };
        // The center of mass tips away from the vertex it stands on.
        up = Unit::new_normalize(up.into_inner() + way * step_rad);
    }
    if up.angle(&recorded.up_in_object) > MAX_TILT_RAD {
        up = recorded.up_in_object;
    }
    RestingPose {
        up_in_object: up,
        height_m: lowest(hull_in_object, &up)
            .map_or(recorded.height_m, |vertex| -up.dot(&vertex.coords)),
    }
}

/// Returns the vertex that would touch the table.
fn lowest<'a>(vertices: &'a [Point3<f64>], up: &Vector3<f64>) -> Option<&'a Point3<f64>> {
    vertices
        .iter()
        .min_by(|a, b| up.dot(&a.coords).total_cmp(&up.dot(&b.coords)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    /// Settles the box from an orientation tilted about x and y.
    fn settle(about_x: f64, about_y: f64) -> RestingPose {
        let vertices = fixture::mesh().vertices_m;
        let recorded = RestingPose {
            up_in_object: Unit::new_normalize(Vector3::new(-about_y, about_x, 1.0)),
            height_m: 0.06,
        };
        settled(&vertices, &Point3::new(0.0, 0.0, -0.01), &recorded)
    }

    #[test]
    fn a_tilted_box_settles_on_its_face() {
        for (x, y) in [(0.0, 0.0), (0.1, 0.0), (-0.05, 0.1), (0.12, -0.12)] {
            let rest = settle(x, y);
            assert!(
                rest.up_in_object.angle(&Vector3::z_axis()) < 1e-3,
                "{rest:?}"
            );
            assert!(
                (rest.height_m - fixture::BOX_HALF_M[2]).abs() < 1e-4,
                "{rest:?}"
            );
        }
    }

    #[test]
    fn a_leaning_box_is_left_leaning() {
        let rest = settle(0.0, 0.4);
        let up = Unit::new_normalize(Vector3::new(-0.4, 0.0, 1.0));
        assert!(rest.up_in_object.angle(&up) < 1e-9, "{rest:?}");
    }
}
