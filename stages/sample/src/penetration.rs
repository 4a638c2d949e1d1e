//! Penetration of a hand into an object and the table.

use geometry::DistanceField;
use motion::Step;
use nalgebra::Point3;
use robot::{
    JointOrder, RobotModel, WrongDof,
    spheres::{SLACK, SphereCluster, TooLarge, clusters},
};
use schemas::{candidates::Candidate, draws::Refusal};
use spatial::{Object, Palm, Pose, Table};

/// Collision model of a hand: its collision shapes filled with spheres.
pub struct CollisionModel<'a> {
    hand: &'a RobotModel,
    clusters: Vec<SphereCluster>,
}

/// Depth of a hand in object and table, in meters; 0 without penetration.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Depth {
    /// In the object.
    pub object_m: f64,
    /// Below the table.
    pub table_m: f64,
}

impl Depth {
    /// Returns the greater of the two, in meters.
    pub(crate) fn deepest_m(self) -> f64 {
        self.object_m.max(self.table_m)
    }

    /// Returns in what the hand is deeper.
    pub(crate) fn deeper_in(self) -> Refusal {
        if self.object_m >= self.table_m {
            Refusal::Object
        } else {
            Refusal::Table
        }
    }
}

impl<'a> CollisionModel<'a> {
    /// Fills the hand's collision shapes with spheres.
    ///
    /// # Errors
    ///
    /// Fails if they are far larger than a hand's.
    pub fn new(hand: &'a RobotModel) -> Result<Self, TooLarge> {
        let clusters = clusters(hand)?;
        Ok(Self { hand, clusters })
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
        let mut depth = Depth::default();
        for cluster in &self.clusters {
            let object_from_link = *object_from_palm * palm_from_links[cluster.link];
            let height_m = |center: &Point3<f64>| (*table_from_object * *center).z;
            let center = object_from_link * cluster.around.center_in_link;
            let reach_m = cluster.around.radius_m;
            let may_be_in_object = field.distance(&center).0 < SLACK * reach_m;
            let may_be_in_table = height_m(&center) < reach_m;
            if !(may_be_in_object || may_be_in_table) {
                continue;
            }
            for sphere in &cluster.spheres {
                let center = object_from_link * sphere.center_in_link;
                let deep_m = sphere.radius_m - field.distance(&center).0;
                depth.object_m = depth.object_m.max(deep_m);
                depth.table_m = depth.table_m.max(sphere.radius_m - height_m(&center));
            }
        }
        Ok(depth)
    }
}

/// Measures how deep motions of an object penetrate object and table.
#[derive(Clone, Copy)]
pub struct PenetrationProbe<'a> {
    /// The hand's collision model.
    pub collision_model: &'a CollisionModel<'a>,
    /// Distances about the object.
    pub field: &'a DistanceField,
    /// From a candidate's joints to the hand's.
    pub order: &'a JointOrder,
}

impl PenetrationProbe<'_> {
    /// Measures how deep the hand is at one step.
    ///
    /// # Errors
    ///
    /// Fails if the step has not one position per joint of the hand.
    pub fn depth(&self, candidate: &Candidate, step: &Step<Object>) -> Result<Depth, WrongDof> {
        self.collision_model.depth(
            self.field,
            &step.frame_from_palm,
            &candidate.table_from_object,
            &self.order.apply(&step.q_rad)?,
        )
    }

    /// Measures how deep the hand is in object and table, in each at its deepest.
    pub(crate) fn deepest(&self, candidate: &Candidate) -> Result<Depth, WrongDof> {
        let mut steps = candidate.motion.steps().iter();
        steps.try_fold(Depth::default(), |deepest, step| {
            let depth = self.depth(candidate, step)?;
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
    fn a_hand_is_deepest_in_the_object_or_in_the_table() {
        let check = |object_m: f64, table_m: f64, deepest_m: f64, deeper_in: Refusal| {
            let depth = Depth { object_m, table_m };
            assert_eq!(
                (depth.deepest_m(), depth.deeper_in()),
                (deepest_m, deeper_in)
            );
        };
        check(0.02, 0.01, 0.02, Refusal::Object);
        check(0.01, 0.02, 0.02, Refusal::Table);
        check(0.01, 0.01, 0.01, Refusal::Object);
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
