//! Fixed points on a hand's surface, and their positions for a hand's numbers.

use std::sync::Arc;

use nalgebra::Vector3;
use robot::{RobotModel, SurfacePoint};

use crate::{
    hand_numbers::PALM_WIDTH,
    kinematics::{Forces, Posed},
    precision::narrow,
};

/// A hand and points spread over its surface.
#[derive(Debug, Clone)]
pub struct HandSurface {
    pub(crate) hand: Arc<RobotModel>,
    points: Vec<SurfacePoint>,
    /// Indices of the hand prior: points with which hands of its kind touch objects.
    prior: Vec<usize>,
}

/// A hand's surface at the pose that its numbers give.
pub(crate) struct PlacedSurface<'a> {
    surface: &'a HandSurface,
    posed: Posed<'a>,
    in_palm: Vec<Vector3<f64>>,
    /// The points, in the frame in which the numbers are, in meters.
    pub(crate) points: Vec<Vector3<f64>>,
}

impl HandSurface {
    /// Takes points of a hand's links, and which of them, by number, are the hand prior.
    ///
    /// # Panics
    ///
    /// Panics if a point is of a link that the hand does not have, or the prior has a point that is not there.
    pub fn new(hand: Arc<RobotModel>, points: Vec<SurfacePoint>, prior: Vec<usize>) -> Self {
        let links_n = hand.links().len();
        assert!(
            points.iter().all(|point| point.link < links_n),
            "a point of a link that is not the hand's"
        );
        assert!(
            prior.iter().all(|&idx| idx < points.len()),
            "a point of the prior that is not the hand's"
        );
        Self {
            hand,
            points,
            prior,
        }
    }

    /// Returns the points.
    pub fn points(&self) -> &[SurfacePoint] {
        &self.points
    }

    /// Returns the points that hands of its kind touch with, by number.
    pub fn prior(&self) -> &[usize] {
        &self.prior
    }

    /// Returns the number of points.
    pub(crate) fn len(&self) -> usize {
        self.points.len()
    }

    /// Numbers of a hand: translation, two columns of the rotation, joint positions.
    pub(crate) fn width(&self) -> usize {
        PALM_WIDTH + self.hand.dof()
    }

    /// Places the points of a hand with these numbers, in meters and radians.
    pub(crate) fn placed(&self, row: &[f32]) -> PlacedSurface<'_> {
        let posed = Posed::new(&self.hand, row);
        let in_palm: Vec<Vector3<f64>> = self
            .points
            .iter()
            .map(|point| (posed.palm_from_links[point.link] * point.point_in_link).coords)
            .collect();
        PlacedSurface {
            points: in_palm.iter().map(|point| posed.seen(point)).collect(),
            in_palm,
            posed,
            surface: self,
        }
    }
}

impl PlacedSurface<'_> {
    /// Returns the points as `f32`.
    pub(crate) fn narrowed(&self) -> Vec<[f32; 3]> {
        self.points.iter().map(narrowed).collect()
    }

    /// Returns the numbers of the prior's points, and their places.
    pub(crate) fn prior(&self) -> (&[usize], Vec<[f32; 3]>) {
        let prior = &self.surface.prior;
        let places = prior.iter().map(|&idx| narrowed(&self.points[idx]));
        (prior, places.collect())
    }

    /// Returns the outward unit normal at a point.
    pub(crate) fn normal(&self, idx: usize) -> Vector3<f64> {
        let point = &self.surface.points[idx];
        let in_palm = self.posed.palm_from_links[point.link].rotation * point.normal_in_link;
        self.posed.turned(&in_palm)
    }

    /// Takes gradients by the points to the gradient by the hand's numbers.
    pub(crate) fn gradient(&self, by_points: &[Vector3<f64>], by_row: &mut [f32]) {
        let mut forces = Forces::on(&self.posed);
        let points = self.surface.points.iter().zip(&self.in_palm);
        for ((point, in_palm), by) in points.zip(by_points) {
            if *by != Vector3::zeros() {
                forces.push(point.link, in_palm, by);
            }
        }
        forces.generalized(by_row);
    }
}

fn narrowed(point: &Vector3<f64>) -> [f32; 3] {
    [narrow(point.x), narrow(point.y), narrow(point.z)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grasp_tta::fixture;

    #[test]
    fn points_are_where_their_links_are_and_their_gradient_is_that_of_their_places() {
        let surface = fixture::surface();
        let row = fixture::row();
        let placed = surface.placed(&row);
        // The second ball slides on the first hinge: its points are 2 cm from its center.
        let ball = surface.points().iter().rposition(|point| point.link == 2);
        let ball = ball.unwrap();
        let center = placed.points[ball] - placed.normal(ball) * 0.02;
        let off_m = (placed.points[ball - 1] - center).norm() - 0.02;
        assert!(off_m.abs() < 1e-6, "{off_m}");
        let weights: Vec<Vector3<f64>> = (0..surface.len())
            .map(|idx| Vector3::new(idx as f64, 1.0, -0.5 * idx as f64) / 100.0)
            .collect();
        let mut found = vec![0.0; row.len()];
        placed.gradient(&weights, &mut found);
        let value = |row: &[f32]| {
            let points = surface.placed(row).points;
            points
                .iter()
                .zip(&weights)
                .map(|(p, w)| p.dot(w))
                .sum::<f64>()
        };
        for k in 0..row.len() {
            let moved = |by: f32| {
                let mut moved = row.clone();
                moved[k] += by;
                moved
            };
            let (low, high) = (moved(-1e-3), moved(1e-3));
            let expected = (value(&high) - value(&low)) / f64::from(high[k] - low[k]);
            let off = (expected - f64::from(found[k])).abs();
            assert!(
                off < 1e-4 * (1.0 + expected.abs()),
                "{k}: {expected} {}",
                found[k]
            );
        }
    }
}
