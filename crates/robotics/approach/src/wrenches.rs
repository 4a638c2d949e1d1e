//! Wrenches of a contact's friction cone.

use nalgebra::{Point3, Unit, Vector3, Vector6};

/// Point contact with friction, and the scale of its wrenches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactModel {
    /// Center of the torques, object frame, in meters.
    pub center_in_object: Point3<f64>,
    /// Characteristic length by which torques are divided, in meters.
    pub length_m: f64,
    /// Friction coefficient of the contacts.
    pub friction: f64,
    /// Number of edges of the linearized friction cone.
    pub edges: usize,
}

impl ContactModel {
    /// Returns the wrenches of a contact that presses with 1 along each edge of its linearized friction cone: force,
    /// and torque over the length, object frame. The axis that is farthest from `near`, the surface's outward normal
    /// or one like it, fixes the first edge.
    pub fn wrenches(
        &self,
        point_in_object: &Point3<f64>,
        normal_in_object: &Vector3<f64>,
        near: &Vector3<f64>,
    ) -> Vec<Vector6<f64>> {
        let axis = match near.abs().imin() {
            0 => Vector3::x(),
            1 => Vector3::y(),
            _ => Vector3::z(),
        };
        let normal = *normal_in_object;
        let side = Unit::new_normalize(axis - normal * axis.dot(&normal));
        let other = normal.cross(&side);
        let arm = point_in_object - self.center_in_object;
        let edge = |number: usize| {
            let angle = std::f64::consts::TAU * number as f64 / self.edges as f64;
            let along = *side * angle.cos() + other * angle.sin();
            let force = along * self.friction - normal;
            let torque = arm.cross(&force) / self.length_m;
            Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z)
        };
        (0..self.edges).map(edge).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_contact_presses_inward_within_its_cone() {
        let contact_model = ContactModel {
            center_in_object: Point3::new(0.0, 0.0, -0.2),
            length_m: 0.5,
            friction: 0.7,
            edges: 4,
        };
        let normal = Vector3::x();
        let found = contact_model.wrenches(&Point3::new(0.1, 0.0, 0.0), &normal, &normal);
        assert_eq!(found.len(), 4);
        let sum: Vector6<f64> = found.iter().sum::<Vector6<f64>>() / 4.0;
        // Straight in: force -x, torque (0.1, 0, 0.2) × (-1, 0, 0) = (0, -0.2, 0), over 0.5 m.
        let expected = Vector6::new(-1.0, 0.0, 0.0, 0.0, -0.4, 0.0);
        assert!((sum - expected).norm() < 1e-12, "{sum}");
        for wrench in found {
            let across = Vector3::new(0.0, wrench[1], wrench[2]).norm();
            assert!((across - 0.7).abs() < 1e-12);
        }
    }
}
