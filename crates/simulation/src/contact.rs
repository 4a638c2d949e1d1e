//! What the hand feels of the object.

use rapier3d::prelude::RigidBodyHandle;

use crate::world::World;

/// Touch between hand and object in one physics step.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Touch {
    /// For each body of the hand, whether it pressed on the object.
    pub(crate) bodies: Vec<bool>,
    /// Deepest overlap in meters, 0 if there is none.
    pub(crate) depth_m: f64,
}

/// Returns the touch in the last physics step.
pub(crate) fn touch(world: &World, object: RigidBodyHandle, bodies_n: usize) -> Touch {
    let mut touch = Touch {
        bodies: vec![false; bodies_n],
        depth_m: 0.0,
    };
    for pair in world.narrow_phase.contact_pairs() {
        let colliders = [pair.collider1, pair.collider2].map(|handle| world.colliders.get(handle));
        let [Some(first), Some(second)] = colliders else {
            continue;
        };
        let of_hand = match (
            first.parent() == Some(object),
            second.parent() == Some(object),
        ) {
            (true, false) => second,
            (false, true) => first,
            _ => continue,
        };
        // The table is no body of the hand, though its user data is 0 like the palm's.
        if of_hand.collision_groups() != crate::world::groups::hand() {
            continue;
        }
        let pressed = usize::try_from(of_hand.user_data)
            .ok()
            .and_then(|body| touch.bodies.get_mut(body));
        let Some(pressed) = pressed else { continue };
        for contact in pair.manifolds().iter().flat_map(|m| &m.points) {
            *pressed |= contact.data.impulse > 0.0;
            touch.depth_m = touch.depth_m.max(-f64::from(contact.dist));
        }
    }
    touch
}
