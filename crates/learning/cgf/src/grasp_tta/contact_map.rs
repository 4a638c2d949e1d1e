//! The contact map: how near a hand is to each point of an object.

/// Steepness of the map, per meter: the released code's 2 per centimeter.
const PER_M: f64 = 200.0;

/// Returns the contact value at a distance from the hand in meters, and how it changes with the distance (1/m):
/// `1 − 2 (sigmoid(2 d) − ½)` with d in centimeters, 1 at a touch and 0.005 at 3 cm (released code).
pub(crate) fn contact_at(distance_m: f64) -> (f64, f64) {
    let value = 2.0 / (1.0 + (PER_M * distance_m).exp());
    (value, -PER_M * value * (1.0 - value / 2.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_touch_is_one_and_three_centimeters_are_nearly_nothing() {
        assert_eq!(contact_at(0.0).0, 1.0);
        assert!((contact_at(0.03).0 - 0.004_945).abs() < 1e-6);
        assert_eq!(contact_at(10.0), (0.0, 0.0));
        for distance_m in [0.0, 0.002, 0.01, 0.04] {
            let h_m = 1e-6;
            let expected =
                (contact_at(distance_m + h_m).0 - contact_at(distance_m - h_m).0) / (2.0 * h_m);
            assert!((contact_at(distance_m).1 - expected).abs() < 1e-6 * (1.0 + expected.abs()));
        }
    }
}
