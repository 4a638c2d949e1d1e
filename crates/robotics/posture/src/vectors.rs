//! Vectors between two points of a hand that follow target vectors.
//!
//! Each end pulls as a targeted point does. What couples the ends, second derivatives by a joint above one and a joint
//! above the other, is added here; [`crate::layout`] has a place for it.

use nalgebra::{Matrix3, Vector3};

use crate::{
    SolverError,
    compiled::{Body, BodyPoint, CompiledHand},
    evaluate::{Evaluation, Pull, columns},
    layout::Layout,
    moments::HessianForm,
    task::VectorTargets,
};

/// Contribution of a vector to the cost, beside the pulls at its ends.
#[derive(Debug, Clone, Copy)]
pub(crate) struct VectorPull {
    /// The bodies of its ends, and the ends relative to the root's origin: where it begins, where it ends.
    bodies: [usize; 2],
    ends: [Vector3<f64>; 2],
    /// Curvature of a parabola above the loss, in every direction.
    curvature: f64,
    /// Unit vector along the difference from the target.
    along: Vector3<f64>,
    /// What the loss's own curvature along it is more.
    rest: f64,
}

/// Motion of an end of a vector.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EndMotion {
    unknown: usize,
    /// Velocity of the end per unit of the unknown, in the object's frame.
    velocity: Vector3<f64>,
}

/// Returns whether each pair of joints that a vector couples has a place in the layout.
pub(crate) fn have_places(
    layout: &Layout,
    bodies: &[Body],
    points: &[BodyPoint],
    vectors: &[[usize; 2]],
) -> bool {
    let above = |point: usize| -> Vec<usize> {
        let mut unknowns: Vec<usize> = (0..layout.n_root).collect();
        let mut body = points[point].body;
        while body != 0 {
            unknowns.push(layout.unknowns[body]);
            body = bodies[body].parent;
        }
        unknowns
    };
    vectors.iter().all(|&[from, to]| {
        let ends = above(to);
        let pairs = above(from)
            .into_iter()
            .flat_map(|a| ends.iter().map(move |&b| (a, b)));
        pairs.into_iter().all(|(a, b)| layout.place(a, b).is_some())
    })
}

impl CompiledHand {
    /// Returns the numbers of the points at a vector's ends.
    ///
    /// # Errors
    ///
    /// Fails if the hand was compiled without this vector.
    pub(crate) fn vector(&self, vector: usize) -> Result<[usize; 2], SolverError> {
        self.vectors
            .get(vector)
            .copied()
            .ok_or(SolverError::NoVector {
                vector,
                found: self.vectors.len(),
            })
    }
}

impl Evaluation<'_> {
    /// Records the contributions of the vectors, and returns their cost.
    pub(crate) fn pull_vectors(&mut self, targets: &VectorTargets<'_>) -> f64 {
        let hand = self.hand;
        let mut cost = 0.0;
        for target in targets.vectors {
            let Some(points) = hand.vectors.get(target.vector) else {
                continue;
            };
            let points = points.map(|point| hand.points[point]);
            let ends = points.map(|point| {
                let frame = &self.frames[point.body];
                frame.origin + frame.rotation * point.offset
            });
            let difference = ends[1] - ends[0] - target.vector_in_object;
            let distance = difference.norm();
            let weight = target.weight;
            let mut pull = VectorPull {
                bodies: points.map(|point| point.body),
                ends,
                curvature: weight / targets.beta_m,
                along: Vector3::zeros(),
                rest: 0.0,
            };
            if distance < targets.beta_m {
                cost += 0.5 * pull.curvature * distance * distance;
            } else {
                cost += weight * (distance - 0.5 * targets.beta_m);
                pull.curvature = weight / distance;
                pull.along = difference / distance;
                pull.rest = -pull.curvature;
            }
            let slope = difference * pull.curvature;
            let curvature = Vector3::repeat(pull.curvature);
            for (end, slope) in [-slope, slope].into_iter().enumerate() {
                self.pulls.push(Pull {
                    body: pull.bodies[end],
                    r: ends[end],
                    slope,
                    curvature,
                    convex: curvature,
                });
            }
            self.vector_pulls.push(pull);
        }
        cost
    }

    /// Adds the second derivatives by a joint above one end and a joint above the other.
    pub(crate) fn couple_ends(&mut self, form: HessianForm) {
        if self.vector_pulls.is_empty() {
            return;
        }
        let turns = self.root_turns().unwrap_or_else(Matrix3::identity);
        let pulls = std::mem::take(&mut self.vector_pulls);
        let [mut from, mut to] = std::mem::take(&mut self.end_motions);
        let n = self.hand.layout.n;
        for pull in &pulls {
            self.end_motions(&turns, pull.bodies[0], &pull.ends[0], &mut from);
            self.end_motions(&turns, pull.bodies[1], &pull.ends[1], &mut to);
            let rest = match form {
                HessianForm::Exact => pull.rest,
                HessianForm::Convex => 0.0,
            };
            for a in &from {
                let pulled =
                    a.velocity * pull.curvature + pull.along * (rest * pull.along.dot(&a.velocity));
                for b in &to {
                    let twice = if a.unknown == b.unknown { 2.0 } else { 1.0 };
                    let place = self.hand.places[a.unknown * n + b.unknown];
                    self.hessian[place] -= twice * pulled.dot(&b.velocity);
                }
            }
        }
        self.vector_pulls = pulls;
        self.end_motions = [from, to];
    }

    /// Adds to the bodies' moments what losses curve less along the difference than across it.
    pub(crate) fn gather_vectors(&mut self, form: HessianForm) {
        if form == HessianForm::Convex {
            return;
        }
        for idx in 0..self.vector_pulls.len() {
            let pull = self.vector_pulls[idx];
            if pull.rest == 0.0 {
                continue;
            }
            for (&body, end) in pull.bodies.iter().zip(&pull.ends) {
                let moments = self.own_moments(body);
                moments.add_line(end, &pull.along, 0.0, pull.rest, form);
            }
        }
    }

    /// Writes how each unknown above a point moves it.
    fn end_motions(
        &self,
        turns: &Matrix3<f64>,
        body: usize,
        end: &Vector3<f64>,
        motions: &mut Vec<EndMotion>,
    ) {
        motions.clear();
        let hand = self.hand;
        if hand.layout.n_root > 0 {
            for (axis, turn) in columns(turns).iter().enumerate() {
                motions.push(EndMotion {
                    unknown: axis,
                    velocity: Vector3::ith(axis, 1.0),
                });
                motions.push(EndMotion {
                    unknown: 3 + axis,
                    velocity: turn.cross(end),
                });
            }
        }
        let mut idx = body;
        while idx != 0 {
            let body = &hand.bodies[idx];
            let twist = &self.twists[idx];
            motions.push(EndMotion {
                unknown: hand.layout.unknowns[idx],
                velocity: (twist.linear + twist.angular.cross(end)) * body.multiplier,
            });
            idx = body.parent;
        }
    }
}
