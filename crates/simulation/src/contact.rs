//! Contacts between hand and object.

use geometry::SurfaceDistance;
use nalgebra::Point3;
use rapier3d::{math::Vector, prelude::RigidBodyHandle};

use crate::{
    units::{meters, vector_in_meters},
    world::World,
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
    for pair in world.narrow_phase.contact_pairs() {
        let colliders = [pair.collider1, pair.collider2].map(|handle| world.colliders.get(handle));
        let [Some(first), Some(second)] = colliders else {
            continue;
        };
        let is_first = first.parent() == Some(object);
        let of_hand = match (is_first, second.parent() == Some(object)) {
            (true, false) => second,
            (false, true) => first,
            _ => continue,
        };
        // The table is not a body of the hand, though its user data is 0 like the palm's.
        if of_hand.collision_groups() != crate::world::groups::hand() {
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

/// Returns how far a point of a part sticks out of the surface, in meters.
fn protrusion_m(surface: &SurfaceDistance, on_part: Vector) -> f64 {
    let on_part_m = Point3::from(vector_in_meters(on_part));
    let distance_m = surface.signed_distance(&on_part_m).distance_m;
    distance_m.max(0.0)
}
