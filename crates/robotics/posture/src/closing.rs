//! Closing of a hand on an object: its openness over time, and the contacts of its fingertips at the grasp.

/// A fingertip counts as touching in full up to the contact distance and not at all at this multiple of it, so that
/// contacts come and go smoothly.
const CONTACT_FADE: f64 = 1.5;

/// Returns the openness of the hand, from 0 at the grasp to 1 where it begins to close, without a kink.
///
/// `remaining` is the time left until the grasp and `closing` the time for which the hand closes, in the same unit.
pub fn openness(remaining: f64, closing: f64) -> f64 {
    if closing <= 0.0 {
        return if remaining > 0.0 { 1.0 } else { 0.0 };
    }
    let x = (remaining / closing).clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// Returns the contact weight of a fingertip at a distance from the surface, from 1 (touches it) to 0; a contact
/// distance of 0 means that no fingertip touches.
pub fn contact_share(distance_m: f64, contact_distance_m: f64) -> f64 {
    if contact_distance_m <= 0.0 {
        return 0.0;
    }
    let beyond = distance_m / contact_distance_m - 1.0;
    (1.0 - beyond / (CONTACT_FADE - 1.0)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closing_is_smooth_and_contact_fades() {
        assert_eq!(
            (openness(0.0, 0.3), openness(0.3, 0.3), openness(9.0, 0.3)),
            (0.0, 1.0, 1.0)
        );
        assert_eq!((openness(0.0, 0.0), openness(0.1, 0.0)), (0.0, 1.0));
        assert_eq!(
            (
                contact_share(-0.01, 0.015),
                contact_share(0.015, 0.015),
                contact_share(0.0225, 0.015)
            ),
            (1.0, 1.0, 0.0)
        );
        assert_eq!(
            (contact_share(0.0, 0.0), contact_share(-0.01, 0.0)),
            (0.0, 0.0)
        );
    }
}
