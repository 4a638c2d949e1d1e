//! The object and the table that the hand must keep out of.

use std::sync::Arc;

use geometry::DistanceField;
use nalgebra::{Point3, Vector3};
use robot::Surroundings;
use spatial::RestingPose;

/// An object that lies on a table, in the object frame, or nothing at all.
pub struct Environment {
    field: Option<Arc<DistanceField>>,
    rest: RestingPose,
}

/// Signed distance of a point from the object, with its gradient.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SignedDistance {
    /// Signed distance in meters, negative inside.
    pub distance_m: f64,
    /// Its gradient in the object frame, about of length 1.
    pub gradient_in_object: Vector3<f64>,
}

impl Environment {
    /// Puts an object down.
    pub fn new(field: impl Into<Arc<DistanceField>>, rest: RestingPose) -> Self {
        let field = Some(field.into());
        Self { field, rest }
    }

    /// Returns the environment of a hand in the air: object and table are infinitely far away.
    pub fn empty() -> Self {
        let rest = RestingPose {
            up_in_object: Vector3::z_axis(),
            height_m: f64::INFINITY,
        };
        Self { field: None, rest }
    }

    /// Returns the object's resting pose.
    pub fn rest(&self) -> RestingPose {
        self.rest
    }

    /// Returns the signed distance of a point from the object's surface.
    #[inline]
    pub fn signed_distance(&self, point_in_object: &Point3<f64>) -> SignedDistance {
        let Some(field) = &self.field else {
            return SignedDistance {
                distance_m: f64::INFINITY,
                gradient_in_object: Vector3::zeros(),
            };
        };
        let (distance_m, gradient_in_object) = field.distance(point_in_object);
        SignedDistance {
            distance_m,
            gradient_in_object,
        }
    }

    /// Returns a point's height above the table, in meters.
    pub fn height_m(&self, point_in_object: &Point3<f64>) -> f64 {
        self.rest.up_in_object.dot(&point_in_object.coords) + self.rest.height_m
    }

    /// Returns the unit vector against gravity.
    pub fn up_in_object(&self) -> Vector3<f64> {
        self.rest.up_in_object.into_inner()
    }
}

impl Surroundings for Environment {
    fn object_m(&self, point_in_object: &Point3<f64>) -> f64 {
        self.signed_distance(point_in_object).distance_m
    }

    fn object_gradient(&self, point_in_object: &Point3<f64>) -> Vector3<f64> {
        self.signed_distance(point_in_object).gradient_in_object
    }

    fn table_m(&self, point_in_object: &Point3<f64>) -> f64 {
        self.height_m(point_in_object)
    }

    fn table_gradient(&self) -> Vector3<f64> {
        self.up_in_object()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    #[test]
    fn gaps_of_a_box_are_signed() {
        let environment = fixture::environment();
        let [x, _, _] = fixture::BOX_HALF_M;
        for (at, distance_m) in [(x + 0.02, 0.02), (x - 0.01, -0.01)] {
            let gap = environment.signed_distance(&Point3::new(at, 0.0, 0.0));
            assert!((gap.distance_m - distance_m).abs() < 1e-6, "{gap:?}");
            assert!(
                (gap.gradient_in_object - Vector3::x()).norm() < 1e-3,
                "{gap:?}"
            );
        }
    }
}
