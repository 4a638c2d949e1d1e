//! How far a shape reaches from its center.

use nalgebra::Vector3;

use crate::Shape;

impl Shape {
    /// Returns how far the shape reaches from its center along a direction of unit length in its own
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
}

#[cfg(test)]
mod tests {
    use super::*;

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
