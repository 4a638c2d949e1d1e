//! What the object and the table ask of the hand.

use nalgebra::Point3;

use crate::{
    RetargetConfig,
    goal::Goal,
    hand::Hand,
    scene::{Gap, Scene},
    solver::{Posed, Residual, Terms},
};

/// Factor on the size of a cluster that allows for the interpolation's slope above 1.
const SLACK: f64 = 1.1;

/// The residuals of one step: links inside the object, its clearance or the table's margin, and
/// finger tips that should touch the surface.
pub(crate) struct Surroundings<'a> {
    pub(crate) hand: &'a Hand,
    pub(crate) scene: &'a Scene,
    pub(crate) config: &'a RetargetConfig,
    pub(crate) goal: &'a Goal,
    /// Factor on the object's weight.
    pub(crate) firmness: f64,
}

impl Terms for Surroundings<'_> {
    fn residuals(&mut self, posed: &Posed<'_>, residuals: &mut Vec<Residual>) {
        let config = self.config;
        if config.contact_weight > 0.0 {
            self.contacts(posed, residuals);
        }
        let mut keep_out = |weight: f64, point: usize, gap: Gap, needed_m: f64| {
            residuals.push(Residual {
                point,
                direction: gap.away,
                residual: gap.distance_m - needed_m,
                weight,
            });
        };
        if config.table_weight > 0.0 {
            self.each_near_ball(
                posed,
                |center| self.table_gap(center),
                config.table_margin_m,
                |point, gap, needed_m| keep_out(config.table_weight, point, gap, needed_m),
            );
        }
        if config.object_weight > 0.0 {
            let weight = self.firmness * config.object_weight;
            self.each_near_ball(
                posed,
                |center| self.scene.gap(center),
                self.goal.clearance_m,
                |point, gap, needed_m| keep_out(weight, point, gap, needed_m),
            );
        }
    }
}

impl Surroundings<'_> {
    /// Adds a residual for each finger tip that should touch the surface.
    fn contacts(&self, posed: &Posed<'_>, residuals: &mut Vec<Residual>) {
        for (point, goal) in self.goal.points.iter().enumerate() {
            if let (Some(contact), Some(at)) = (goal.contact, posed.point(point)) {
                let gap = self.scene.gap(&at);
                residuals.push(Residual {
                    point,
                    direction: gap.away,
                    residual: gap.distance_m - contact.distance_m,
                    weight: contact.weight,
                });
            }
        }
    }

    /// Returns how far a point is from the table.
    fn table_gap(&self, point: &Point3<f64>) -> Gap {
        Gap {
            distance_m: self.scene.height_m(point),
            away: self.scene.up(),
        }
    }

    /// Calls `found` with each ball's number among the solver's points whose center's gap is less
    /// than its radius and `margin_m`, with that gap and the sum.
    fn each_near_ball(
        &self,
        posed: &Posed<'_>,
        gap: impl Fn(&Point3<f64>) -> Gap,
        margin_m: f64,
        mut found: impl FnMut(usize, Gap, f64),
    ) {
        let hand = self.hand;
        for (idx, cluster) in hand.clusters.iter().enumerate() {
            let Some(center) = posed.point(hand.cluster_point(idx)) else {
                continue;
            };
            // A distance changes by no more than the way gone.
            if gap(&center).distance_m > SLACK * cluster.radius_m + margin_m {
                continue;
            }
            for ball in cluster.balls.clone() {
                let point = hand.ball_point(ball);
                let (Some(center), Some(radius_m)) = (posed.point(point), hand.radii_m.get(ball))
                else {
                    continue;
                };
                let (gap, needed_m) = (gap(&center), radius_m + margin_m);
                if gap.distance_m < needed_m {
                    found(point, gap, needed_m);
                }
            }
        }
    }

    /// Returns the greatest depth of a link inside the object, in meters.
    pub(crate) fn object_depth_m(&self, posed: &Posed<'_>) -> f64 {
        self.depth_m(posed, |center| self.scene.gap(center))
    }

    /// Returns the greatest depth of a link below the table, in meters.
    pub(crate) fn table_depth_m(&self, posed: &Posed<'_>) -> f64 {
        self.depth_m(posed, |center| self.table_gap(center))
    }

    fn depth_m(&self, posed: &Posed<'_>, gap: impl Fn(&Point3<f64>) -> Gap) -> f64 {
        let mut depth_m = 0.0_f64;
        self.each_near_ball(posed, gap, 0.0, |_, gap, radius_m| {
            depth_m = depth_m.max(radius_m - gap.distance_m);
        });
        depth_m
    }
}
