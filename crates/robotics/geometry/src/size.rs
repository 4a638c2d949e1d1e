//! Whether a mesh can be in meters.

use std::{fmt, ops::RangeInclusive};

use crate::{GeometryError, TriMesh};

/// Plausible lengths of the longest side of an object that a hand grasps, in meters.
pub const OBJECT_SIDES_M: RangeInclusive<f64> = 0.005..=2.0;

/// Most frequent lengths of the longest side, in meters, by which one of several units is chosen.
const LIKELY_SIDES_M: RangeInclusive<f64> = 0.02..=1.0;

/// Meters in the units that meshes come in, the most frequent ones first, and the factors of a mesh
/// that was converted once too often.
const UNITS: [(f64, &str); 6] = [
    (0.001, "millimeters"),
    (0.01, "centimeters"),
    (0.0254, "inches"),
    (1000.0, "thousandths of its unit"),
    (100.0, "hundredths of its unit"),
    (1e-6, "micrometers"),
];

impl TriMesh {
    /// Checks that the longest side along an axis lies in a range of meters.
    ///
    /// # Errors
    ///
    /// Fails if it does not, with the factor of a unit that would bring it there if there is one.
    pub fn check_size(&self, sides_m: &RangeInclusive<f64>) -> Result<(), GeometryError> {
        let (low, high) = self.bounds();
        let sides = high - low;
        let longest = sides.max();
        if sides_m.contains(&longest) {
            return Ok(());
        }
        let fits = |range: &RangeInclusive<f64>| {
            let mut factors = UNITS.iter().map(|&(factor, _)| factor);
            factors.find(|factor| {
                sides_m.contains(&(longest * factor)) && range.contains(&(longest * factor))
            })
        };
        Err(GeometryError::Size {
            sides_m: sides.into(),
            least_m: *sides_m.start(),
            most_m: *sides_m.end(),
            factor: fits(&LIKELY_SIDES_M).or_else(|| fits(sides_m)),
        })
    }
}

/// Names the unit of a factor.
pub(crate) fn unit(factor: f64) -> &'static str {
    let known = UNITS
        .iter()
        .find(|(known, _)| known.total_cmp(&factor).is_eq());
    known.map_or("another unit", |&(_, name)| name)
}

/// A length in three digits.
pub(crate) struct ThreeDigits(pub(crate) f64);

impl fmt::Display for ThreeDigits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0 == 0.0 || !self.0.is_finite() {
            return write!(f, "{}", self.0);
        }
        let digits = 2.0 - self.0.abs().log10().floor();
        if (-4.0..=8.0).contains(&digits) {
            let unit = 10_f64.powf(digits);
            write!(f, "{}", (self.0 * unit).round() / unit)
        } else {
            write!(f, "{:.2e}", self.0)
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;

    #[test]
    fn a_mesh_in_another_unit_is_refused_with_the_factor() {
        let mesh = TriMesh::cuboid(Point3::new(-0.03, -0.04, 0.0), Point3::new(0.03, 0.04, 0.1));
        assert_eq!(mesh.check_size(&OBJECT_SIDES_M), Ok(()));
        for (scale, sides, factor) in [
            (
                1000.0,
                "60 × 80 × 100 m",
                "multiply its coordinates by 0.001",
            ),
            (100.0, "6 × 8 × 10 m", "multiply its coordinates by 0.01"),
            (
                39.37,
                "2.36 × 3.15 × 3.94 m",
                "multiply its coordinates by 0.01",
            ),
            (
                0.001,
                "0.00006 × 0.00008 × 0.0001 m",
                "multiply its coordinates by 1000",
            ),
            (1e9, "6.00e7 × 8.00e7 × 1.00e8 m", "meshes are in meters"),
        ] {
            let scaled = mesh.scaled(&Vector3::repeat(scale));
            let said = scaled.check_size(&OBJECT_SIDES_M).unwrap_err().to_string();
            assert!(said.contains(sides) && said.ends_with(factor), "{said}");
        }
    }
}
