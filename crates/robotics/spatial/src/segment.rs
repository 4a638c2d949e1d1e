//! Bounds of position, velocity and acceleration of a polynomial of fifth degree between its ends.
//!
//! In Bernstein form a polynomial on an interval is a mean of its coefficients, so that no convex measure of
//! it is greater than that of one of them; the coefficients of its derivative are differences of its own,
//! and those on each half of the interval are means of its own (Farin, *Curves and Surfaces for CAGD*, 5th
//! ed. 2002, §4.2, §5.3 and §6.1). Halving brings the coefficients to the polynomial with the square of
//! the interval's length (Prautzsch, Boehm and Paluszny, *Bézier and B-Spline Techniques*, 2002, §3.5):
//! where the greatest value may lie, and only there, it is sought further.

use std::ops::{Add, Mul, Sub};

use nalgebra::Vector3;

/// Largest excess of a bound over the greatest value, relative to the greatest coefficient.
const BOUND_TOLERANCE: f64 = 1e-9;
/// Maximum number of halvings of a segment.
const HALVINGS: u32 = 40;

/// Type of a polynomial's coefficients: a number or a vector.
pub trait Coefficient:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<f64, Output = Self>
{
    /// Returns its absolute value or length.
    fn size(&self) -> f64;
}

impl Coefficient for f64 {
    fn size(&self) -> f64 {
        self.abs()
    }
}

impl Coefficient for Vector3<f64> {
    fn size(&self) -> f64 {
        self.norm()
    }
}

/// The polynomial of fifth degree between two ends that has both ends' positions, velocities and
/// accelerations ([`crate::quintic`]), by its Bernstein coefficients and those of its derivatives.
///
/// No bound is less than the polynomial's greatest value, and none exceeds it by more than a billionth
/// of the greatest coefficient.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QuinticSegment<T> {
    position: [T; 6],
    velocity: [T; 5],
    acceleration: [T; 4],
}

impl<T: Coefficient> QuinticSegment<T> {
    /// Takes position, velocity and acceleration at both ends, `duration` apart; without a duration it
    /// stays at its start.
    pub fn new(from: [T; 3], to: [T; 3], duration: f64) -> Self {
        let ([p0, v0, a0], [p1, v1, a1]) = (from, to);
        if duration.is_nan() || duration <= 0.0 {
            return Self {
                position: [p0; 6],
                velocity: [v0; 5],
                acceleration: [a0; 4],
            };
        }
        let h = duration;
        let p = [
            p0,
            p0 + v0 * (h / 5.0),
            p0 + v0 * (0.4 * h) + a0 * (h * h / 20.0),
            p1 - v1 * (0.4 * h) + a1 * (h * h / 20.0),
            p1 - v1 * (h / 5.0),
            p1,
        ];
        let v = [
            v0,
            v0 + a0 * (h / 4.0),
            (p[3] - p[2]) * (5.0 / h),
            v1 - a1 * (h / 4.0),
            v1,
        ];
        Self {
            position: p,
            velocity: v,
            acceleration: [a0, (v[2] - v[1]) * (4.0 / h), (v[3] - v[2]) * (4.0 / h), a1],
        }
    }

    /// Returns the greatest speed, or `least` if it is no greater.
    pub fn max_speed(&self, least: f64) -> f64 {
        greatest(self.velocity, T::size, least)
    }

    /// Returns the greatest acceleration, whichever way, or `least` if it is no greater.
    pub fn max_acceleration(&self, least: f64) -> f64 {
        greatest(self.acceleration, T::size, least)
    }

    /// Returns both halves, by time.
    pub(crate) fn halves(&self) -> [Self; 2] {
        let (p, v, a) = (
            halves(self.position),
            halves(self.velocity),
            halves(self.acceleration),
        );
        [0, 1].map(|half| Self {
            position: p[half],
            velocity: v[half],
            acceleration: a[half],
        })
    }

    /// Returns bounds of position, velocity and acceleration, and of the third derivative of a segment that
    /// lasts `duration`.
    pub(crate) fn hull(&self, duration: f64) -> [f64; 4] {
        let [a, b, c, d] = self.acceleration;
        let jerk = [b - a, c - b, d - c].map(|change| change * (3.0 / duration));
        [
            largest(&self.position, T::size),
            largest(&self.velocity, T::size),
            largest(&self.acceleration, T::size),
            largest(&jerk, T::size),
        ]
    }
}

impl QuinticSegment<f64> {
    /// Returns the least and the greatest position.
    pub fn range(&self) -> [f64; 2] {
        let most = |sign: f64| greatest(self.position, |p| sign * p, f64::NEG_INFINITY);
        [-most(-1.0), most(1.0)]
    }
}

/// Returns the greatest value of a convex measure over a polynomial, or `least` if it is no greater;
/// infinity where a number is not finite.
fn greatest<T: Coefficient, const N: usize>(
    coefficients: [T; N],
    measure: impl Fn(&T) -> f64 + Copy,
    least: f64,
) -> f64 {
    let mut largest: f64 = 0.0;
    for value in coefficients.iter().map(measure) {
        if !value.is_finite() {
            return f64::INFINITY;
        }
        largest = largest.max(value.abs());
    }
    search(
        coefficients,
        measure,
        BOUND_TOLERANCE * largest,
        HALVINGS,
        least,
    )
}

fn search<T: Coefficient, const N: usize>(
    coefficients: [T; N],
    measure: impl Fn(&T) -> f64 + Copy,
    exact: f64,
    halvings: u32,
    least: f64,
) -> f64 {
    let bound = largest(&coefficients, measure);
    // The first and the last coefficient are values of the polynomial.
    let ends = [coefficients.first(), coefficients.last()];
    let ends = ends.into_iter().flatten().map(measure);
    let least = ends.fold(least, f64::max);
    if bound <= least + exact || halvings == 0 {
        return bound.max(least);
    }
    let halves = halves(coefficients).into_iter();
    halves.fold(least, |least, half| {
        search(half, measure, exact, halvings - 1, least)
    })
}

fn largest<T>(coefficients: &[T], measure: impl Fn(&T) -> f64) -> f64 {
    let measures = coefficients.iter().map(measure);
    measures.fold(f64::NEG_INFINITY, f64::max)
}

/// Returns the coefficients on both halves of the interval, by de Casteljau's algorithm.
fn halves<T: Coefficient, const N: usize>(coefficients: [T; N]) -> [[T; N]; 2] {
    let (mut left, mut right) = (coefficients, coefficients);
    for round in 1..N {
        for idx in (round..N).rev() {
            left[idx] = left[idx - 1] * 0.5 + left[idx] * 0.5;
        }
        for idx in 0..N - round {
            right[idx] = right[idx] * 0.5 + right[idx + 1] * 0.5;
        }
    }
    [left, right]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::quintic;

    /// Moments of a segment that are looked at.
    const LOOKS: u32 = 4000;

    fn end() -> impl Strategy<Value = [f64; 3]> {
        [-2.0..2.0_f64, -5.0..5.0_f64, -40.0..40.0_f64]
    }

    proptest! {
        /// No bound is exceeded, and each is reached.
        #[test]
        fn bounds_are_the_extremes_of_the_polynomial(
            from in end(),
            to in end(),
            h in 0.002..2.0_f64,
        ) {
            let segment = QuinticSegment::new(from, to, h);
            let [low, high] = segment.range();
            let [speed, acceleration] =
                [segment.max_speed(0.0), segment.max_acceleration(0.0)];
            let mut seen = [f64::INFINITY, f64::NEG_INFINITY, 0.0, 0.0];
            for look in 0..=LOOKS {
                let [p, v, a] = quintic(from, to, h, h * f64::from(look) / f64::from(LOOKS));
                seen = [seen[0].min(p), seen[1].max(p), seen[2].max(v.abs()), seen[3].max(a.abs())];
            }
            let found = [-low, high, speed, acceleration];
            let seen = [-seen[0], seen[1], seen[2], seen[3]];
            let scale = [1.0, 1.0, 1.0 / h, 1.0 / (h * h)].map(|unit| unit * (4.0 + 10.0 * h + 80.0 * h * h));
            for ((found, seen), scale) in found.into_iter().zip(seen).zip(scale) {
                prop_assert!(found >= seen - 1e-12 * scale, "{found} {seen}");
                prop_assert!(found <= seen + 1e-5 * scale, "{found} {seen}");
            }
            prop_assert_eq!(segment.max_speed(2.0 * speed), 2.0 * speed);
        }

        /// A vector's length is bounded, not that of its numbers.
        #[test]
        fn bounds_of_vectors_are_lengths(
            from in [end(), end(), end()],
            to in [end(), end(), end()],
            h in 0.002..2.0_f64,
        ) {
            let vectors = |numbers: [[f64; 3]; 3]| {
                [0, 1, 2].map(|order| Vector3::from_fn(|axis, _| numbers[axis][order]))
            };
            let segment = QuinticSegment::new(vectors(from), vectors(to), h);
            let (mut speed, mut acceleration) = (0.0_f64, 0.0_f64);
            for look in 0..=LOOKS {
                let time = h * f64::from(look) / f64::from(LOOKS);
                let axes = [0, 1, 2].map(|axis| quintic(from[axis], to[axis], h, time));
                let order = |order: usize| Vector3::from_fn(|axis, _| axes[axis][order]).norm();
                speed = speed.max(order(1));
                acceleration = acceleration.max(order(2));
            }
            for (found, seen) in [
                (segment.max_speed(0.0), speed),
                (segment.max_acceleration(0.0), acceleration),
            ] {
                prop_assert!((1.0 - 1e-9..1.0 + 1e-3).contains(&(found / seen)), "{found} {seen}");
            }
        }
    }

    #[test]
    fn numbers_that_overflow_are_bounded_by_infinity() {
        for big in [1e307, f64::MAX, f64::NAN] {
            let segment = QuinticSegment::new([0.0, -big, big], [big, big, -big], 1e-3);
            assert_eq!(segment.max_speed(1.0), f64::INFINITY);
            assert_eq!(segment.max_acceleration(1.0), f64::INFINITY);
        }
    }

    #[test]
    fn zero_duration_stays_at_its_start() {
        let segment = QuinticSegment::new([0.5, -2.0, 3.0], [9.0, 9.0, 9.0], 0.0);
        assert_eq!(segment.range(), [0.5, 0.5]);
        assert_eq!(segment.max_speed(0.0), 2.0);
        assert_eq!(segment.max_acceleration(0.0), 3.0);
    }
}
