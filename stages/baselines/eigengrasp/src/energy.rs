//! The contact energy: distances of virtual contacts from an object, and angles by which they turn away from it.

use approach::PlacedHand;
use nalgebra::{Point3, Vector3};
use posture::Environment;
use robot::SurfacePoint;

/// Half the cost of a contact that faces away from the object, in millimeters.
const ANGLE_MM: f64 = 50.0;

/// Returns the contact energy of a placed hand, in millimeters: the mean over its virtual contacts of the distance to
/// the object and of `50 (1 − cos)` of the angle between the contact's normal and the direction to the object's nearest
/// point (Ciocarlie and Allen, 2007, section 4, with `GraspIt`'s weights). Less is better, 0 is the least.
pub(crate) fn contact_energy(
    environment: &Environment,
    placed: &PlacedHand,
    contacts: &[SurfacePoint],
) -> f64 {
    let costs = contacts.iter().map(|contact| {
        let object_from_link = placed.object_from_link(contact.link);
        let at = object_from_link * contact.point_in_link;
        let normal = object_from_link.rotation * contact.normal_in_link;
        contact_cost(environment, &at, &normal)
    });
    costs.sum::<f64>() / contacts.len().max(1) as f64
}

/// Returns the cost of one contact, in millimeters.
fn contact_cost(environment: &Environment, at: &Point3<f64>, normal: &Vector3<f64>) -> f64 {
    let distance = environment.signed_distance(at);
    let outward = distance.gradient_in_object;
    // The nearest point of the surface is ahead against the gradient outside, along it inside.
    let toward = -outward * distance.distance_m.signum();
    let cosine = toward
        .try_normalize(1e-9)
        .map_or(0.0, |way| way.dot(normal));
    1e3 * distance.distance_m.abs() + ANGLE_MM * (1.0 - cosine)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    #[test]
    fn a_contact_costs_its_distance_and_its_angle() {
        let environment = fixture::BOX.environment();
        let x = fixture::BOX.half_m[0];
        let check = |at: [f64; 3], normal: [f64; 3], expected: f64| {
            let normal = Vector3::from(normal).normalize();
            let found = contact_cost(&environment, &Point3::from(at), &normal);
            assert!((found - expected).abs() < 0.3, "{at:?}: {found} {expected}");
        };
        // 10 mm before the side, facing it, facing along it, and facing away.
        check([x + 0.01, 0.0, 0.0], [-1.0, 0.0, 0.0], 10.0);
        check([x + 0.01, 0.0, 0.0], [0.0, 1.0, 0.0], 60.0);
        check([x + 0.01, 0.0, 0.0], [1.0, 0.0, 0.0], 110.0);
        // At 60 degrees the cosine is a half.
        check([x + 0.02, 0.0, 0.0], [-0.5, 0.75_f64.sqrt(), 0.0], 45.0);
    }

    #[test]
    fn the_energy_is_the_mean_of_the_contacts() {
        let environment = fixture::BOX.environment();
        let body = fixture::body();
        let x = fixture::BOX.half_m[0];
        // The hand's x points at the box from 0.1 m before it.
        let hand = motion::HandState {
            frame_from_palm: spatial::Pose::from_parts(
                [-x - 0.1, 0.0, 0.0],
                nalgebra::UnitQuaternion::identity(),
            ),
            q_rad: body.open(),
        };
        let placed = body.placed(&hand).unwrap();
        let link = body.model().link("base_link").unwrap();
        let contact = |at: [f64; 3], normal: [f64; 3]| SurfacePoint {
            link,
            point_in_link: Point3::from(at),
            normal_in_link: Vector3::from(normal),
        };
        let contacts = [
            contact([0.09, 0.0, 0.0], [1.0, 0.0, 0.0]),
            contact([0.08, 0.0, 0.0], [-1.0, 0.0, 0.0]),
        ];
        let found = contact_energy(&environment, &placed, &contacts);
        // 10 mm, and 20 mm facing away.
        assert!((found - 65.0).abs() < 0.3, "{found}");
    }
}
