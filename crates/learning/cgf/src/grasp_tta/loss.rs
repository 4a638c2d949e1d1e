//! Loss of a grasp, with its gradient by the hand's numbers.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{
    HandSurface, TermWeights,
    contact_map::contact_at,
    nearest::{Cloud, Nearest},
    surface::PlacedSurface,
};
use crate::{hand_numbers::PALM_WIDTH, precision::narrow};

/// Factors and counts of the released code: its sums are over 3000 points of the object and 778 of the hand.
const CONTACT: f64 = 2.5 * 3000.0;
const CONSISTENCY: f64 = 1e-4 * 3000.0;
const PENETRATION: f64 = 120.0 * 3000.0;
const TABLE: f64 = 120.0 * 778.0;
/// Points of the object farther from the prior's, in meters, are not touched (released code).
const REACH_M: f64 = 0.02;
/// Maximum depth of a point inside a hand, in meters: half the thickness of a palm. A point that looks deeper is
/// outside, about an edge beyond which no point of the hand's surface lies.
const MAX_DEPTH_M: f64 = 0.02;
/// Distance below which the direction to a point is not defined, in meters.
const NEAR_M: f64 = 1e-6;

/// The terms of a grasp's loss before they are weighted, in the released code's units.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GraspTerms {
    /// Weighted sum.
    pub total: f64,
    /// 7500 times the mean squared distance (m²) of the prior's points from the points of the object that they reach.
    pub contact: f64,
    /// 0.3 times the mean squared difference of the contact map from the predicted one.
    pub consistency: f64,
    /// 360000 times the mean squared depth (m²) of the object's points in the hand.
    pub penetration: f64,
    /// 93360 times the mean squared depth (m²) of the hand's points in the table.
    pub table: f64,
    /// Squares of joint positions beyond their limits, in rad².
    pub limits: f64,
}

/// Returns the nearest points of a placed hand to an object's, and the contact map there.
pub(crate) fn contact_map(object: &Cloud, hand: &PlacedSurface<'_>) -> (Vec<Nearest>, Vec<f64>) {
    let nearest = object.nearest(&hand.narrowed());
    let value = |near: &Nearest| contact_at(f64::from(near.squared_m2).sqrt()).0;
    let map = nearest.iter().map(value).collect();
    (nearest, map)
}

/// Computes the terms of the hand with these numbers and sets `by_row` to the gradient of their weighted sum.
///
/// `wanted` is the contact map that it should have.
pub(crate) fn grasp_loss(
    surface: &HandSurface,
    weights: &TermWeights,
    row: &[f32],
    object: &Cloud,
    wanted: &[f32],
    by_row: &mut [f32],
) -> GraspTerms {
    let hand = surface.placed(row);
    let mut by_points = vec![Vector3::zeros(); surface.len()];
    let mut terms = GraspTerms {
        contact: contact(object, &hand, weights.contact, &mut by_points),
        table: table(&hand, weights.table, &mut by_points),
        ..GraspTerms::default()
    };
    let n = object.len() as f64;
    let nearest = object.nearest(&hand.narrowed());
    for (idx, (near, wanted)) in nearest.iter().zip(wanted).enumerate() {
        let touching = near.idx as usize;
        let off = hand.points[touching] - place(object, idx);
        let distance_m = off.norm();
        let (value, slope) = contact_at(distance_m);
        let error = value - f64::from(*wanted);
        terms.consistency += CONSISTENCY / n * error * error;
        if distance_m > NEAR_M {
            let factor = weights.consistency * CONSISTENCY / n * 2.0 * error * slope;
            by_points[touching] += off * (factor / distance_m);
        }
        let is_inside = distance_m < MAX_DEPTH_M && off.dot(&hand.normal(touching)) > 0.0;
        if is_inside {
            terms.penetration += PENETRATION / n * distance_m * distance_m;
            by_points[touching] += off * (weights.penetration * PENETRATION / n * 2.0);
        }
    }
    hand.gradient(&by_points, by_row);
    terms.limits = limits(surface, weights.limits, row, by_row);
    terms.total = weights.contact * terms.contact
        + weights.consistency * terms.consistency
        + weights.penetration * terms.penetration
        + weights.table * terms.table
        + weights.limits * terms.limits;
    terms
}

/// Computes the contact term: squared distances of the prior's points from the points of the object that they reach.
fn contact(
    object: &Cloud,
    hand: &PlacedSurface<'_>,
    weight: f64,
    by_points: &mut [Vector3<f64>],
) -> f64 {
    let (prior, places) = hand.prior();
    let nearest = object.nearest(&places);
    let reached: Vec<(usize, Vector3<f64>)> = nearest
        .iter()
        .enumerate()
        .filter(|(_, near)| f64::from(near.squared_m2) < REACH_M * REACH_M)
        .map(|(idx, near)| {
            let touching = prior[near.idx as usize];
            (touching, hand.points[touching] - place(object, idx))
        })
        .collect();
    let factor = CONTACT / reached.len().max(1) as f64;
    for (touching, off) in &reached {
        by_points[*touching] += off * (2.0 * weight * factor);
    }
    factor
        * reached
            .iter()
            .map(|(_, off)| off.norm_squared())
            .sum::<f64>()
}

/// Computes the table term: squared depths of the hand's points in the table.
fn table(hand: &PlacedSurface<'_>, weight: f64, by_points: &mut [Vector3<f64>]) -> f64 {
    let factor = TABLE / hand.points.len().max(1) as f64;
    let mut squares = 0.0;
    for (point, by) in hand.points.iter().zip(by_points) {
        let below_m = point.z.min(0.0);
        squares += below_m * below_m;
        by.z += 2.0 * weight * factor * below_m;
    }
    factor * squares
}

/// Computes the limit term: squares of joint positions beyond their limits.
fn limits(surface: &HandSurface, weight: f64, row: &[f32], by_row: &mut [f32]) -> f64 {
    let mut squares = 0.0;
    let joints = row.iter().zip(by_row).skip(PALM_WIDTH);
    for ((q, by), joint) in joints.zip(surface.hand.joints()) {
        let q = f64::from(*q);
        let beyond = q - joint.clamp(q);
        squares += beyond * beyond;
        *by += narrow(2.0 * weight * beyond);
    }
    squares
}

fn place(object: &Cloud, idx: usize) -> Vector3<f64> {
    Vector3::from(object.point(idx).map(f64::from))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grasp_tta::fixture;

    const NOTHING: TermWeights = TermWeights {
        contact: 0.0,
        consistency: 0.0,
        penetration: 0.0,
        table: 0.0,
        limits: 0.0,
    };

    fn evaluate(weights: &TermWeights, row: &[f32]) -> (GraspTerms, Vec<f32>) {
        let surface = fixture::surface();
        let object = fixture::object();
        let wanted: Vec<f32> = (0..object.len())
            .map(|idx| (idx % 3) as f32 / 3.0)
            .collect();
        let mut by_row = vec![0.0; row.len()];
        let terms = grasp_loss(&surface, weights, row, &object, &wanted, &mut by_row);
        (terms, by_row)
    }

    /// Step of the differences.
    const H: f32 = 1e-5;

    /// Compares each term's gradient with central differences, at a hand that is in object, table and limits at once.
    #[test]
    fn gradients_equal_central_differences() {
        for (name, weights) in [
            (
                "contact",
                TermWeights {
                    contact: 1.0,
                    ..NOTHING
                },
            ),
            (
                "consistency",
                TermWeights {
                    consistency: 10.0,
                    ..NOTHING
                },
            ),
            (
                "penetration",
                TermWeights {
                    penetration: 1.0,
                    ..NOTHING
                },
            ),
            (
                "table",
                TermWeights {
                    table: 1.0,
                    ..NOTHING
                },
            ),
            (
                "limits",
                TermWeights {
                    limits: 1.0,
                    ..NOTHING
                },
            ),
        ] {
            let mut row = fixture::row();
            if name == "penetration" {
                // The first ball's center 6 mm before a side of the cube, where no point is about to enter or to leave
                // it: there the loss jumps.
                row[..3].copy_from_slice(&[-0.05982, 0.0101, -0.0124]);
            }
            let (terms, found) = evaluate(&weights, &row);
            assert!(terms.total > 1e-3, "{name}: {terms:?}");
            let largest = found.iter().fold(0.0_f32, |most, x| most.max(x.abs()));
            for k in 0..row.len() {
                let value = |by: f32| {
                    let mut moved = row.clone();
                    moved[k] += by;
                    evaluate(&weights, &moved).0.total
                };
                // The step after rounding.
                let step = f64::from(row[k] + H) - f64::from(row[k] - H);
                let expected = (value(H) - value(-H)) / step;
                assert!(
                    (expected - f64::from(found[k])).abs() < 0.02 * f64::from(largest),
                    "{name} {k}: {expected} {}",
                    found[k]
                );
            }
        }
    }

    #[test]
    fn a_hand_far_away_has_only_its_contacts_to_regret() {
        let mut row = fixture::row();
        (row[0], row[2]) = (3.0, 3.0);
        row[PALM_WIDTH..].fill(0.0);
        let all = TermWeights::default();
        let (terms, by_row) = evaluate(&all, &row);
        assert_eq!([terms.contact, terms.penetration, terms.table], [0.0; 3]);
        assert!(by_row.iter().all(|x| *x == 0.0), "{by_row:?}");
    }
}
