//! A superquadric that explains what is seen: boxes, cylinders and ellipsoids with rounded edges are ones.
//!
//! Its surface is where F = ((x/a)^(2/e₂) + (y/b)^(2/e₂))^(e₂/e₁) + (z/c)^(2/e₁) = 1 (Solina and Bajcsy, "Recovery of
//! parametric models from range images: the case for superquadrics with global deformations", 1990, section II); a point p
//! is about |p| · |1 − F^(−e₁/2)| from it (Gross and Boult, "Error of fit measures for recovering parametric solids", 1988).

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

use geometry::{TriMesh, solid};
use nalgebra::{Point3, SMatrix, SVector, UnitQuaternion, Vector3};

use crate::{Observation, observation::bounds};

/// Points of what is seen, and of the surface that is looked at for free space.
const POINTS: usize = 250;
const SURFACE_POINTS: u32 = 12;
/// Range of half sides, in meters, and of the two exponents: from a box with sharp edges to an ellipsoid.
const HALF_M: [f64; 2] = [0.003, 0.25];
const EXPONENTS: [f64; 2] = [0.1, 1.0];
/// Searches end after so many steps, or when one gains less than this share of the cost.
const MAX_STEPS: usize = 25;
const LEAST_GAIN: f64 = 1e-3;
/// Share of the free space's depth that a point of the surface in it costs, and cost of one that is hidden this much
/// deeper behind what is seen: an object that nobody sees the end of is short.
const FREE: f64 = 0.7;
const HIDDEN: f64 = 0.05;
/// Deepest that a point lies in free space, or behind what is seen, and still costs more, in meters.
const DEEPEST_M: f64 = 0.03;
/// Sections of the mesh, and corners of each.
const SECTIONS: u32 = 24;
const CORNERS: u32 = 48;

/// Numbers of a superquadric.
const N: usize = 8;
type Numbers = SVector<f64, N>;

/// A superquadric that stands on the table, its axis c vertical or horizontal.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Superquadric {
    /// Center on the table along x and y, in meters; angle about the vertical, in radians; logarithms of the half sides
    /// a, b and c, in meters; the exponents e₁ and e₂.
    numbers: Numbers,
    is_lying: bool,
}

impl Superquadric {
    /// Fits one to what is seen; `None` if no search ends.
    pub(crate) fn fitted(observation: &Observation) -> Option<Self> {
        let step = observation.points.len().div_ceil(POINTS).max(1);
        let seen: Vec<Point3<f64>> = observation.points.iter().step_by(step).copied().collect();
        let starts = [false, true].into_iter().flat_map(|is_lying| {
            let yaws = [0.0, FRAC_PI_4, FRAC_PI_2];
            yaws.map(|yaw_rad| Self::started(&seen, yaw_rad, is_lying))
        });
        let fits = starts.filter_map(|start| start.improved(observation, &seen));
        let best = fits.min_by(|(a, _), (b, _)| a.total_cmp(b));
        best.map(|(_, fitted)| fitted)
    }

    /// Returns the ellipsoid about what is seen, turned by an angle.
    fn started(seen: &[Point3<f64>], yaw_rad: f64, is_lying: bool) -> Self {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -yaw_rad);
        let (low, high) = bounds(seen.iter().map(|point| turn * point));
        let middle = turn.inverse() * nalgebra::center(&low, &high);
        let half_m = (0.5 * (high - low)).map(|half| half.clamp(HALF_M[0], HALF_M[1]).ln());
        // The lowest point is on the table.
        let height_m = (0.5 * high.z).clamp(HALF_M[0], HALF_M[1]).ln();
        let [a, b, c] = if is_lying {
            [half_m.y, height_m, half_m.x]
        } else {
            [half_m.x, half_m.y, height_m]
        };
        Self {
            numbers: [middle.x, middle.y, yaw_rad, a, b, c, 0.5, 0.5].into(),
            is_lying,
        }
    }

    /// Half sides a, b and c, in meters.
    fn half_m(&self) -> [f64; 3] {
        [3, 4, 5].map(|idx| self.numbers[idx].exp())
    }

    /// Returns the rotation of its axes a, b and c in the object's frame, and its center there.
    fn pose(&self) -> (UnitQuaternion<f64>, Vector3<f64>) {
        let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.numbers[2]);
        let [_, b, c] = self.half_m();
        // Lying, c is along x, a along y and b along z.
        let lying = UnitQuaternion::new(Vector3::repeat(1.0).normalize() * (TAU / 3.0));
        let (rotation, height_m) = if self.is_lying {
            (yaw * lying, b)
        } else {
            (yaw, c)
        };
        let center = Vector3::new(self.numbers[0], self.numbers[1], height_m);
        (rotation, center)
    }

    /// Returns how far a point is outside, in meters; negative inside.
    fn outside_m(&self, point: &Point3<f64>) -> f64 {
        let (rotation, center) = self.pose();
        let own = rotation.inverse() * (point.coords - center);
        let [a, b, c] = self.half_m();
        let [e1, e2] = [self.numbers[6], self.numbers[7]];
        // Its powers are those of numbers near the largest: their sum neither overflows nor vanishes.
        let scaled = Vector3::new(own.x / a, own.y / b, own.z / c).abs();
        let largest = scaled.max();
        if largest < 1e-6 {
            return -a.min(b).min(c);
        }
        let [x, y, z] = (scaled / largest).into();
        let round = (x.powf(2.0 / e2) + y.powf(2.0 / e2)).powf(e2 / e1);
        let size = largest * (round + z.powf(2.0 / e1)).powf(0.5 * e1);
        own.norm() * (1.0 - 1.0 / size)
    }

    /// Returns points of its surface, by the angles of an ellipsoid.
    fn surface(&self) -> impl Iterator<Item = Point3<f64>> + '_ {
        let (rotation, center) = self.pose();
        let [a, b, c] = self.half_m();
        let power = |x: f64, e: f64| x.signum() * x.abs().powf(e);
        let [e1, e2] = [self.numbers[6], self.numbers[7]];
        let share = |k: u32| (f64::from(k) + 0.5) / f64::from(SURFACE_POINTS);
        let rows = (0..SURFACE_POINTS).map(move |k| PI * share(k) - FRAC_PI_2);
        rows.flat_map(move |row: f64| {
            (0..SURFACE_POINTS).map(move |k| {
                let around = TAU * share(k);
                let ring = power(row.cos(), e1);
                let own = Vector3::new(
                    a * ring * power(around.cos(), e2),
                    b * ring * power(around.sin(), e2),
                    c * power(row.sin(), e1),
                );
                Point3::from(rotation * own + center)
            })
        })
    }

    /// Returns how far the seen points are from it, and what of its surface is where it cannot be, in meters.
    fn residuals(&self, observation: &Observation, seen: &[Point3<f64>]) -> Vec<f64> {
        let of_surface = |point: Point3<f64>| {
            let free_m = observation.free_m(&point).clamp(-DEEPEST_M, DEEPEST_M);
            if free_m > 0.0 {
                FREE * free_m
            } else {
                HIDDEN * free_m
            }
        };
        let surface_n = f64::from(SURFACE_POINTS * SURFACE_POINTS);
        let evenly = (seen.len() as f64 / surface_n).sqrt();
        let seen = seen.iter().map(|point| self.outside_m(point));
        seen.chain(self.surface().map(|point| evenly * of_surface(point)))
            .collect()
    }

    /// Minimizes the sum of squared residuals (Levenberg, "A method for the solution of certain non-linear problems in
    /// least squares", 1944), each scaled by its own size beyond 5 mm, so that what is no part of the shape counts less;
    /// returns the cost per seen point, in m².
    fn improved(self, observation: &Observation, seen: &[Point3<f64>]) -> Option<(f64, Self)> {
        const STEPS: [f64; N] = [1e-4, 1e-4, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3];
        const ROBUST_M: f64 = 0.005;
        let robust = |residuals: Vec<f64>| {
            let scaled = residuals.into_iter();
            let scaled = scaled.map(|r| r / (1.0 + (r / ROBUST_M).powi(2)).powf(0.25));
            scaled.collect::<Vec<f64>>()
        };
        let cost = |residuals: &[f64]| residuals.iter().map(|r| r * r).sum::<f64>();
        let mut best = self;
        let mut residuals = robust(best.residuals(observation, seen));
        let mut damping = 1e-3;
        for _ in 0..MAX_STEPS {
            let mut square = SMatrix::<f64, N, N>::zeros();
            let mut slope = Numbers::zeros();
            let columns = STEPS.iter().enumerate().map(|(idx, &step)| {
                let mut moved = best;
                moved.numbers[idx] += step;
                let moved = robust(moved.residuals(observation, seen));
                let differences = moved.iter().zip(&residuals);
                differences.map(|(to, from)| (to - from) / step).collect()
            });
            let columns: Vec<Vec<f64>> = columns.collect();
            for (row, one) in columns.iter().enumerate() {
                slope[row] = one.iter().zip(&residuals).map(|(a, b)| a * b).sum();
                for (column, other) in columns.iter().enumerate() {
                    square[(row, column)] = one.iter().zip(other).map(|(a, b)| a * b).sum();
                }
            }
            let before = cost(&residuals);
            let mut gained = false;
            while damping < 1e6 {
                let mut damped = square;
                for idx in 0..N {
                    damped[(idx, idx)] += damping * square[(idx, idx)] + 1e-12;
                }
                let moved = best.moved(&damped.cholesky()?.solve(&slope));
                let found = robust(moved.residuals(observation, seen));
                if cost(&found) < before {
                    (best, residuals, gained) = (moved, found, true);
                    damping *= 0.2;
                    break;
                }
                damping *= 5.0;
            }
            if !gained || cost(&residuals) > (1.0 - LEAST_GAIN) * before {
                break;
            }
        }
        let cost = cost(&residuals) / seen.len() as f64;
        cost.is_finite().then_some((cost, best))
    }

    fn moved(self, against: &Numbers) -> Self {
        let mut numbers = self.numbers - against;
        for idx in 3..6 {
            numbers[idx] = numbers[idx].clamp(HALF_M[0].ln(), HALF_M[1].ln());
        }
        for idx in 6..8 {
            numbers[idx] = numbers[idx].clamp(EXPONENTS[0], EXPONENTS[1]);
        }
        Self { numbers, ..self }
    }

    /// Returns its closed surface in the object's frame.
    pub(crate) fn mesh(&self) -> TriMesh {
        let (rotation, center) = self.pose();
        let [a, b, c] = self.half_m();
        let [e1, e2] = [self.numbers[6], self.numbers[7]];
        let section = |k: u32| {
            let row = PI * (f64::from(k) + 0.5) / f64::from(SECTIONS) - FRAC_PI_2;
            let ring = row.cos().powf(e1);
            let z = c * row.sin().signum() * row.sin().abs().powf(e1);
            let ring = solid::ellipse(a * ring, b * ring, 2.0 / e2, z, CORNERS);
            let placed = ring.iter().map(|point| rotation * point + center);
            placed.collect::<Vec<Point3<f64>>>()
        };
        solid::loft(&(0..SECTIONS).map(section).collect::<Vec<_>>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn posed(is_lying: bool, exponents: [f64; 2]) -> Superquadric {
        let [e1, e2] = exponents;
        let half_m = [0.03_f64, 0.02, 0.05].map(f64::ln);
        let [a, b, c] = half_m;
        Superquadric {
            numbers: [0.1, -0.2, 0.4, a, b, c, e1, e2].into(),
            is_lying,
        }
    }

    #[test]
    fn points_of_the_surface_are_on_it_and_it_stands_on_the_table() {
        for is_lying in [false, true] {
            for exponents in [[1.0, 1.0], [0.3, 1.0], [0.2, 0.2]] {
                let shape = posed(is_lying, exponents);
                for point in shape.surface() {
                    assert!(shape.outside_m(&point).abs() < 1e-9);
                    let outward =
                        Point3::from(shape.pose().1 + 1.1 * (point.coords - shape.pose().1));
                    let outside_m = shape.outside_m(&outward);
                    let expected_m = 0.1 * (point.coords - shape.pose().1).norm();
                    assert!((outside_m - expected_m).abs() < 1e-9, "{outside_m}");
                }
                let mesh = shape.mesh();
                assert!(mesh.is_watertight() && mesh.volume_m3() > 0.0);
                let (low, high) = mesh.bounds();
                let height_m = if is_lying { 0.04 } else { 0.1 };
                assert!(low.z.abs() < 2e-3 && (high.z - height_m).abs() < 2e-3);
            }
        }
        let ellipsoid = posed(false, [1.0, 1.0]).mesh().volume_m3();
        let expected = 4.0 / 3.0 * std::f64::consts::PI * 0.03 * 0.02 * 0.05;
        assert!((ellipsoid / expected - 1.0).abs() < 0.03);
    }
}
