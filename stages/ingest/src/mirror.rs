//! The left hand as a right one: the mirror image of a demonstration in its object's own mirror plane.
//!
//! A mirrored world obeys the same mechanics. Where the object is its own mirror image, what the
//! other hand would have done with it is the reflection of what this hand did.

use geometry::MirrorPlane;
use nalgebra::{Point3, Unit};
use schemas::{
    demonstrations::{Demonstration, Side},
    objects::Object,
};

/// Returns the plane in which an object is mirrored, or why it is not.
pub(crate) fn plane(shape: Option<&Object>, max_error_m: f64) -> Result<MirrorPlane, String> {
    let shape = shape.ok_or("the object's shape is not known")?;
    let plane = shape
        .mirror
        .ok_or_else(|| format!("`{}` has no mirror plane", shape.name))?;
    if plane.error_m > max_error_m {
        return Err(format!(
            "`{}` is {:.1} mm from its mirror image, more than `max_mirror_error_m`",
            shape.name,
            1000.0 * plane.error_m
        ));
    }
    Ok(MirrorPlane {
        normal: plane.normal,
        offset_m: plane.offset_m,
        error_m: plane.error_m,
    })
}

/// Mirrors the landmarks and the resting orientation, all in the object frame: they are then those of
/// this hand.
pub(crate) fn mirror(demonstration: &mut Demonstration, plane: &MirrorPlane, hand: Side) {
    for step in &mut demonstration.steps {
        for point in &mut step.keypoints_m {
            *point = plane.reflect_point(&Point3::from(*point)).into();
        }
    }
    let rest = &mut demonstration.rest;
    // The object's origin, mirrored, is `2 · offset · normal`: as much higher or lower it ends up.
    rest.height_m += 2.0 * plane.offset_m * rest.up_in_object.dot(&plane.normal);
    let up = plane.reflect_direction(&rest.up_in_object);
    rest.up_in_object = Unit::new_normalize(up);
    demonstration.mirrored = true;
    demonstration.hand = hand;
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use schemas::demonstrations::{KEYPOINTS, Step};
    use spatial::RestingPose;

    use super::*;

    fn demonstration() -> Demonstration {
        Demonstration {
            sequence: "a-b".to_owned(),
            object: "025_mug".to_owned(),
            subject: "a".to_owned(),
            hand: Side::Left,
            mirrored: false,
            start_reason: String::new(),
            end_reason: String::new(),
            rest: RestingPose {
                up_in_object: Unit::new_normalize(Vector3::new(0.6, 0.0, 0.8)),
                height_m: 0.04,
            },
            steps: vec![Step {
                image: 0,
                time_s: 0.0,
                cameras_n: 1,
                bridged: false,
                keypoints_m: [[0.10, 0.02, 0.05]; KEYPOINTS],
            }],
        }
    }

    #[test]
    fn every_landmark_keeps_its_height_above_the_table() {
        let plane = MirrorPlane {
            normal: Unit::new_normalize(Vector3::new(1.0, 2.0, -0.5)),
            offset_m: 0.013,
            error_m: 0.0,
        };
        let before = demonstration();
        let mut after = before.clone();
        mirror(&mut after, &plane, Side::Right);
        let height = |d: &Demonstration| {
            let point = Point3::from(d.steps[0].keypoints_m[0]);
            (d.rest.table_from_object() * point).z
        };
        assert!((height(&before) - height(&after)).abs() < 1e-12);
        assert!(after.mirrored && after.hand == Side::Right);
        mirror(&mut after, &plane, Side::Left);
        let back = after.steps[0].keypoints_m[0];
        let error: f64 = (Point3::from(back) - Point3::from(before.steps[0].keypoints_m[0])).norm();
        assert!(error < 1e-12);
        assert!((after.rest.height_m - before.rest.height_m).abs() < 1e-12);
    }

    #[test]
    fn a_plane_through_the_origin_swaps_a_side() {
        let plane = MirrorPlane {
            normal: Vector3::y_axis(),
            offset_m: 0.0,
            error_m: 0.0,
        };
        let mut after = demonstration();
        mirror(&mut after, &plane, Side::Right);
        assert_eq!(after.steps[0].keypoints_m[5], [0.10, -0.02, 0.05]);
    }
}
