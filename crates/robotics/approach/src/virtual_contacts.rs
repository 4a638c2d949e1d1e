//! Virtual contacts of a hand: points on the inner sides of its links that should touch.

use nalgebra::{Point3, Vector3};
use robot::{HandCollision, Link, SurfacePoint};
use spatial::{Palm, Pose};

use crate::HandBody;

/// Length below which a link has no direction, in meters.
const SHORT_M: f64 = 1e-3;

/// Returns the virtual contacts of a hand, the points that should touch: on each link that a flexion joint moves one in
/// the middle of its inner side, on each fingertip one between inner side and end, on the palm four; and one more on
/// each last link, so that the distal parts count for two.
pub fn virtual_contacts(body: &HandBody) -> Vec<SurfacePoint> {
    let model = body.model();
    let reach = Reach(&body.collision);
    let mut contacts = palm_contacts(body, &reach);
    for finger in model.fingers() {
        for (idx, &link) in finger.links.iter().enumerate() {
            let Some(axis) = flexion_axis(body, link) else {
                continue;
            };
            // From the joint to the next joint that moves, or to the tip.
            let open = model.link_poses::<Palm>(|joint| model.joints()[joint].nearest_zero());
            let beyond = finger.links[idx + 1..].iter();
            let moves = |next: &&usize| model.links()[**next].kind.is_some();
            let next = beyond.copied().collect::<Vec<_>>();
            let next = next.iter().find(moves).copied();
            let end_in_palm = match next {
                Some(next) => Point3::from(open[next].translation.vector),
                None => open[finger.tip_link] * Point3::from(finger.tip_offset_m),
            };
            let end = open[link].inverse_transform_point(&end_in_palm);
            if end.coords.norm() < SHORT_M {
                continue;
            }
            let Some(inner) = axis.cross(&end.coords).try_normalize(1e-9) else {
                continue;
            };
            contacts.push(reach.on(link, end.coords / 2.0, inner));
            if next.is_none() {
                let slanted = (inner + end.coords.normalize()).normalize();
                let tip = open[finger.tip_link]
                    .inverse_transform_vector(&(open[link].rotation * slanted));
                contacts.push(reach.on(finger.tip_link, finger.tip_offset_m, tip));
            }
        }
    }
    contacts
}

/// Returns the axis of the flexion joint that moves a link first; `None` if it is moved by another.
fn flexion_axis(body: &HandBody, link: usize) -> Option<Vector3<f64>> {
    let link = body.model().links().get(link)?;
    link.kind?;
    let joint = link.joint?;
    let bends = body.flexion().contains(&joint);
    bends.then(|| link.axis.into_inner() * link.multiplier.signum())
}

/// Extents of links, from the spheres that fill their shapes.
struct Reach<'a>(&'a HandCollision);

impl Reach<'_> {
    /// Returns the extent of a link along a direction, from its origin, in meters.
    fn along(&self, link: usize, way: &Vector3<f64>) -> f64 {
        let spheres = self.0.clusters().flatten();
        let reach = spheres
            .filter(|sphere| sphere.link == link)
            .map(|one| one.sphere.center_in_link.coords.dot(way) + one.sphere.radius_m);
        reach.reduce(f64::max).unwrap_or(0.0)
    }

    /// Returns the contact on the side of a link that a normal points to, at the foot of a point.
    fn on(&self, link: usize, above: Vector3<f64>, normal: Vector3<f64>) -> SurfacePoint {
        let off_m = self.along(link, &normal) - above.dot(&normal);
        SurfacePoint {
            link,
            point_in_link: Point3::from(above + normal * off_m),
            normal_in_link: normal,
        }
    }
}

/// Returns four contacts on the side of the palm that grasps, a quarter of its size from its middle.
fn palm_contacts(body: &HandBody, reach: &Reach<'_>) -> Vec<SurfacePoint> {
    let axes = body.axes();
    let Some(palm) = body.model().hand_layout().map(|layout| layout.palm) else {
        return Vec::new();
    };
    // In the palm link's frame, wherever the root has put it.
    let root_from_links: Vec<Pose<Palm, Link>> = body
        .model()
        .link_poses(|joint| body.model().joints()[joint].nearest_zero());
    let in_palm = |way: Vector3<f64>| root_from_links[palm].inverse_transform_vector(&way);
    let normal = in_palm(*axes.approach_in_palm);
    let forward = in_palm(*axes.forward_in_palm);
    let across = normal.cross(&forward);
    let [along, aside] = [forward, across].map(|way| {
        let (most, least) = (reach.along(palm, &way), -reach.along(palm, &-way));
        [0.25, 0.75].map(|share| way * (least + share * (most - least)))
    });
    let places = along.iter().flat_map(|a| aside.iter().map(move |b| a + b));
    places.map(|place| reach.on(palm, place, normal)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    /// The Allegro's links are boxes 19.6 mm thick, its tips balls of 12 mm; its fingers bend toward x.
    #[test]
    fn contacts_of_the_allegro_lie_on_its_inner_sides() {
        let body = fixture::body();
        let contacts = virtual_contacts(&body);
        // Three fingers with three links and a tip, a thumb with two links and a tip, four on the palm.
        assert_eq!(contacts.len(), 3 * 4 + 3 + 4);
        let of = |name: &str| {
            let link = body.model().link(name).unwrap();
            let found: Vec<&SurfacePoint> = contacts
                .iter()
                .filter(|contact| contact.link == link)
                .collect();
            found
        };
        let proximal = of("link_1.0")[0];
        assert!(
            (proximal.normal_in_link - Vector3::x()).norm() < 1e-6,
            "{proximal:?}"
        );
        let at = proximal.point_in_link - Point3::new(0.0098, 0.0, 0.027);
        assert!(at.norm() < 5e-4, "{proximal:?}");
        let tip = of("link_3.0_tip")[0];
        let slanted = Vector3::new(1.0, 0.0, 1.0).normalize();
        assert!((tip.normal_in_link - slanted).norm() < 1e-6, "{tip:?}");
        assert!(
            (tip.point_in_link.coords - slanted * 0.012).norm() < 5e-4,
            "{tip:?}"
        );
        let palm = of("base_link");
        assert_eq!(palm.len(), 4);
        for contact in palm {
            // The palm's box ends at x = -9.3 + 20.4 mm; the approach is within some degrees of x.
            assert!(
                (contact.point_in_link.x - 0.0111).abs() < 0.012,
                "{contact:?}"
            );
            assert!(contact.normal_in_link.x > 0.98, "{contact:?}");
        }
    }
}
