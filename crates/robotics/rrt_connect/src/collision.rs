//! The collision check of a configuration: the hand's spheres against object and table.

use posture::Environment;
use robot::{HandCollision, Link, RobotModel};
use spatial::{Object, Palm, Pose};

use crate::configuration::Configuration;

/// A hand, an object and the table on which it lies.
pub(crate) struct Obstacles<'a> {
    /// The hand.
    pub(crate) hand: &'a RobotModel,
    /// Its collision shapes.
    pub(crate) collision: &'a HandCollision,
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
        let links = palm_from_links
            .iter()
            .map(|link| at.object_from_palm * *link);
        let object_from_links: Vec<Pose<Object, Link>> = links.collect();
        let place = HandCollision::at(&object_from_links);
        let environment = self.environment;
        self.collision
            .find_in(environment, place, |radius_m, center| {
                found(radius_m - center.least_m())
            })
    }
}

#[cfg(test)]
mod tests {
    use geometry::{DistanceField, TriMesh};
    use nalgebra::{Point3, Translation3};
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
        let collision = HandCollision::new(&model).unwrap();
        let high = Point3::new(0.05, 0.05, 0.05);
        let mesh = TriMesh::cuboid(-high, high);
        let field = DistanceField::new(&mesh, 0.0025, 0.025).unwrap().unwrap();
        let obstacles = Obstacles {
            hand: &model,
            collision: &collision,
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
