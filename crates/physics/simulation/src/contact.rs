//! Contacts between hand and object.

use geometry::SurfaceDistance;
use nalgebra::{Point3, Vector3};
use rapier3d::{
    math::Vector,
    prelude::{Collider, ContactPair, RigidBodyHandle},
};
use spatial::{Palm, Pose, Table};

use crate::{
    units::{EngineFrame, forces_in_newtons, meters, vector_in_meters},
    world::{World, groups},
};

/// Touch between hand and object in one physics step.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Touch {
    /// For each body of the hand, whether it pressed on the object.
    pub(crate) bodies: Vec<bool>,
    /// Depth in meters of the deepest point of the hand below the object's surface, 0 if there is
    /// none.
    pub(crate) depth_m: f64,
}

/// Returns the pairs of shapes that may touch, with their contacts in the last physics step.
fn pairs(world: &World) -> impl Iterator<Item = (&ContactPair, [&Collider; 2])> {
    world.narrow_phase.contact_pairs().filter_map(|pair| {
        let first = world.colliders.get(pair.collider1)?;
        let second = world.colliders.get(pair.collider2)?;
        Some((pair, [first, second]))
    })
}

/// Returns the touch in the last physics step.
///
/// A convex part may stick out of the `surface` that it stands for: by so much less is a contact deep.
pub(crate) fn touch(
    world: &World,
    object: RigidBodyHandle,
    surface: Option<&SurfaceDistance>,
    bodies_n: usize,
) -> Touch {
    let mut touch = Touch {
        bodies: vec![false; bodies_n],
        depth_m: 0.0,
    };
    for (pair, [first, second]) in pairs(world) {
        let is_first = first.parent() == Some(object);
        let of_hand = match (is_first, second.parent() == Some(object)) {
            (true, false) => second,
            (false, true) => first,
            _ => continue,
        };
        // The table is not a body of the hand, though its user data is 0 like the palm's.
        if !groups::is_hand(of_hand.collision_groups()) {
            continue;
        }
        let pressed = usize::try_from(of_hand.user_data)
            .ok()
            .and_then(|body| touch.bodies.get_mut(body));
        let Some(pressed) = pressed else { continue };
        for contact in pair.manifolds().iter().flat_map(|m| &m.points) {
            *pressed |= contact.data.impulse > 0.0;
            let depth_m = -meters(contact.dist);
            if depth_m > touch.depth_m {
                // The parts are given in the object's frame.
                let on_part = if is_first {
                    contact.local_p1
                } else {
                    contact.local_p2
                };
                let protrusion_m = surface.map_or(0.0, |surface| protrusion_m(surface, on_part));
                touch.depth_m = touch.depth_m.max(depth_m - protrusion_m);
            }
        }
    }
    touch
}

/// Returns the depth in meters to which links of different fingers, or a finger and the palm, are in each other after
/// the last physics step, 0 if none are.
pub(crate) fn self_depth_m(world: &World) -> f64 {
    let of_hand = pairs(world).filter(|(_, both)| {
        let mut both = both.iter();
        both.all(|one| groups::is_hand(one.collision_groups()))
    });
    let points = of_hand.flat_map(|(pair, _)| pair.manifolds().iter().flat_map(|m| &m.points));
    points.map(|point| -meters(point.dist)).fold(0.0, f64::max)
}

/// Load of object and table on the palm, along the engine's axes, which are the table's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PalmLoad {
    /// Force in newtons.
    pub(crate) force_n: Vector3<f64>,
    /// Torque about the palm's origin in newton meters.
    pub(crate) torque_nm: Vector3<f64>,
}

/// Returns the force and torque with which object and table pressed on the hand in the last physics step.
pub(crate) fn load_on_palm(world: &World, engine_from_palm: &Pose<EngineFrame, Palm>) -> PalmLoad {
    let palm_in_engine = engine_from_palm.translation.vector;
    let (mut force_n, mut torque_nm) = (Vector3::zeros(), Vector3::zeros());
    for (pair, [first, second]) in pairs(world) {
        let is_hand = [first, second].map(|one| groups::is_hand(one.collision_groups()));
        // The normal leads from the first to the second.
        let towards_hand = match is_hand {
            [false, true] => 1.0,
            [true, false] => -1.0,
            _ => continue,
        };
        for manifold in pair.manifolds() {
            let normal = Vector3::from(manifold.data.normal.to_array().map(f64::from));
            for contact in &manifold.points {
                // The friction is that of the last substep, on the first body.
                let rubbing = contact.data.warmstart_tangent_world.to_array();
                let rubbing = Vector3::from(rubbing.map(f64::from)) * world.substep_count();
                let impulse = normal * f64::from(contact.data.impulse) - rubbing;
                let force = forces_in_newtons(&(impulse * (towards_hand / world.step_s())));
                let point = first.position().transform_point(contact.local_p1);
                force_n += force;
                torque_nm += (vector_in_meters(point) - palm_in_engine).cross(&force);
            }
        }
    }
    PalmLoad { force_n, torque_nm }
}

/// Contact of the hand with the object in one physics step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactPoint {
    /// The hand's link, by its place in the model: of links fixed to each other, the one that moves.
    pub link: usize,
    /// Its position, table frame, in meters.
    pub point_in_table_m: Point3<f64>,
    /// The force on the object, friction included, table frame, in newtons.
    pub force_in_table_n: Vector3<f64>,
}

/// Returns the contacts of the hand with the object in the last physics step; `links` are those of the
/// hand's bodies.
pub(crate) fn contact_points(
    world: &World,
    object: RigidBodyHandle,
    links: &[usize],
    table_from_engine: &Pose<Table, EngineFrame>,
) -> Vec<ContactPoint> {
    let mut found = Vec::new();
    for (pair, [first, second]) in pairs(world) {
        // The normal leads from the first to the second.
        let is_first = first.parent() == Some(object);
        let (of_hand, towards_object) = match (is_first, second.parent() == Some(object)) {
            (true, false) => (second, -1.0),
            (false, true) => (first, 1.0),
            _ => continue,
        };
        if !groups::is_hand(of_hand.collision_groups()) {
            continue;
        }
        let body = usize::try_from(of_hand.user_data).ok();
        let Some(&link) = body.and_then(|body| links.get(body)) else {
            continue;
        };
        for manifold in pair.manifolds() {
            let normal = Vector3::from(manifold.data.normal.to_array().map(f64::from));
            for contact in manifold.points.iter().filter(|it| it.data.impulse > 0.0) {
                // The friction is that of the last substep, on the first body.
                let rubbing = contact.data.warmstart_tangent_world.to_array();
                let rubbing = Vector3::from(rubbing.map(f64::from)) * world.substep_count();
                let impulse = normal * f64::from(contact.data.impulse) - rubbing;
                let force = forces_in_newtons(&(impulse * (towards_object / world.step_s())));
                let point = first.position().transform_point(contact.local_p1);
                found.push(ContactPoint {
                    link,
                    point_in_table_m: *table_from_engine * Point3::from(vector_in_meters(point)),
                    force_in_table_n: *table_from_engine * force,
                });
            }
        }
    }
    found
}

/// Returns the protrusion of a part's point out of the surface, in meters.
fn protrusion_m(surface: &SurfaceDistance, on_part: Vector) -> f64 {
    let on_part_m = Point3::from(vector_in_meters(on_part));
    let distance_m = surface.signed_distance(&on_part_m).distance_m;
    distance_m.max(0.0)
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;
    use rapier3d::prelude::{ColliderBuilder, RigidBodyBuilder};

    use super::*;
    use crate::{fixture, units::length};

    /// A palm bears the weight of a cube on it, and about a point 10 cm beside it that weight's torque.
    #[test]
    fn palm_bears_the_weight_of_what_lies_on_it() {
        for substeps in [1, 4] {
            let mut scene = fixture::scene();
            scene.substeps = substeps;
            let mut world = World::empty(&scene);
            let palm = world
                .bodies
                .insert(RigidBodyBuilder::kinematic_velocity_based());
            let [half_edge, half_thickness] = [0.1, 0.01].map(length);
            world.colliders.insert_with_parent(
                ColliderBuilder::cuboid(half_edge, half_edge, half_thickness)
                    .collision_groups(groups::hand()),
                palm,
                &mut world.bodies,
            );
            let cube = fixture::cube();
            let above = Pose::identity().translated(&Vector3::new(0.0, 0.0, 0.01 + 0.025));
            let object = cube.insert(&mut world, &scene, &above).unwrap();
            for _ in 0..250 {
                world.step().unwrap();
            }
            let weight_n = cube.mass_kg * 9.81;
            let beside = Pose::from_parts([0.1, 0.0, 0.0], UnitQuaternion::identity());
            let points = contact_points(&world, object, &[7], &Pose::identity());
            let force: Vector3<f64> = points.iter().map(|it| it.force_in_table_n).sum();
            assert!((force.z / weight_n - 1.0).abs() < 0.02, "{force}");
            assert!(force.xy().norm() < 0.02 * weight_n, "{force}");
            for contact in &points {
                let point = contact.point_in_table_m;
                assert_eq!(contact.link, 7);
                assert!((point.z - 0.01).abs() < 1e-3, "{point}");
                assert!(point.x.abs().max(point.y.abs()) < 0.026, "{point}");
            }
            let load = load_on_palm(&world, &beside);
            let [force_n, torque_nm] = [load.force_n, load.torque_nm].map(|of| of.norm());
            assert!(
                (force_n / weight_n - 1.0).abs() < 0.02,
                "{force_n} of {weight_n} N"
            );
            assert!(
                (torque_nm / (0.1 * weight_n) - 1.0).abs() < 0.02,
                "{torque_nm} Nm"
            );
        }
    }
}
