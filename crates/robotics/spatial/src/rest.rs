//! Resting pose of an object on a table.

use nalgebra::{Unit, UnitQuaternion, Vector3};

use crate::{Object, Pose, Table};

/// An object at rest on a table, without its yaw and position, which do not matter to gravity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RestingPose {
    /// Unit vector against gravity, in the object frame.
    pub up_in_object: Unit<Vector3<f64>>,
    /// Height of the object's origin above the table, in meters.
    pub height_m: f64,
}

impl RestingPose {
    /// Returns the resting pose of an object, without its yaw and position.
    pub fn of(table_from_object: &Pose<Table, Object>) -> Self {
        Self {
            up_in_object: table_from_object
                .rotation
                .inverse_transform_unit_vector(&Vector3::z_axis()),
            height_m: table_from_object.translation.z,
        }
    }

    /// Returns the one of these whose up direction is nearest to this one's, with its number; of equals the last.
    pub fn nearest(&self, rests: impl IntoIterator<Item = Self>) -> Option<(usize, Self)> {
        let agreement = |rest: &Self| rest.up_in_object.dot(&self.up_in_object);
        let rests = rests.into_iter().enumerate();
        rests.max_by(|(_, a), (_, b)| agreement(a).total_cmp(&agreement(b)))
    }

    /// Returns the pose of the object in the table's frame: the shortest rotation that takes
    /// `up_in_object` to +z (half a turn about x where the object lies upside down).
    pub fn table_from_object(&self) -> Pose<Table, Object> {
        let rotation = UnitQuaternion::rotation_between(&self.up_in_object, &Vector3::z())
            .unwrap_or_else(|| {
                UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI)
            });
        Pose::from_parts([0.0, 0.0, self.height_m], rotation)
    }
}
