//! The symmetry that explains what a view does not show.
//!
//! A symmetry of an object maps what is seen of it to what is not. Where it maps a point into space that a camera saw to be
//! free, it is wrong (Bohg et al., "Mind the gap: robotic grasping under incomplete observation", 2011, section IV).

use std::f64::consts::PI;

use nalgebra::{Point3, Vector2};

use crate::{Observation, observation::bounds};

/// Points of which images are looked at.
const POINTS: usize = 250;
/// Directions of mirror planes, over half a turn.
const DIRECTIONS: u32 = 16;
/// Mirror planes face the camera within this angle: others complete no back (rad).
const FACING_RAD: f64 = 1.1;
/// Farthest that a center is beside the middle of what is seen, in meters.
const BESIDE_M: f64 = 0.02;
/// Distance between centers or planes that are tried, in meters.
const STEP_M: f64 = 0.005;
/// Finest such distance, in meters.
const FINEST_M: f64 = 0.0012;
/// Farthest that an image lies in free space, or behind the seen surface, and still counts more for it, in meters.
const DEEPEST_M: f64 = 0.02;
/// Cost of an image that is this much farther behind the surface, relative to free space: what is hidden should be small.
const HIDDEN: f64 = 0.12;
/// Mean cost above which an object has no symmetry, in meters.
const WORST_M: f64 = 0.0035;

/// A symmetry of an object that stands on a table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Symmetry {
    /// Half a turn about the vertical through a point.
    HalfTurn(Vector2<f64>),
    /// A vertical mirror plane: its points x have (cos a, sin a) · x = offset.
    Mirror {
        /// The angle a, in radians.
        direction_rad: f64,
        /// The offset, in meters.
        offset_m: f64,
    },
}

impl Symmetry {
    /// Returns the image of a point.
    pub(crate) fn image(&self, point: &Point3<f64>) -> Point3<f64> {
        match *self {
            Self::HalfTurn(center) => {
                Point3::new(2.0 * center.x - point.x, 2.0 * center.y - point.y, point.z)
            }
            Self::Mirror {
                direction_rad,
                offset_m,
            } => {
                let (sin, cos) = direction_rad.sin_cos();
                let off = 2.0 * (offset_m - cos * point.x - sin * point.y);
                Point3::new(point.x + off * cos, point.y + off * sin, point.z)
            }
        }
    }

    /// Returns it moved along its parameters: a center along x and y, a plane along its normal and about the vertical.
    fn moved(&self, first: f64, second: f64) -> Self {
        match *self {
            Self::HalfTurn(center) => Self::HalfTurn(center + Vector2::new(first, second)),
            Self::Mirror {
                direction_rad,
                offset_m,
            } => Self::Mirror {
                // A radian at 5 cm from the axis.
                direction_rad: direction_rad + second / 0.05,
                offset_m: offset_m + first,
            },
        }
    }
}

/// Returns the best half turn and the best mirror plane of those that agree with what is seen, the better one first.
pub(crate) fn symmetries(observation: &Observation) -> Vec<Symmetry> {
    let step = observation.points.len().div_ceil(POINTS).max(1);
    let points: Vec<Point3<f64>> = observation.points.iter().step_by(step).copied().collect();
    let cost_m = |symmetry: &Symmetry| {
        let of = |point: &Point3<f64>| {
            let free_m = observation.free_m(&symmetry.image(point));
            if free_m > 0.0 {
                free_m.min(DEEPEST_M)
            } else {
                HIDDEN * (-free_m).min(2.0 * DEEPEST_M)
            }
        };
        points.iter().map(of).sum::<f64>() / points.len() as f64
    };
    let (low, high) = bounds(points.iter().copied());
    // The seen side is the near one, and the camera looks along x: centers are in its middle or beyond.
    let depth_m = (high.x - low.x).max(high.y - low.y);
    let beyond = || steps(low.x, high.x + 0.5 * depth_m);
    let middle = 0.5 * (low.y + high.y);
    let turns = beyond().flat_map(|x| {
        let beside = steps(middle - BESIDE_M, middle + BESIDE_M);
        beside.map(move |y| Symmetry::HalfTurn(Vector2::new(x, y)))
    });
    let directions = (0..DIRECTIONS).map(|k| PI * f64::from(k) / f64::from(DIRECTIONS) - 0.5 * PI);
    let facing = directions.filter(|direction_rad| direction_rad.abs() <= FACING_RAD);
    let mirrors = facing.flat_map(|direction_rad| {
        beyond().map(move |offset_m| Symmetry::Mirror {
            direction_rad,
            offset_m,
        })
    });
    let mut found: Vec<(f64, Symmetry)> = [best(turns, cost_m), best(mirrors, cost_m)]
        .into_iter()
        .flatten()
        .filter(|&(cost_m, _)| cost_m < WORST_M)
        .collect();
    found.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    found.into_iter().map(|(_, symmetry)| symmetry).collect()
}

/// Returns the symmetry of the least cost, moved to where the cost is least near it.
fn best(
    tried: impl Iterator<Item = Symmetry>,
    cost_m: impl Fn(&Symmetry) -> f64,
) -> Option<(f64, Symmetry)> {
    let costs = tried.map(|symmetry| (cost_m(&symmetry), symmetry));
    let mut best = costs.min_by(|(a, _), (b, _)| a.total_cmp(b))?;
    let mut step_m = 0.5 * STEP_M;
    while step_m >= FINEST_M {
        let from = best;
        for (first, second) in [(step_m, 0.0), (-step_m, 0.0), (0.0, step_m), (0.0, -step_m)] {
            let moved = from.1.moved(first, second);
            let cost_m = cost_m(&moved);
            if cost_m < best.0 {
                best = (cost_m, moved);
            }
        }
        if best.0 >= from.0 {
            step_m *= 0.5;
        }
    }
    Some(best)
}

/// Returns lengths from one to another.
fn steps(from: f64, to: f64) -> impl Iterator<Item = f64> {
    let n = ((to - from) / STEP_M).ceil().clamp(1.0, 100.0);
    let numbers = (0..=100_u32).map(f64::from);
    numbers
        .take_while(move |&k| k <= n)
        .map(move |k| from + k * STEP_M)
}
