//! The points of a hand's surface that networks and losses see.

use std::sync::Arc;

use approach::{HandBody, virtual_contacts};
use cgf::grasp_tta::HandSurface;
use robot::{SurfacePoint, surface_points};

use crate::GraspTtaError;

/// Least cosine of the angle between a point's normal and that of a virtual contact of its link, for hands to touch
/// with that point: 45°.
const FACING: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Spreads `n` points over a hand. Those on the inner sides of the links that bend, on fingertips and palm are the ones
/// that hands touch with: the hand prior.
///
/// # Errors
///
/// Fails if the hand has no collision shape.
pub(crate) fn hand_surface(body: &HandBody, n: usize) -> Result<HandSurface, GraspTtaError> {
    let contacts = virtual_contacts(body);
    let points = surface_points(body.model(), n);
    if points.is_empty() {
        return Err(GraspTtaError::NoSurface);
    }
    let is_prior = |point: &SurfacePoint| {
        let mut of_link = contacts.iter().filter(|contact| contact.link == point.link);
        of_link.any(|contact| point.normal_in_link.dot(&contact.normal_in_link) >= FACING)
    };
    let prior = (0..points.len()).filter(|&idx| is_prior(&points[idx]));
    let prior = prior.collect();
    Ok(HandSurface::new(
        Arc::new(body.model().clone()),
        points,
        prior,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    #[test]
    fn hands_touch_with_the_inner_sides_of_the_links_that_bend_and_with_the_palm() {
        let body = fixture::body();
        let surface = hand_surface(&body, 800).unwrap();
        let of = |name: &str, is_prior: bool| {
            let link = body.model().link(name).unwrap();
            let all = surface.points().iter().enumerate();
            let found: Vec<SurfacePoint> = all
                .filter(|(_, point)| point.link == link)
                .filter(|(idx, _)| surface.prior().contains(idx) == is_prior)
                .map(|(_, point)| *point)
                .collect();
            assert!(!found.is_empty(), "{name} {is_prior}");
            found
        };
        // The Allegro's fingers bend toward x, and its palm looks there.
        for name in ["base_link", "link_1.0", "link_2.0", "link_3.0"] {
            assert!(
                of(name, true)
                    .iter()
                    .all(|point| point.normal_in_link.x > 0.7)
            );
            assert!(
                of(name, false)
                    .iter()
                    .all(|point| point.normal_in_link.x < 0.8)
            );
        }
        // Fingertips touch with what looks inward or ahead.
        let tip = of("link_3.0_tip", true);
        assert!(tip.iter().all(|point| point.normal_in_link.x > -0.1));
    }
}
