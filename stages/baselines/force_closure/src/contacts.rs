//! Fingertips on a surface: their wrenches, and the min-weight metric as a term of the solver.

use approach::ContactModel;
use nalgebra::{Point3, Vector3};
use posture::{Environment, EnvironmentTerms, Posed, Residual, Terms};

use crate::min_weight::MinWeight;

/// Distance over which a surface's normal is averaged, and differences of wrenches are taken, in meters.
const NEAR_M: f64 = 0.003;
/// Shortfall of the metric where it is not defined: more than that of random palms.
const UNDEFINED: f64 = 10.0;

/// A point of contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Contact {
    /// Position, in meters.
    pub(crate) at_m: Point3<f64>,
    /// Outward unit normal of the surface.
    pub(crate) normal: Vector3<f64>,
}

/// A fingertip: its number among the solver's points, and the radius of the ball about it in meters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Tip {
    pub(crate) point: usize,
    pub(crate) radius_m: f64,
}

/// The terms of a search: object, table, fingertips on the surface, and what the metric lacks to its greatest value.
pub(crate) struct GraspTerms<'a> {
    pub(crate) surroundings: EnvironmentTerms<'a>,
    pub(crate) tips: &'a [Tip],
    pub(crate) contact_model: ContactModel,
    /// Weight of the metric's shortfall, in meters.
    pub(crate) weight_m: f64,
    /// Number of evaluations of the metric.
    pub(crate) evaluations: u64,
}

impl Terms for GraspTerms<'_> {
    /// A residual has one point, so the metric's shortfall is there n times: its weight is divided by √n, so that the
    /// squares add up to its square, and the directions are multiplied by n, so that the gradients do.
    fn residuals(&mut self, posed: &Posed<'_>, residuals: &mut Vec<Residual>) {
        self.surroundings.residuals(posed, residuals);
        if self.weight_m <= 0.0 {
            return;
        }
        let n = self.tips.len() as f64;
        let found = self.metric(posed);
        for (idx, tip) in self.tips.iter().enumerate() {
            let (residual, gradient_in_object) = match &found {
                Some((metric, places)) => {
                    let gradient = self.gradient(metric, idx, &places[idx], tip);
                    (1.0 - metric.normalized, gradient * -n)
                }
                None => (UNDEFINED, Vector3::zeros()),
            };
            residuals.push(Residual {
                point: tip.point,
                gradient_in_object,
                residual,
                weight: self.weight_m / n.sqrt(),
            });
        }
    }
}

impl GraspTerms<'_> {
    /// Returns the metric and the places of the tips; `None` if a tip is deep inside the object, where there is no
    /// normal, or if nothing balances.
    pub(crate) fn metric(&mut self, posed: &Posed<'_>) -> Option<(MinWeight, Vec<Point3<f64>>)> {
        let places = self.tips.iter().map(|tip| posed.point(tip.point));
        let places: Vec<Point3<f64>> = places.collect::<Option<_>>()?;
        Some((self.metric_at(&places)?, places))
    }

    /// Returns the metric of tips at these places.
    pub(crate) fn metric_at(&mut self, places: &[Point3<f64>]) -> Option<MinWeight> {
        let mut all = Vec::with_capacity(self.tips.len() * self.contact_model.edges);
        for (tip, at) in self.tips.iter().zip(places) {
            let contact = contact(self.surroundings.environment, at, tip.radius_m)?;
            all.extend(self.contact_model.wrenches(
                &contact.at_m,
                &contact.normal,
                &contact.normal,
            ));
        }
        self.evaluations += 1;
        MinWeight::of(&all)
    }

    /// Returns the gradient of the metric by a tip's place: its wrenches by differences, the metric by theirs.
    pub(crate) fn gradient(
        &self,
        metric: &MinWeight,
        idx: usize,
        at: &Point3<f64>,
        tip: &Tip,
    ) -> Vector3<f64> {
        let environment = self.surroundings.environment;
        let Some(here) = contact(environment, at, tip.radius_m) else {
            return Vector3::zeros();
        };
        let moved = |axis: usize, sign: f64| {
            let mut offset = Vector3::zeros();
            offset[axis] = sign * NEAR_M;
            let contact = contact(environment, &(at + offset), tip.radius_m)?;
            Some(
                self.contact_model
                    .wrenches(&contact.at_m, &contact.normal, &here.normal),
            )
        };
        Vector3::from_fn(|axis, _| {
            let (Some(after), Some(before)) = (moved(axis, 1.0), moved(axis, -1.0)) else {
                return 0.0;
            };
            let changes = after.iter().zip(&before).enumerate();
            let first = idx * self.contact_model.edges;
            changes
                .map(|(edge, (after, before))| {
                    metric.change(first + edge, &((after - before) / (2.0 * NEAR_M)))
                })
                .sum()
        })
    }
}

/// Returns the contact of a tip at a place; `None` deep inside the object, where there is no normal.
pub(crate) fn contact(
    environment: &Environment,
    at: &Point3<f64>,
    radius_m: f64,
) -> Option<Contact> {
    let mut sum = Vector3::zeros();
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let mut offset = Vector3::zeros();
            offset[axis] = sign * NEAR_M;
            sum += environment
                .signed_distance(&(at + offset))
                .gradient_in_object;
        }
    }
    let normal = sum.try_normalize(1e-6)?;
    Some(Contact {
        at_m: at - normal * radius_m,
        normal,
    })
}
