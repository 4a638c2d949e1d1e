//! Contacts of a hand and an object as messages.

use nalgebra::{Point3, Vector3};

use super::{TABLE, color, header, marker};
use crate::ros2::{ColorRgba, JointState, Marker, MarkerArray, Point};

/// Topic of the contacts of robot and object: arrows along their forces on the object.
pub const CONTACTS: &str = "/contacts";
/// Topic of the size of each link's force on the object, as efforts by the links' names.
pub const CONTACT_FORCES: &str = "/contact_forces";

/// Length of an arrow for each newton.
pub const METERS_PER_NEWTON: f64 = 0.01;
/// Diameters of an arrow's shaft and head, in meters.
const SHAFT_M: [f64; 2] = [0.0015, 0.004];
/// Color of a contact.
const CONTACT_COLOR: ColorRgba = color(0.84, 0.37, 0.0);

/// A contact of a link with the object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactForce<'a> {
    /// The link's name.
    pub link: &'a str,
    /// Position, table frame, in meters.
    pub point_in_table_m: Point3<f64>,
    /// Force on the object, table frame, in newtons.
    pub force_in_table_n: Vector3<f64>,
}

/// Returns an arrow for each contact, for [`CONTACTS`]; the first marker removes those of the moment before.
pub fn contact_markers(time_ns: i64, contacts: &[ContactForce<'_>]) -> MarkerArray {
    /// `DELETEALL`.
    const REMOVE: i32 = 3;
    let remove = Marker {
        action: REMOVE,
        ..marker(time_ns, TABLE, "contacts", CONTACT_COLOR)
    };
    let arrow = |(idx, contact): (i32, &ContactForce<'_>)| {
        let from = contact.point_in_table_m;
        let to = from + contact.force_in_table_n * METERS_PER_NEWTON;
        let [shaft, head] = SHAFT_M;
        Marker {
            id: idx,
            r#type: Marker::ARROW,
            scale: super::Vector3 {
                x: shaft,
                y: head,
                z: 0.0,
            },
            points: [from, to]
                .map(|point| Point {
                    x: point.x,
                    y: point.y,
                    z: point.z,
                })
                .to_vec(),
            ..marker(time_ns, TABLE, contact.link, CONTACT_COLOR)
        }
    };
    let arrows = (0..).zip(contacts).map(arrow);
    super::markers([remove].into_iter().chain(arrows))
}

/// Returns the size of the force of each of these links on the object, for [`CONTACT_FORCES`].
pub fn contact_forces(time_ns: i64, links: &[String], contacts: &[ContactForce<'_>]) -> JointState {
    let force_n = |link: &String| {
        let of_link = contacts.iter().filter(|contact| contact.link == link);
        let sum: Vector3<f64> = of_link.map(|contact| contact.force_in_table_n).sum();
        sum.norm()
    };
    JointState {
        header: header(time_ns, TABLE),
        name: links.to_vec(),
        effort: links.iter().map(force_n).collect(),
        ..JointState::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrows_are_as_long_as_forces_and_links_have_their_sum() {
        let contact = |link, force: [f64; 3]| ContactForce {
            link,
            point_in_table_m: Point3::new(0.1, 0.0, 0.2),
            force_in_table_n: force.into(),
        };
        let contacts = [
            contact("tip", [3.0, 0.0, 0.0]),
            contact("tip", [0.0, 4.0, 0.0]),
            contact("palm", [0.0, 0.0, -2.0]),
        ];
        let markers = contact_markers(5, &contacts).markers;
        assert_eq!(markers.len(), 4);
        assert_eq!((markers[0].action, markers[1].ns.as_str()), (3, "tip"));
        let [from, to] = markers[3].points.as_slice() else {
            panic!("{markers:?}");
        };
        assert!((from.z - to.z - 2.0 * METERS_PER_NEWTON).abs() < 1e-12);
        let links = ["palm", "finger", "tip"].map(str::to_owned);
        let forces = contact_forces(5, &links, &contacts);
        assert_eq!(forces.effort, [2.0, 0.0, 5.0]);
    }
}
