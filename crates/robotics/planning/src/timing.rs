//! Time parameterization of a motion: at the requested speed wherever limits allow it, from rest to
//! rest.
//!
//! Under limits on speed and acceleration, the speed along a path is found in one pass backward,
//! for the greatest speed from which the rest can still be followed, and one pass forward, as fast
//! as that allows (Bobrow, Dubowsky and Gibson, *Time-Optimal Control of Robotic Manipulators Along
//! Specified Paths*, 1985; Pham and Pham, *A New Approach to Time-Optimal Path Parameterization
//! Based on Reachability Analysis*, 2018, §III). The unknown at each grid point u of the path is x, the
//! square of the speed u′; with constant u″ between two grid points, x changes by 2 Δ u″. Velocities of
//! the hand are its derivatives along the path times u′, accelerations `p″ x + p′ u″`. Their limits
//! bound the lengths of vectors, which are convex in x and u″ and within the limits at rest, so the
//! feasible speeds at a grid point are all those up to a greatest one.
//!
//! Such a timing has jumps in u″, which a controller could not reproduce from sampled positions,
//! velocities and accelerations. So u is replaced by its moving average over a short time window:
//! u″ becomes continuous, and neither u′ nor u″ is ever greater than before (Biagiotti and
//! Melchiorri, *FIR Filters for Online Trajectory Planning with Time- and Frequency-Domain
//! Specifications*, 2012, §2).

use crate::{Infeasible, limits::LimitedRates};

/// Number of intervals of the motion's grid at which speeds are computed.
const GRID_N: usize = 600;
/// Bisection steps for a greatest speed.
const HALVINGS: usize = 48;
/// Weight, in 1/s², below which a change of speed has no effect on the motion.
const MIN_WEIGHT: f64 = 1e-18;

/// Grid points of a motion and the times at which they are passed.
#[derive(Debug, Clone)]
pub(crate) struct Timing {
    points: Vec<TimedPoint>,
    /// Averaging window of the motion's time.
    window_s: f64,
}

/// A grid point and the time at which it is passed.
#[derive(Debug, Clone, Copy)]
struct TimedPoint {
    time_s: f64,
    /// Its place: seconds of the motion.
    motion_s: f64,
    /// Seconds of the motion per second.
    speed: f64,
    /// Integral of the motion's time up to here, in s².
    sum: f64,
}

impl Timing {
    /// Returns the fastest timing of a motion that lasts `duration_s`, never faster than `pace`
    /// seconds of the motion per second, averaged over `window_s`. `rates_at` returns the
    /// derivatives by the motion's time at one such time, with their limits.
    ///
    /// # Errors
    ///
    /// Fails as `rates_at` does.
    pub(crate) fn fastest(
        duration_s: f64,
        pace: f64,
        window_s: f64,
        rates_at: impl Fn(f64) -> Result<Vec<LimitedRates>, Infeasible>,
    ) -> Result<Self, Infeasible> {
        let step = duration_s / GRID_N as f64;
        let grid: Vec<GridPoint> = (0..=GRID_N)
            .map(|idx| Ok(GridPoint::new(rates_at(step * idx as f64)?, pace)))
            .collect::<Result<_, Infeasible>>()?;
        let greatest = greatest(&grid, step);
        let mut points = vec![TimedPoint {
            time_s: 0.0,
            motion_s: 0.0,
            speed: 0.0,
            sum: 0.0,
        }];
        let (mut x, mut time_s, mut sum) = (0.0, 0.0, 0.0);
        let pairs = grid.iter().zip(grid.iter().skip(1));
        for (idx, ((from, to), &max)) in pairs.zip(greatest.iter().skip(1)).enumerate() {
            // Rounding may leave an empty range: then the speed is kept, and the sampled motion is
            // checked.
            let faster = changes(from, to, step, x, max).map_or(0.0, |[_, faster]| faster);
            let next = (x + 2.0 * step * faster).clamp(0.0, max);
            let (from_s, to_s) = (step * idx as f64, step * (idx + 1) as f64);
            let lasts_s = 2.0 * step / (x.sqrt() + next.sqrt());
            sum += lasts_s * (0.5 * (from_s + to_s) + (x.sqrt() - next.sqrt()) * lasts_s / 12.0);
            time_s += lasts_s;
            x = next;
            points.push(TimedPoint {
                time_s,
                motion_s: to_s,
                speed: x.sqrt(),
                sum,
            });
        }
        Ok(Self { points, window_s })
    }

    /// Returns the duration in seconds; infinite if the limits allow no motion at all.
    pub(crate) fn duration_s(&self) -> f64 {
        self.passed_s() + self.window_s
    }

    /// Returns the motion's own time at `time_s` after its start, in seconds, and its first and
    /// second derivative by time; both are 0 at the ends, where it rests.
    pub(crate) fn at(&self, time_s: f64) -> [f64; 3] {
        let end_s = self.points.last().map_or(0.0, |point| point.motion_s);
        if time_s <= 0.0 {
            return [0.0; 3];
        }
        if time_s >= self.duration_s() {
            return [end_s, 0.0, 0.0];
        }
        let [now, before] = [time_s, time_s - self.window_s].map(|time_s| self.sums(time_s));
        let [motion_s, speed, faster] =
            [0, 1, 2].map(|order| (now[order] - before[order]) / self.window_s);
        [motion_s.clamp(0.0, end_s), speed, faster]
    }

    /// Returns the time at which the last grid point is passed.
    fn passed_s(&self) -> f64 {
        self.points.last().map_or(0.0, |point| point.time_s)
    }

    /// Returns the integral of the motion's time before averaging, that time and its derivative; at
    /// rest before and after.
    fn sums(&self, time_s: f64) -> [f64; 3] {
        let after = self.points.partition_point(|point| point.time_s <= time_s);
        let Some(from) = after.checked_sub(1).and_then(|idx| self.points.get(idx)) else {
            return [0.0; 3];
        };
        let part_s = time_s - from.time_s;
        let faster = self.points.get(after).map_or(0.0, |to| {
            (to.speed - from.speed) / (to.time_s - from.time_s)
        });
        [
            from.sum
                + part_s * (from.motion_s + part_s * (0.5 * from.speed + part_s * faster / 6.0)),
            from.motion_s + part_s * (from.speed + 0.5 * faster * part_s),
            from.speed + faster * part_s,
        ]
    }

    /// Returns the same timing, slowed down by a factor `times`.
    #[must_use]
    pub(crate) fn slower(&self, times: f64) -> Self {
        let slower = |point: &TimedPoint| TimedPoint {
            time_s: point.time_s * times,
            speed: point.speed / times,
            sum: point.sum * times,
            ..*point
        };
        Self {
            points: self.points.iter().map(slower).collect(),
            window_s: self.window_s * times,
        }
    }
}

/// A grid point of a motion and its speed limits.
struct GridPoint {
    rates: Vec<LimitedRates>,
    /// Greatest x that keeps every velocity within its limit.
    ceiling: f64,
}

impl GridPoint {
    fn new(rates: Vec<LimitedRates>, pace: f64) -> Self {
        let ceiling = rates
            .iter()
            .map(|rates| {
                let speed = rates.velocity.norm_squared();
                if speed > 0.0 {
                    rates.max_velocity.powi(2) / speed
                } else {
                    f64::INFINITY
                }
            })
            .fold(pace * pace, f64::min);
        Self { rates, ceiling }
    }
}

/// Returns for each grid point the greatest x from which the motion can still end at rest.
fn greatest(grid: &[GridPoint], step: f64) -> Vec<f64> {
    let mut greatest = vec![0.0; grid.len()];
    let mut next = 0.0;
    for (idx, pair) in grid.windows(2).enumerate().rev() {
        let [from, to] = pair else { continue };
        let is_possible = |x: f64| changes(from, to, step, x, next).is_some();
        let found = if is_possible(from.ceiling) {
            from.ceiling
        } else {
            let (mut low, mut high) = (0.0, from.ceiling);
            for _ in 0..HALVINGS {
                let middle = 0.5 * (low + high);
                if is_possible(middle) {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            low
        };
        if let Some(slot) = greatest.get_mut(idx) {
            *slot = found;
        }
        next = found;
    }
    greatest
}

/// Returns the least and the greatest u″ from a grid point with speed `x` for which every acceleration
/// up to the next one is within its limit and the next x is between 0 and `max`; `None` if there
/// is none.
fn changes(from: &GridPoint, to: &GridPoint, step: f64, x: f64, max: f64) -> Option<[f64; 2]> {
    let mut range = [-x / (2.0 * step), (max - x) / (2.0 * step)];
    for rates in &from.rates {
        range = within(range, rates, x, 0.0)?;
    }
    for rates in &to.rates {
        range = within(range, rates, x, 2.0 * step)?;
    }
    Some(range)
}

/// Returns the part of a range of u″ in which `|p″ (x + gain u″) + p′ u″|` keeps its limit.
///
/// With `a = p″ x` and `b = p′ + gain p″` the bounds are the roots of `|a + b u″|² = limit²`; of the
/// discriminant's two forms `|b|² limit² − |a × b|²` does not cancel where a and b are parallel, as they
/// are for a joint.
fn within([low, high]: [f64; 2], rates: &LimitedRates, x: f64, gain: f64) -> Option<[f64; 2]> {
    let a = rates.acceleration * (x / rates.max_acceleration);
    let b = (rates.velocity + rates.acceleration * gain) / rates.max_acceleration;
    let square = b.norm_squared();
    let range = if square < MIN_WEIGHT {
        if a.norm_squared() > 1.0 {
            return None;
        }
        [low, high]
    } else {
        let rest = square - a.cross(&b).norm_squared();
        if rest < 0.0 {
            return None;
        }
        let (middle, half) = (-a.dot(&b) / square, rest.sqrt() / square);
        [low.max(middle - half), high.min(middle + half)]
    };
    (range[0] <= range[1]).then_some(range)
}
