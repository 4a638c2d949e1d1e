//! Penetration of a hand into an object and the table.

use geometry::DistanceField;
use motion::{Motion, Step};
use nalgebra::{Point3, Vector3};
use robot::{
    Depth, HandCollision, JointOrder, Link, RobotModel, Surroundings, WrongDof, spheres::TooLarge,
};
use spatial::{Object, Palm, Pose, Table};

/// Collision model of a hand: its collision shapes filled with spheres.
pub struct CollisionModel<'a> {
    hand: &'a RobotModel,
    shapes: HandCollision,
}

/// An object on a table, in the object's frame.
struct Scene<'a> {
    field: &'a DistanceField,
    table_from_object: &'a Pose<Table, Object>,
}

impl Surroundings for Scene<'_> {
    fn object_m(&self, point_in_object: &Point3<f64>) -> f64 {
        self.field.distance(point_in_object).0
    }

    fn object_gradient(&self, point_in_object: &Point3<f64>) -> Vector3<f64> {
        self.field.distance(point_in_object).1
    }

    fn table_m(&self, point_in_object: &Point3<f64>) -> f64 {
        (*self.table_from_object * *point_in_object).z
    }

    fn table_gradient(&self) -> Vector3<f64> {
        self.table_from_object.rotation.inverse() * Vector3::z()
    }
}

impl<'a> CollisionModel<'a> {
    /// Fills the hand's collision shapes with spheres.
    ///
    /// # Errors
    ///
    /// Fails if they are far larger than a hand's.
    pub fn new(hand: &'a RobotModel) -> Result<Self, TooLarge> {
        let shapes = HandCollision::new(hand)?;
        Ok(Self { hand, shapes })
    }

    /// Returns how deep the hand is in the object of the field and below the table; `q` has the order
    /// of the hand's joints.
    ///
    /// # Errors
    ///
    /// Fails if `q` has not one position per joint of the hand.
    pub fn depth(
        &self,
        field: &DistanceField,
        object_from_palm: &Pose<Object, Palm>,
        table_from_object: &Pose<Table, Object>,
        q: &[f64],
    ) -> Result<Depth, WrongDof> {
        let palm_from_links = self.hand.forward_kinematics(q)?;
        let links = palm_from_links.iter().map(|link| *object_from_palm * *link);
        let object_from_links: Vec<Pose<Object, Link>> = links.collect();
        let scene = Scene {
            field,
            table_from_object,
        };
        let place = HandCollision::at(&object_from_links);
        Ok(self.shapes.depth(&scene, place))
    }
}

/// Measures how deep motions of a hand are in an object and the table, at their steps.
#[derive(Clone, Copy)]
pub struct PenetrationProbe<'a> {
    /// The hand's collision model.
    pub collision_model: &'a CollisionModel<'a>,
    /// Distances about the object.
    pub field: &'a DistanceField,
    /// From a motion's joints to the hand's.
    pub order: &'a JointOrder,
}

impl PenetrationProbe<'_> {
    /// Measures how deep the hand is at one step.
    ///
    /// # Errors
    ///
    /// Fails if the step has not one position per joint of the hand.
    pub fn depth(
        &self,
        table_from_object: &Pose<Table, Object>,
        step: &Step<Object>,
    ) -> Result<Depth, WrongDof> {
        self.collision_model.depth(
            self.field,
            &step.frame_from_palm,
            table_from_object,
            &self.order.apply(&step.q_rad)?,
        )
    }

    /// Measures how deep the hand is in object and table over a motion, in each at its deepest.
    pub(crate) fn deepest(
        &self,
        table_from_object: &Pose<Table, Object>,
        motion: &Motion<Object>,
    ) -> Result<Depth, WrongDof> {
        let mut steps = motion.steps().iter();
        steps.try_fold(Depth::default(), |deepest, step| {
            let depth = self.depth(table_from_object, step)?;
            Ok(Depth {
                object_m: deepest.object_m.max(depth.object_m),
                table_m: deepest.table_m.max(depth.table_m),
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use geometry::TriMesh;
    use nalgebra::{Point3, Translation3};

    use super::*;

    /// A cube of 10 cm about the origin.
    fn cube() -> DistanceField {
        let high = Point3::new(0.05, 0.05, 0.05);
        let mesh = TriMesh::cuboid(-high, high);
        DistanceField::new(&mesh, 0.0025, 0.025).unwrap().unwrap()
    }

    #[test]
    fn a_ball_is_as_deep_as_it_reaches() {
        let hand = RobotModel::from_urdf(
            r#"<robot name="h"><link name="palm"/><link name="tip"><collision>
              <geometry><sphere radius="0.01"/></geometry></collision></link>
              <joint name="j" type="prismatic"><parent link="palm"/><child link="tip"/>
              <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
            </robot>"#,
        )
        .unwrap();
        let collision_model = CollisionModel::new(&hand).unwrap();
        let check = |palm: [f64; 3], q: f64, object_m: f64, table_m: f64| {
            let object_from_palm = Pose::new(Translation3::from(palm).into());
            let table_from_object = Pose::new(Translation3::new(0.0, 0.0, 0.05).into());
            let found = collision_model.depth(&cube(), &object_from_palm, &table_from_object, &[q]);
            let found = found.unwrap();
            assert!((found.object_m - object_m).abs() < 2e-4, "{found:?}");
            assert!((found.table_m - table_m).abs() < 1e-9, "{found:?}");
        };
        check([0.1, 0.0, 0.0], 0.0, 0.0, 0.0);
        // The joint takes the sphere's center to 4 mm outside the side.
        check([0.1, 0.0, 0.0], -0.046, 0.006, 0.0);
        check([0.1, 0.0, 0.0], -0.058, 0.018, 0.0);
        check([0.2, 0.0, -0.047], 0.0, 0.0, 0.007);
        // Without positions for all joints nothing is known, least of all that the hand is clear.
        let found = collision_model.depth(&cube(), &Pose::identity(), &Pose::identity(), &[]);
        assert_eq!(
            (found.unwrap_err().expected, found.unwrap_err().found),
            (1, 0)
        );
    }
}
