//! Poses invert, compose and survive storage; rotations keep one sign.

use std::f64::consts::PI;

use nalgebra::{Isometry3, Unit, Vector3};
use proptest::prelude::*;
use spatial::{
    Object, Palm, Pose, RestingPose, Table, quaternion_xyzw, rot6d, rotation_from_rot6d, xyzw,
};

/// Any pose within `radius_m` of the origin.
fn pose(radius_m: f64) -> impl Strategy<Value = Isometry3<f64>> {
    let offset = prop::array::uniform3(-radius_m..radius_m);
    let axis_angle = prop::array::uniform3(-PI..PI);
    (offset, axis_angle).prop_map(|(t, r)| Isometry3::new(Vector3::from(t), Vector3::from(r)))
}

fn distance(a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
    (a.to_homogeneous() - b.to_homogeneous()).amax()
}

proptest! {
    /// There and back again is where we started, to a nanometer over a meter.
    #[test]
    fn pose_inverse_undoes_pose(isometry in pose(1.0)) {
        let object_from_palm = Pose::<Object, Palm>::new(isometry);
        let object_from_object = object_from_palm * object_from_palm.inverse();
        prop_assert!(distance(&object_from_object, &Isometry3::identity()) < 1e-9);
    }

    #[test]
    fn stored_pose_reads_back(isometry in pose(1.0)) {
        let numbers = Pose::<Object, Palm>::new(isometry).to_array();
        prop_assert!(numbers[6] >= 0.0);
        let read = Pose::<Object, Palm>::from_array(numbers).unwrap();
        prop_assert!(distance(&read, &isometry) < 1e-12);
    }

    #[test]
    fn both_signs_of_a_quaternion_store_alike(isometry in pose(1.0)) {
        let [x, y, z, w] = xyzw(&isometry.rotation);
        prop_assume!(w > 1e-9);
        let plain = quaternion_xyzw([x, y, z, w]).unwrap();
        let negated = quaternion_xyzw([-x, -y, -z, -w]).unwrap();
        prop_assert_eq!(xyzw(&negated), xyzw(&plain));
    }

    #[test]
    fn both_signs_of_a_half_turn_store_alike(axis in prop::array::uniform3(-1.0..1.0)) {
        let axis = Vector3::from(axis);
        prop_assume!(axis.norm() > 1e-3);
        let [x, y, z]: [f64; 3] = axis.normalize().into();
        let stored = [[x, y, z, 0.0], [-x, -y, -z, -0.0]].map(|numbers| xyzw(&quaternion_xyzw(numbers).unwrap()));
        prop_assert_eq!(stored[0].map(f64::to_bits), stored[1].map(f64::to_bits));
    }

    #[test]
    fn two_columns_keep_a_rotation(isometry in pose(1.0)) {
        let rotation = rotation_from_rot6d(rot6d(&isometry.rotation)).unwrap();
        prop_assert!(rotation.angle_to(&isometry.rotation) < 1e-6);
    }

    #[test]
    fn up_points_up_on_the_table(direction in prop::array::uniform3(-1.0..1.0)) {
        let direction = Vector3::from(direction);
        prop_assume!(direction.norm() > 1e-3);
        let rest = RestingPose { up_in_object: Unit::new_normalize(direction), height_m: 0.1 };
        let table_from_object: Pose<Table, Object> = rest.table_from_object();
        let up = table_from_object * rest.up_in_object.into_inner();
        prop_assert!((up - Vector3::z()).norm() < 1e-9);
        prop_assert!((table_from_object.translation.z - 0.1).abs() < 1e-12);
        let again = RestingPose::of(&table_from_object);
        prop_assert!((again.up_in_object.into_inner() - rest.up_in_object.into_inner()).norm() < 1e-9);
        prop_assert!((again.height_m - 0.1).abs() < 1e-12);
    }
}

#[test]
fn refuses_a_quaternion_in_the_wrong_order_of_magnitude() {
    assert!(quaternion_xyzw([0.0, 0.0, 0.0, 0.5]).is_err());
    assert!(quaternion_xyzw([f64::NAN, 0.0, 0.0, 1.0]).is_err());
}

#[test]
fn parallel_columns_are_refused() {
    assert!(rotation_from_rot6d([1.0, 0.0, 0.0, 2.0, 0.0, 0.0]).is_none());
}
