//! Contacts as balls that appear, grow with their force and vanish.

use nalgebra::{Isometry3, Vector3};

use crate::{
    Moment,
    motion::{self, Appearance},
    scene::{Node, Scene, Track, Values, single},
    shapes,
};

/// Contacts that are shown at once; the strongest of more.
pub const CONTACTS_N: usize = 10;

/// Seconds between changes of the contacts shown: they are looked at, and flicker at every control step.
const CONTACT_STEP_S: f64 = 0.04;
/// Radius of a contact that presses with nothing, in meters.
const CONTACT_RADIUS_M: f64 = 0.002;
/// Growth of a contact's radius with its force, in meters per newton; the radius is at most four times the least.
const CONTACT_RADIUS_M_PER_N: f64 = 0.0006;
/// A contact of robot and object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Position in the table's frame, in meters.
    pub point_in_table_m: [f64; 3],
    /// Size of its force, in newtons.
    pub force_n: f64,
}

/// Adds a ball for each contact, as large as its force; an absent one has no size.
pub(crate) fn add(scene: &mut Scene, world: usize, moments: &[Moment]) {
    let mut shown: Vec<(usize, Vec<Contact>)> = Vec::new();
    let mut next_s = f64::NEG_INFINITY;
    for (idx, moment) in moments.iter().enumerate() {
        if moment.time_s >= next_s {
            let mut contacts = moment.contacts.clone();
            contacts.sort_by(|a, b| b.force_n.total_cmp(&a.force_n));
            contacts.truncate(CONTACTS_N);
            shown.push((idx, contacts));
            next_s = moment.time_s + CONTACT_STEP_S;
        }
    }
    let most = shown.iter().map(|(_, contacts)| contacts.len()).max();
    let most = most.unwrap_or_default();
    if most == 0 {
        return;
    }
    let ball = shapes::triangles(&robot::Shape::Sphere { radius_m: 1.0 });
    let mesh = scene.add_mesh("contact", ball, Appearance::Contact as usize);
    let kept: Vec<usize> = shown.iter().map(|(idx, _)| *idx).collect();
    let times = scene.add_times(motion::times(moments, &kept));
    for place in 0..most {
        let node = scene.add_node(Node {
            name: format!("contact_{place}"),
            parent: Some(world),
            pose_in_parent: Isometry3::identity(),
            mesh,
        });
        let contacts = || shown.iter().map(|(_, contacts)| contacts.get(place));
        let points = contacts().map(|contact| {
            single(contact.map_or_else(Vector3::zeros, |contact| contact.point_in_table_m.into()))
        });
        let radius = |contact: &Contact| {
            let grown = CONTACT_RADIUS_M + CONTACT_RADIUS_M_PER_N * contact.force_n.abs();
            grown.min(4.0 * CONTACT_RADIUS_M)
        };
        let sizes = contacts().map(|contact| {
            let radius = contact.map_or(0.0, radius);
            single(Vector3::repeat(radius))
        });
        for values in [
            Values::Jump(points.collect()),
            Values::Scale(sizes.collect()),
        ] {
            scene.tracks.push(Track {
                node,
                times,
                values,
            });
        }
    }
}
