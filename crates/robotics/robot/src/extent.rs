//! Extent of a shape from its center.

use nalgebra::Vector3;
use spatial::Pose;

use crate::Shape;

impl Shape {
    /// Returns the extent of the shape from its center along a direction of unit length in its own
    /// frame, in meters: its support function (Ericson, *Real-Time Collision Detection*, 2005, §3.4).
    pub fn extent_m(&self, direction: &Vector3<f64>) -> f64 {
        match self {
            Self::Box { half_extents_m } => half_extents_m.dot(&direction.abs()),
            Self::Sphere { radius_m } => *radius_m,
            Self::Cylinder {
                radius_m,
                half_length_m,
            } => half_length_m * direction.z.abs() + radius_m * direction.xy().norm(),
            Self::Capsule {
                radius_m,
                half_length_m,
            } => half_length_m * direction.z.abs() + radius_m,
            Self::Convex(body) => body.farthest(direction).dot(direction),
        }
    }

    /// Returns the height of the shape's lowest point above the origin of a frame, in meters, along `up` of unit
    /// length in that frame.
    pub fn lowest_m<Frame>(
        &self,
        frame_from_shape: &Pose<Frame, Self>,
        up_in_frame: &Vector3<f64>,
    ) -> f64 {
        let down_in_shape = frame_from_shape.inverse() * -up_in_frame;
        let center_m = frame_from_shape.translation.vector.dot(up_in_frame);
        center_m - self.extent_m(&down_in_shape)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Point3};
    use proptest::prelude::*;

    use super::*;
    use crate::ConvexBody;

    proptest! {
        /// A wedge is as low as its lowest corner, which is not opposite its highest one.
        #[test]
        fn wedge_is_as_low_as_its_lowest_corner(
            turn in prop::array::uniform3(-3.0..3.0),
            place in prop::array::uniform3(-1.0..1.0),
            up in prop::array::uniform3(-1.0..1.0),
        ) {
            prop_assume!(Vector3::from(up).norm() > 0.1);
            let up = Vector3::from(up).normalize();
            let corners_m = [
                [0.02, -0.02, -0.02],
                [-0.02, 0.02, -0.02],
                [-0.02, -0.02, 0.02],
                [-0.02, -0.02, -0.02],
            ].map(Point3::from);
            let triangles = vec![[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]];
            let wedge = Shape::Convex(ConvexBody::new(corners_m.to_vec(), triangles).unwrap().into());
            let pose = Isometry3::new(Vector3::from(place), Vector3::from(turn));
            let heights = corners_m.iter().map(|corner| (pose * corner).coords.dot(&up));
            let lowest_m = heights.fold(f64::INFINITY, f64::min);
            let found = wedge.lowest_m(&Pose::<(), Shape>::new(pose), &up);
            prop_assert!((found - lowest_m).abs() < 1e-12, "{found} m, not {lowest_m} m");
        }
    }

    #[test]
    fn shapes_reach_their_farthest_corner() {
        let up = Vector3::new(0.6, 0.0, 0.8);
        let near = |shape: Shape, expected: f64| {
            let found = shape.extent_m(&up);
            assert!((found - expected).abs() < 1e-12, "{shape:?}: {found}");
        };
        let half_extents_m = Vector3::new(0.1, 5.0, 0.2);
        near(Shape::Box { half_extents_m }, 0.06 + 0.16);
        near(Shape::Sphere { radius_m: 0.3 }, 0.3);
        let (radius_m, half_length_m) = (0.1, 0.2);
        let cylinder = Shape::Cylinder {
            radius_m,
            half_length_m,
        };
        near(cylinder, 0.16 + 0.06);
        let capsule = Shape::Capsule {
            radius_m,
            half_length_m,
        };
        near(capsule, 0.16 + 0.1);
    }
}
