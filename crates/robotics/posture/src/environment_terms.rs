//! Cost terms of the object and the table: collisions and contacts.

use nalgebra::Point3;
use robot::spheres::SLACK;

use crate::{Environment, Hand, Posed, Residual, SignedDistance, Terms};

/// The residuals of one step: links inside the object, its clearance or the table's margin, and
/// points that should be at a distance from the surface.
#[derive(Clone)]
pub struct EnvironmentTerms<'a> {
    /// The hand.
    pub hand: &'a Hand,
    /// The object and the table.
    pub environment: &'a Environment,
    /// Penalty on collisions with them.
    pub collision_penalty: CollisionPenalty,
    /// Points that should be at a distance from the object's surface.
    pub contacts: Vec<ContactTarget>,
}

/// Penalty on collisions with the object and the table; a weight multiplies a depth before it is
/// squared, and 0 disables its term.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CollisionPenalty {
    /// Weight of a depth inside the object's clearance.
    pub object_weight: f64,
    /// Distance from the object, in meters.
    pub clearance_m: f64,
    /// Weight of a depth inside the table's margin.
    pub table_weight: f64,
    /// Distance from the table, in meters.
    pub table_margin_m: f64,
}

/// A point of the hand that should be at a distance from the object's surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactTarget {
    /// Its number among [`Hand::points`].
    pub point: usize,
    /// The signed distance, in meters.
    pub distance_m: f64,
    /// Weight of the difference.
    pub weight: f64,
}

impl Terms for EnvironmentTerms<'_> {
    fn residuals(&mut self, posed: &Posed<'_>, residuals: &mut Vec<Residual>) {
        let collision_penalty = self.collision_penalty;
        for contact in &self.contacts {
            if let Some(at) = posed.point(contact.point) {
                let gap = self.environment.signed_distance(&at);
                residuals.push(Residual {
                    point: contact.point,
                    gradient_in_object: gap.gradient_in_object,
                    residual: gap.distance_m - contact.distance_m,
                    weight: contact.weight,
                });
            }
        }
        let mut push = |weight: f64, point: usize, gap: SignedDistance, needed_m: f64| {
            residuals.push(Residual {
                point,
                gradient_in_object: gap.gradient_in_object,
                residual: gap.distance_m - needed_m,
                weight,
            });
        };
        if collision_penalty.table_weight > 0.0 {
            self.each_near_sphere(
                posed,
                |center| self.table_gap(center),
                collision_penalty.table_margin_m,
                |point, gap, needed_m| push(collision_penalty.table_weight, point, gap, needed_m),
            );
        }
        if collision_penalty.object_weight > 0.0 {
            self.each_near_sphere(
                posed,
                |center| self.environment.signed_distance(center),
                collision_penalty.clearance_m,
                |point, gap, needed_m| push(collision_penalty.object_weight, point, gap, needed_m),
            );
        }
    }
}

impl EnvironmentTerms<'_> {
    /// Returns the signed distance of a point from the table.
    fn table_gap(&self, point: &Point3<f64>) -> SignedDistance {
        SignedDistance {
            distance_m: self.environment.height_m(point),
            gradient_in_object: self.environment.up_in_object(),
        }
    }

    /// Calls `found` with each sphere's number among the solver's points whose center's gap is less
    /// than its radius and `margin_m`, with that gap and the sum.
    fn each_near_sphere(
        &self,
        posed: &Posed<'_>,
        gap: impl Fn(&Point3<f64>) -> SignedDistance,
        margin_m: f64,
        mut found: impl FnMut(usize, SignedDistance, f64),
    ) {
        let hand = self.hand;
        hand.collision.find(
            |sphere| posed.point(hand.sphere_point(sphere)),
            // A distance changes by no more than the way gone.
            |around, center| {
                let is_far = gap(center).distance_m > SLACK * around.sphere.radius_m + margin_m;
                (!is_far).then_some(())
            },
            |sphere, center, ()| {
                let (gap, needed_m) = (gap(center), sphere.sphere.radius_m + margin_m);
                if gap.distance_m < needed_m {
                    found(hand.sphere_point(sphere), gap, needed_m);
                }
                None::<()>
            },
        );
    }

    /// Returns the greatest depth of a link inside the object, in meters.
    pub fn object_depth_m(&self, posed: &Posed<'_>) -> f64 {
        self.depth_m(posed, |center| self.environment.signed_distance(center))
    }

    /// Returns the greatest depth of a link below the table, in meters.
    pub fn table_depth_m(&self, posed: &Posed<'_>) -> f64 {
        self.depth_m(posed, |center| self.table_gap(center))
    }

    fn depth_m(&self, posed: &Posed<'_>, gap: impl Fn(&Point3<f64>) -> SignedDistance) -> f64 {
        let mut depth_m = 0.0_f64;
        self.each_near_sphere(posed, gap, 0.0, |_, gap, radius_m| {
            depth_m = depth_m.max(radius_m - gap.distance_m);
        });
        depth_m
    }
}
