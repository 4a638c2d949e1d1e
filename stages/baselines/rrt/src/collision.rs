//! The collision check of a configuration: the hand's spheres against object and table.

use nalgebra::Point3;
use posture::Environment;
use robot::{
    RobotModel,
    spheres::{SLACK, SphereCluster},
};
use spatial::Palm;

use crate::configuration::Configuration;

/// A hand, an object and the table on which it lies.
pub(crate) struct Obstacles<'a> {
    /// The hand.
    pub(crate) hand: &'a RobotModel,
    /// The spheres that fill its shapes.
    pub(crate) spheres: &'a [SphereCluster],
    /// The object on its table.
    pub(crate) environment: &'a Environment,
}

impl Obstacles<'_> {
    /// Says whether no part of the hand is deeper than this in object or table, in meters.
    pub(crate) fn is_free(&self, at: &Configuration, depth_m: f64) -> bool {
        self.first_depth(at, |depth| (depth > depth_m).then_some(depth))
            .is_none()
    }

    /// Returns the depth of the hand in object or table, in meters; 0 if it is in neither.
    pub(crate) fn depth_m(&self, at: &Configuration) -> f64 {
        let mut deepest_m = 0.0_f64;
        let nothing = self.first_depth(at, |depth| {
            deepest_m = deepest_m.max(depth);
            None
        });
        nothing.unwrap_or(deepest_m)
    }

    /// Returns the first result of `found` over the depths of the spheres that may be in object or table.
    fn first_depth(
        &self,
        at: &Configuration,
        mut found: impl FnMut(f64) -> Option<f64>,
    ) -> Option<f64> {
        let palm_from_links = self.hand.link_poses::<Palm>(|joint| at.q[joint]);
        let off_m = |center: &Point3<f64>| self.environment.signed_distance(center).distance_m;
        let height_m = |center: &Point3<f64>| self.environment.height_m(center);
        for cluster in self.spheres {
            let object_from_link = at.object_from_palm * palm_from_links[cluster.link];
            let center = object_from_link * cluster.around.center_in_link;
            let reach_m = cluster.around.radius_m;
            let may_be_in_object = off_m(&center) < SLACK * reach_m;
            if !(may_be_in_object || height_m(&center) < reach_m) {
                continue;
            }
            for sphere in &cluster.spheres {
                let center = object_from_link * sphere.center_in_link;
                let gap_m = off_m(&center).min(height_m(&center));
                if let Some(result) = found(sphere.radius_m - gap_m) {
                    return Some(result);
                }
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use geometry::{DistanceField, TriMesh};
    use nalgebra::Translation3;
    use robot::spheres::clusters;
    use spatial::{Pose, RestingPose};

    use super::*;

    /// A ball of 1 cm on a slide.
    const HAND: &str = r#"<robot name="h"><link name="palm"/><link name="tip"><collision>
        <geometry><sphere radius="0.01"/></geometry></collision></link>
        <joint name="j" type="prismatic"><parent link="palm"/><child link="tip"/>
        <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"#;

    #[test]
    fn a_ball_is_as_deep_as_it_reaches_into_object_or_table() {
        let model = RobotModel::from_urdf(HAND).unwrap();
        let spheres = clusters(&model).unwrap();
        let high = Point3::new(0.05, 0.05, 0.05);
        let mesh = TriMesh::cuboid(-high, high);
        let field = DistanceField::new(&mesh, 0.0025, 0.025).unwrap().unwrap();
        let obstacles = Obstacles {
            hand: &model,
            spheres: &spheres,
            environment: &Environment::new(
                field,
                RestingPose::of(&Pose::new(Translation3::new(0.3, 0.1, 0.05).into())),
            ),
        };
        let check = |palm: [f64; 3], q: f64, depth_m: f64| {
            let at = Configuration {
                object_from_palm: Pose::new(Translation3::from(palm).into()),
                q: vec![q],
            };
            let found_m = obstacles.depth_m(&at);
            assert!((found_m - depth_m).abs() < 2e-4, "{found_m}");
            assert!(obstacles.is_free(&at, depth_m + 1e-3));
            assert_eq!(obstacles.is_free(&at, 1e-3), depth_m < 1e-3);
        };
        check([0.1, 0.0, 0.0], 0.0, 0.0);
        check([0.1, 0.0, 0.0], -0.046, 0.006);
        check([0.2, 0.0, -0.047], 0.0, 0.007);
        // In both: 4 mm in the table, 6 mm in the object.
        check([0.2, 0.0, -0.044], -0.146, 0.006);
    }
}
