//! The images of a recording after the grasp, in which object and hand leave the rest pose together.
//!
//! They are not part of the demonstration, only of its recording, so that one can see whether the reach was
//! cut where it should be.

use geometry::MirrorPlane;
use nalgebra::{Point3, Rotation3, UnitQuaternion};
use schemas::demonstrations::KEYPOINTS;
use spatial::{Object, Pose};

use crate::{
    departure::Departure,
    recording::{Keypoints, Recording},
};

/// One image after the grasp.
pub(crate) struct ImageAfterGrasp {
    /// Seconds since the first step of the reach.
    pub(crate) time_s: f64,
    /// Pose of the object in its own frame as it rested.
    pub(crate) rest_from_object: Pose<Object, Object>,
    /// The landmarks in the frame of the object as it is now, where the hand is seen, in meters.
    pub(crate) keypoints_in_object: Option<[Point3<f64>; KEYPOINTS]>,
}

/// Returns the images after the one in which the object is last at rest, those in which the object is
/// seen; `n_steps` is how many steps the reach has.
pub(crate) fn after(
    recording: &Recording,
    departure: &Departure,
    n_steps: usize,
) -> Vec<ImageAfterGrasp> {
    let Some(last) = departure.last else {
        return Vec::new();
    };
    let rest_from_world = departure.world_from_object.inverse();
    let images = recording.images.iter().enumerate().skip(last + 1);
    images
        .filter_map(|(image, observation)| {
            let world_from_object = observation.world_from_object?;
            let object_from_world = world_from_object.inverse();
            let in_object = |hand: Keypoints| hand.map(|point| object_from_world * point);
            Some(ImageAfterGrasp {
                time_s: (n_steps - 1 + image - last) as f64 / recording.rate_hz(),
                rest_from_object: rest_from_world * world_from_object,
                keypoints_in_object: observation.keypoints_in_world.map(in_object),
            })
        })
        .collect()
}

impl ImageAfterGrasp {
    /// Mirrors everything in the object's mirror plane.
    pub(crate) fn mirror(&mut self, plane: &MirrorPlane) {
        if let Some(points) = &mut self.keypoints_in_object {
            *points = points.map(|point| plane.reflect_point(&point));
        }
        // M T M: what was moved is reflected, moved, and reflected again.
        let moved = self.rest_from_object;
        let image =
            |point: Point3<f64>| plane.reflect_point(&(moved * plane.reflect_point(&point)));
        let origin = image(Point3::origin());
        let axes = [
            Point3::new(1.0, 0.0, 0.0),
            Point3::new(0.0, 1.0, 0.0),
            Point3::new(0.0, 0.0, 1.0),
        ];
        let rotation = Rotation3::from_matrix_unchecked(nalgebra::Matrix3::from_columns(
            &axes.map(|axis| image(axis) - origin),
        ));
        self.rest_from_object =
            Pose::from_parts(origin, UnitQuaternion::from_rotation_matrix(&rotation));
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Unit, Vector3};

    use super::*;

    #[test]
    fn a_mirrored_lift_is_the_mirror_image_of_the_lift() {
        let plane = MirrorPlane {
            normal: Unit::new_normalize(Vector3::new(1.0, -2.0, 0.5)),
            offset_m: 0.02,
            error_m: 0.0,
        };
        let lift = Isometry3::new(Vector3::new(0.1, 0.0, 0.3), Vector3::new(0.2, -0.5, 1.0));
        let point = Point3::new(0.03, -0.01, 0.07);
        let mut after = ImageAfterGrasp {
            time_s: 0.0,
            rest_from_object: Pose::new(lift),
            keypoints_in_object: Some([point; KEYPOINTS]),
        };
        let before = lift * point;
        after.mirror(&plane);
        let mirrored = after.rest_from_object * after.keypoints_in_object.unwrap()[3];
        assert!((mirrored - plane.reflect_point(&before)).norm() < 1e-12);
    }
}
