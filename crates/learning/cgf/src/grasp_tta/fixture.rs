//! Shared test fixtures: a hand of two balls, and a small cube on the table.

use std::sync::Arc;

use nalgebra::{Point3, Unit, Vector3};
use robot::{RobotModel, surface_points};
use spatial::RestingPose;

use super::{HandSurface, nearest::Cloud};
use crate::{RestingObject, precision::narrow, random::Random};

/// A palm without a shape, a ball on a hinge, and another on a slide.
const HAND: &str = r#"<robot name="h"><link name="palm"/>
  <link name="a"><collision><origin xyz="0 0 0.03"/><geometry><sphere radius="0.02"/></geometry></collision></link>
  <link name="b"><collision><geometry><sphere radius="0.02"/></geometry></collision></link>
  <joint name="ja" type="revolute"><parent link="palm"/><child link="a"/><axis xyz="0 1 0"/>
    <origin xyz="0.01 0 0.02" rpy="0.1 0.2 0.3"/><limit lower="-0.2" upper="0.2" effort="1" velocity="1"/></joint>
  <joint name="jb" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="1 0 0"/>
    <origin xyz="0 0 0.01"/><limit lower="-0.1" upper="0.1" effort="1" velocity="1"/></joint>
</robot>"#;

/// Half of the cube's sides, in meters.
const HALF_M: f64 = 0.03;

/// Returns 200 points on both balls, half of them the prior's.
pub(crate) fn surface() -> HandSurface {
    let hand = Arc::new(RobotModel::from_urdf(HAND).unwrap());
    let points = surface_points(&hand, 200);
    let prior = (0..points.len()).step_by(2).collect();
    HandSurface::new(hand, points, prior)
}

/// Returns the cube, its points in random order.
pub(crate) fn resting() -> RestingObject {
    let mut random = Random::new(5, 0);
    let mut draw = || HALF_M * (2.0 * random.uniform() - 1.0);
    let points = (0..120).map(|idx| {
        let mut point = Vector3::new(draw(), draw(), draw());
        point[idx % 3] = if idx % 2 == 0 { HALF_M } else { -HALF_M };
        Point3::from(point)
    });
    RestingObject {
        object: "cube".to_owned(),
        rest: RestingPose {
            up_in_object: Unit::new_unchecked(Vector3::z()),
            height_m: HALF_M,
        },
        points_in_object: points.collect(),
    }
}

/// Returns the cube's points above the table.
pub(crate) fn object() -> Cloud {
    let points = resting().points_in_object;
    let lifted = points.iter().flat_map(|p| [p.x, p.y, p.z + HALF_M]);
    Cloud::new(&lifted.map(narrow).collect::<Vec<f32>>())
}

/// Returns numbers of a hand that is in the cube and in the table, its joints beyond their limits.
pub(crate) fn row() -> Vec<f32> {
    vec![
        -0.035, 0.003, -0.02, 1.0, 0.1, 0.0, 0.0, 0.9, 0.2, 0.3, 0.13,
    ]
}
