//! The grasped object as convex parts with a mass.

use geometry::TriMesh;
use nalgebra::{Matrix3, Point3};
use rapier3d::prelude::{
    ColliderBuilder, MassProperties, RigidBodyBuilder, RigidBodyHandle, SharedShape, Vector,
};
use spatial::{Object, Pose, Table};

use crate::{
    config::{ObjectMass, SceneConfig},
    error::SimulationError,
    units::{LENGTH_UNITS_PER_M, engine_pose, mass, matrix, point, real},
    world::{World, groups},
};

/// Shape and mass of the object, in its own frame.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectShape {
    /// Vertices of each convex part in meters.
    pub parts_m: Vec<Vec<Point3<f64>>>,
    /// The surface that the parts stand for, from which depths are measured; without one the parts
    /// themselves are it.
    pub surface: Option<TriMesh>,
    /// True mass in kilograms.
    pub mass_kg: f64,
    /// Center of mass in meters.
    pub center_of_mass_m: Point3<f64>,
    /// Inertia about the center of mass along the object's axes, in kilogram square meters.
    pub inertia_kg_m2: Matrix3<f64>,
}

impl ObjectShape {
    /// Returns the object's shape and mass from its artifact.
    pub fn from_artifact(object: &schemas::objects::Object) -> Self {
        let [xx, yy, zz, xy, xz, yz] = object.inertia_kg_m2;
        Self {
            surface: Some(TriMesh {
                vertices_m: object.vertices_m.iter().map(|&p| p.into()).collect(),
                triangles: object.triangles.clone(),
            }),
            parts_m: object
                .parts_m
                .iter()
                .map(|part| part.iter().map(|&p| Point3::from(p)).collect())
                .collect(),
            mass_kg: object.mass_kg,
            center_of_mass_m: Point3::from(object.center_of_mass_m),
            inertia_kg_m2: Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz),
        }
    }

    /// Returns the convex hulls of the parts.
    pub(crate) fn hulls(&self) -> Result<Vec<SharedShape>, SimulationError> {
        if self.parts_m.is_empty() {
            return Err(SimulationError::NoParts);
        }
        self.parts_m
            .iter()
            .enumerate()
            .map(|(part, points)| {
                let rounded: Vec<Vector> = points.iter().map(point).collect();
                let finite = rounded.iter().all(|p| p.is_finite()) && rounded.len() >= 4;
                finite
                    .then(|| SharedShape::convex_hull(&rounded))
                    .flatten()
                    .ok_or(SimulationError::FlatPart {
                        part,
                        points: points.len(),
                    })
            })
            .collect()
    }

    /// Returns the height of the lowest point of the object at `table_from_object`, in meters.
    pub(crate) fn lowest_m(&self, table_from_object: &Pose<Table, Object>) -> f64 {
        self.parts_m
            .iter()
            .flatten()
            .map(|p| (*table_from_object * *p).z)
            .fold(f64::INFINITY, f64::min)
    }

    /// Returns the mass of the object in a scene, in kilograms.
    fn mass_in_kg(&self, scene: &SceneConfig) -> Result<f64, SimulationError> {
        let mass_kg = match scene.object_mass() {
            ObjectMass::Kilograms(mass_kg) => mass_kg,
            ObjectMass::Density(density) => {
                let volumes_m3 = self.hulls()?.into_iter().map(|hull| {
                    let of_unit_density = hull.mass_properties(1.0);
                    f64::from(of_unit_density.mass()) / LENGTH_UNITS_PER_M.powi(3)
                });
                density * volumes_m3.sum::<f64>()
            }
            ObjectMass::Measured => self.mass_kg,
        };
        Ok(mass_kg * scene.mass_scale)
    }

    fn mass_properties(&self, scene: &SceneConfig) -> Result<MassProperties, SimulationError> {
        let mass_kg = self.mass_in_kg(scene)?;
        if !(mass_kg.is_finite() && mass_kg > 0.0) {
            return Err(SimulationError::Massless { mass_kg });
        }
        let inertia = self.inertia_kg_m2 * (mass_kg / self.mass_kg);
        let moments = principal_moments(&inertia);
        if !moments
            .iter()
            .all(|moment| moment.is_finite() && *moment > 0.0)
        {
            return Err(SimulationError::ObjectInertia { moments });
        }
        Ok(MassProperties::with_inertia_matrix(
            point(&self.center_of_mass_m),
            mass(mass_kg),
            matrix(&inertia),
        ))
    }

    /// Puts the object into the world.
    pub(crate) fn insert(
        &self,
        world: &mut World,
        scene: &SceneConfig,
        table_from_object: &Pose<Table, Object>,
    ) -> Result<RigidBodyHandle, SimulationError> {
        let body = world.bodies.insert(
            RigidBodyBuilder::dynamic()
                .pose(engine_pose(table_from_object))
                .additional_mass_properties(self.mass_properties(scene)?)
                .can_sleep(false),
        );
        for hull in self.hulls()? {
            world.colliders.insert_with_parent(
                ColliderBuilder::new(hull)
                    .density(0.0)
                    .friction(real(scene.friction))
                    .collision_groups(groups::object()),
                body,
                &mut world.bodies,
            );
        }
        Ok(body)
    }
}

/// Returns the principal moments of an inertia, NaN where it is not finite.
pub(crate) fn principal_moments(inertia: &Matrix3<f64>) -> [f64; 3] {
    if inertia.iter().all(|number| number.is_finite()) {
        inertia.symmetric_eigenvalues().into()
    } else {
        [f64::NAN; 3]
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};
    use rapier3d::math::Pose as EnginePose;

    use super::*;
    use crate::{
        fixture,
        units::{length, rotation, vector_in_meters},
    };

    #[test]
    fn falls_by_half_g_t_squared() {
        let scene = fixture::scene();
        let mut world = World::empty(&scene);
        let start = Pose::identity().translated(&Vector3::new(0.0, 0.0, 10.0));
        let body = fixture::cube().insert(&mut world, &scene, &start).unwrap();
        let steps = 250;
        for _ in 0..steps {
            world.step().unwrap();
        }
        let time = f64::from(steps) * scene.time_step_s;
        let fallen = 10.0 - world.table_from_body::<Object>(body).translation.z;
        // Symplectic Euler moves with the velocity at the end of each substep.
        let substep_s = scene.time_step_s / f64::from(scene.substeps);
        let expected = 0.5 * 9.81 * time * (time + substep_s);
        assert!(
            (fallen - expected).abs() < 1e-3,
            "{fallen} against {expected}"
        );
    }

    /// Returns the distance in meters that a cube slides down a slope in half a second, after half a
    /// second of rest.
    fn slide_m(friction: f64, slope_rad: f64) -> f64 {
        let mut scene = fixture::scene();
        scene.friction = friction;
        let mut world = World::empty(&scene);
        let tilt = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), slope_rad);
        let slope = world
            .bodies
            .insert(RigidBodyBuilder::fixed().pose(EnginePose::from_rotation(rotation(&tilt))));
        world.colliders.insert_with_parent(
            ColliderBuilder::cuboid(length(5.0), length(5.0), length(0.5))
                .friction(real(friction))
                .collision_groups(groups::table()),
            slope,
            &mut world.bodies,
        );
        let on_top = Pose::from_parts(tilt * Vector3::new(0.0, 0.0, 0.5252), tilt);
        let body = fixture::cube().insert(&mut world, &scene, &on_top).unwrap();
        let place = |world: &mut World| {
            for _ in 0..125 {
                world.step().unwrap();
            }
            vector_in_meters(world.bodies[body].translation())
        };
        let before = place(&mut world);
        (place(&mut world) - before).norm()
    }

    #[test]
    fn slides_above_the_friction_angle_and_holds_below_it() {
        // A cube on a slope beyond 45 degrees would tumble.
        for friction in [0.3_f64, 0.6] {
            let angle = friction.atan();
            assert!(slide_m(friction, angle - 0.03) < 1e-3);
            let slope = angle + 0.1;
            // From rest at 0 s: the way between 0.5 s and 1 s.
            let expected = 0.5 * 9.81 * (slope.sin() - friction * slope.cos()) * 0.75;
            let slid = slide_m(friction, slope);
            assert!(
                (slid / expected - 1.0).abs() < 0.05,
                "{slid} against {expected}"
            );
        }
    }
}
