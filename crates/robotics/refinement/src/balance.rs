//! Whether fingertips can press on an object so that their forces balance.

use nalgebra::{Matrix3, Matrix6x3, Point3, Unit, Vector3, Vector6};
use posture::{Environment, Posed, Residual};

/// Distance over which a surface's normal is averaged, and differences of it are taken, in meters.
const NEAR_M: f64 = 0.003;
/// Offsets to both sides along an axis, in meters.
const SIDES_M: [f64; 2] = [-NEAR_M, NEAR_M];
/// Least length of a sum of gradients that has a direction.
const MIN_GRADIENT_SUM: f64 = 1e-6;
/// Edges of the linearized friction cone.
const EDGES: usize = 6;
/// Sweeps of coordinate descent over all edge forces.
const SWEEPS: usize = 60;
/// Longest step of a sweep after which the forces have converged, relative to the thumb's force.
const LEAST_STEP: f64 = 1e-6;

/// A tip that should touch the object.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fingertip {
    /// Its number among the solver's points.
    pub(crate) point: usize,
    /// Radius of the ball about it, in meters.
    pub(crate) radius_m: f64,
    pub(crate) is_thumb: bool,
    /// Its place in the drawn grasp.
    pub(crate) drawn_in_object: Point3<f64>,
}

/// The force-balance term: the residual wrench, the least that contact forces within their friction cones leave when
/// the thumb presses with 1 and the object's weight is carried.
pub(crate) struct ForceBalance<'a> {
    environment: &'a Environment,
    center_in_object: Point3<f64>,
    /// The object's weight relative to the thumb's force.
    relative_load: f64,
    tips: Vec<Fingertip>,
    /// For each tip the axis that fixes the first edge of its friction cone.
    axes: Vec<Unit<Vector3<f64>>>,
    /// Length by which torques are divided, in meters: the drawn tips' mean distance from the center of mass.
    characteristic_length_m: f64,
    friction: f64,
    weight: f64,
}

/// Contact of a fingertip with the surface.
struct ContactPoint {
    /// Outward normal of the surface, in the object's frame.
    normal: Vector3<f64>,
    /// Derivative of the normal by the tip's position, in 1/m.
    curvature: Matrix3<f64>,
    /// From the center of mass to the contact.
    lever_in_object_m: Vector3<f64>,
}

/// A unit force along a finger's cone edge, or one along the thumb's that replaces another.
struct Direction {
    /// The edge whose force grows.
    gains: usize,
    /// The edge whose force shrinks as much.
    loses: Option<usize>,
    wrench: Vector6<f64>,
}

impl<'a> ForceBalance<'a> {
    /// Returns the term; `None` unless the thumb and a finger touch.
    pub(crate) fn new(
        environment: &'a Environment,
        center_in_object: Point3<f64>,
        relative_load: f64,
        tips: Vec<Fingertip>,
        friction: f64,
        weight: f64,
    ) -> Option<Self> {
        let touches = |thumb: bool| tips.iter().any(|tip| tip.is_thumb == thumb);
        if !(touches(true) && touches(false)) {
            return None;
        }
        let arms = tips
            .iter()
            .map(|tip| (tip.drawn_in_object - center_in_object).norm());
        let mut balance = Self {
            environment,
            center_in_object,
            relative_load,
            axes: Vec::new(),
            characteristic_length_m: (arms.sum::<f64>() / tips.len() as f64).max(NEAR_M),
            tips,
            friction,
            weight,
        };
        balance.axes = balance.tips.iter().map(|tip| balance.axis(tip)).collect();
        Some(balance)
    }

    /// Returns the coordinate axis that is farthest from the normal of a drawn tip; any, if it has none.
    fn axis(&self, tip: &Fingertip) -> Unit<Vector3<f64>> {
        let normal = self.normal(&tip.drawn_in_object);
        match normal.map(|normal| normal.abs().imin()) {
            Some(0) | None => Vector3::x_axis(),
            Some(1) => Vector3::y_axis(),
            Some(_) => Vector3::z_axis(),
        }
    }

    /// Adds the residual wrench, six numbers per tip. A residual has one point, so the wrench is there n times:
    /// weights are divided by √n, so that the squares add up to its square, and directions multiplied by n, so that
    /// the gradients do.
    pub(crate) fn residuals(&self, posed: &Posed<'_>, residuals: &mut Vec<Residual>) {
        let Some(contacts) = self.contact_points(posed) else {
            return;
        };
        let n_tips = contacts.len() as f64;
        let (forces, residual_wrench) = self.solve_forces(&contacts);
        for ((tip, contact), force) in self.tips.iter().zip(&contacts).zip(&forces) {
            let jacobian = self.wrench_jacobian(contact, force, tip.radius_m);
            for (row, residual) in residual_wrench.iter().enumerate() {
                residuals.push(Residual {
                    point: tip.point,
                    gradient_in_object: jacobian.row(row).transpose() * n_tips,
                    residual: *residual,
                    weight: self.weight / n_tips.sqrt(),
                });
            }
        }
    }

    /// Returns where the tips touch; `None` if one is deep inside the object, where there is no normal.
    fn contact_points(&self, posed: &Posed<'_>) -> Option<Vec<ContactPoint>> {
        let contacts = self.tips.iter().map(|tip| {
            let at = posed.point(tip.point)?;
            self.contact_point(&at, tip.radius_m)
        });
        contacts.collect()
    }

    /// Returns whether every tip has a normal, and so the term its residuals.
    pub(crate) fn is_defined(&self, posed: &Posed<'_>) -> bool {
        self.contact_points(posed).is_some()
    }

    /// Returns the planned force of each tip on the object, relative to the thumb's, with the tip's number among the
    /// solver's points; `None` if a tip has no normal.
    pub(crate) fn forces(&self, posed: &Posed<'_>) -> Option<Vec<(usize, Vector3<f64>)>> {
        let (forces, _) = self.solve_forces(&self.contact_points(posed)?);
        let points = self.tips.iter().map(|tip| tip.point);
        Some(points.zip(forces).collect())
    }

    /// Returns the force of each tip on the object, and the force and the torque, over the characteristic length,
    /// that are left over.
    fn solve_forces(&self, contacts: &[ContactPoint]) -> (Vec<Vector3<f64>>, Vector6<f64>) {
        let mut cone_edges: Vec<(usize, Vector3<f64>, Vector6<f64>)> = Vec::new();
        for (idx, tip) in contacts.iter().enumerate() {
            let normal = Unit::new_unchecked(tip.normal);
            // The tip may have moved to where its axis is the normal.
            let side = normal.cross(&self.axes[idx]).try_normalize(1e-6);
            let side = side.unwrap_or_else(|| normal.cross(&self.axes[idx].yzx()).normalize());
            let other = normal.cross(&side);
            for edge in 0..EDGES {
                let angle = std::f64::consts::TAU * edge as f64 / EDGES as f64;
                let along = side * angle.cos() + other * angle.sin();
                let force = along * self.friction - tip.normal;
                let torque = tip.lever_in_object_m.cross(&force) / self.characteristic_length_m;
                let wrench = Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z);
                cone_edges.push((idx, force, wrench));
            }
        }
        let carried = self.environment.up_in_object() * self.relative_load;
        let mut unbalanced = Vector6::zeros();
        unbalanced.fixed_rows_mut::<3>(0).copy_from(&-carried);
        let residual_wrench = |sizes: &[f64]| {
            let edges = cone_edges.iter().zip(sizes);
            edges.fold(unbalanced, |sum, ((_, _, wrench), size)| {
                sum + wrench * *size
            })
        };
        let of_thumb: Vec<usize> = (0..cone_edges.len())
            .filter(|&edge| self.tips[cone_edges[edge].0].is_thumb)
            .collect();
        // The thumb's forces have a sum of 1 from the start, and keep it: what one gains another loses.
        let mut sizes = vec![0.0_f64; cone_edges.len()];
        let mut directions = Vec::new();
        for (n, &gains) in of_thumb.iter().enumerate() {
            let wrench = cone_edges[gains].2;
            sizes[gains] = 1.0 / of_thumb.len() as f64;
            directions.extend(of_thumb[..n].iter().map(|&loses| Direction {
                gains,
                loses: Some(loses),
                wrench: wrench - cone_edges[loses].2,
            }));
        }
        // Without friction all edges of a tip's cone coincide.
        directions.retain(|exchange| exchange.wrench.norm_squared() >= f64::EPSILON);
        let of_fingers = (0..cone_edges.len()).filter(|edge| !of_thumb.contains(edge));
        directions.extend(of_fingers.map(|gains| Direction {
            gains,
            loses: None,
            wrench: cone_edges[gains].2,
        }));
        descend(&directions, &residual_wrench(&sizes), &mut sizes);
        let mut forces = vec![Vector3::zeros(); contacts.len()];
        for ((idx, force, _), size) in cone_edges.iter().zip(&sizes) {
            forces[*idx] += force * *size;
        }
        (forces, residual_wrench(&sizes))
    }

    fn contact_point(&self, at: &Point3<f64>, radius_m: f64) -> Option<ContactPoint> {
        // The sums of `normal` on both sides of `at` along each axis: neighbors share most of their gradients.
        let center = self.gradient(at, &[]);
        let beyond = |axis| SIDES_M.map(|side| center + self.gradient(at, &[(axis, side); 2]));
        let mut beside = [0, 1, 2].map(beyond);
        for [a, b] in [[0, 1], [0, 2], [1, 2]] {
            for (of_a, side_a) in SIDES_M.into_iter().enumerate() {
                for (of_b, side_b) in SIDES_M.into_iter().enumerate() {
                    let between = self.gradient(at, &[(a, side_a), (b, side_b)]);
                    beside[a][of_a] += between;
                    beside[b][of_b] += between;
                }
            }
        }
        let mut curvature = Matrix3::zeros();
        for (axis, [before, after]) in beside.iter().enumerate() {
            let change =
                after.try_normalize(MIN_GRADIENT_SUM)? - before.try_normalize(MIN_GRADIENT_SUM)?;
            curvature.set_column(axis, &(change / (2.0 * NEAR_M)));
        }
        let normal = self.normal(at)?;
        Some(ContactPoint {
            normal,
            curvature,
            lever_in_object_m: at - normal * radius_m - self.center_in_object,
        })
    }

    /// Returns the outward normal about a point; `None` deep inside the object, where there is none.
    fn normal(&self, at: &Point3<f64>) -> Option<Vector3<f64>> {
        let mut sum = Vector3::zeros();
        for axis in 0..3 {
            for side in SIDES_M {
                sum += self.gradient(at, &[(axis, side)]);
            }
        }
        sum.try_normalize(MIN_GRADIENT_SUM)
    }

    /// Returns the gradient of the object's distance at a point moved along axes.
    fn gradient(&self, at: &Point3<f64>, moves_m: &[(usize, f64)]) -> Vector3<f64> {
        let mut at = *at;
        for (axis, move_m) in moves_m {
            at[*axis] += move_m;
        }
        self.environment.signed_distance(&at).gradient_in_object
    }

    /// Returns how force and torque of a tip change with its place while it presses as strongly.
    ///
    /// The directions of friction are taken to stay where they are; in truth they turn with the normal.
    fn wrench_jacobian(
        &self,
        contact: &ContactPoint,
        force: &Vector3<f64>,
        radius_m: f64,
    ) -> Matrix6x3<f64> {
        let size = -force.dot(&contact.normal);
        let force_jacobian = contact.curvature * -size;
        let lever_jacobian = Matrix3::identity() - contact.curvature * radius_m;
        let torque_jacobian = contact.lever_in_object_m.cross_matrix() * force_jacobian
            - force.cross_matrix() * lever_jacobian;
        let mut jacobian = Matrix6x3::zeros();
        jacobian.fixed_rows_mut::<3>(0).copy_from(&force_jacobian);
        jacobian
            .fixed_rows_mut::<3>(3)
            .copy_from(&(torque_jacobian / self.characteristic_length_m));
        jacobian
    }
}

/// Changes the sizes of edges' forces, none below 0, to those of the least residual wrench: coordinate descent along
/// the directions, on the slopes of half its square.
fn descend(directions: &[Direction], residual_wrench: &Vector6<f64>, sizes: &mut [f64]) {
    let n = directions.len();
    let slope = |along: &Direction| along.wrench.dot(residual_wrench);
    let mut slopes: Vec<f64> = directions.iter().map(slope).collect();
    let products = directions
        .iter()
        .flat_map(|a| directions.iter().map(|b| a.wrench.dot(&b.wrench)));
    let products: Vec<f64> = products.collect();
    for _ in 0..SWEEPS {
        let mut longest = 0.0_f64;
        for (idx, (along, products)) in directions.iter().zip(products.chunks_exact(n)).enumerate()
        {
            let most = along.loses.map_or(f64::INFINITY, |loses| sizes[loses]);
            let step = (-slopes[idx] / products[idx]).clamp(-sizes[along.gains], most);
            if step == 0.0 {
                continue;
            }
            sizes[along.gains] += step;
            if let Some(loses) = along.loses {
                sizes[loses] -= step;
            }
            for (slope, product) in slopes.iter_mut().zip(products) {
                *slope += product * step;
            }
            longest = longest.max(step.abs());
        }
        if longest < LEAST_STEP {
            break;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    const RADIUS_M: f64 = 0.01;
    const OBJECT_WEIGHT: f64 = 0.3;

    /// Returns the length of the residual wrench of tips at these places, of which the first is the thumb's.
    fn residual_norm(places: &[[f64; 3]], friction: f64) -> f64 {
        let environment = fixture::environment();
        let tips = places.iter().enumerate().map(|(point, place)| Fingertip {
            point,
            radius_m: RADIUS_M,
            is_thumb: point == 0,
            drawn_in_object: Point3::from(*place),
        });
        let balance = ForceBalance::new(
            &environment,
            Point3::origin(),
            OBJECT_WEIGHT,
            tips.collect(),
            friction,
            1.0,
        )
        .unwrap();
        let contacts = places
            .iter()
            .map(|place| balance.contact_point(&Point3::from(*place), RADIUS_M));
        let contacts: Vec<ContactPoint> = contacts.collect::<Option<_>>().unwrap();
        let (_, residual_wrench) = balance.solve_forces(&contacts);
        residual_wrench.norm()
    }

    #[test]
    fn opposed_tips_balance_and_tips_on_one_side_do_not() {
        let [x, y, _] = fixture::BOX_HALF_M;
        let beside = x + RADIUS_M;
        let opposed = residual_norm(&[[-beside, 0.0, 0.0], [beside, 0.0, 0.0]], 0.3);
        assert!(opposed < 0.02, "{opposed}");
        // Without friction nothing carries the weight.
        let smooth = residual_norm(&[[-beside, 0.0, 0.0], [beside, 0.0, 0.0]], 0.0);
        assert!((smooth - OBJECT_WEIGHT).abs() < 0.02, "{smooth}");
        // Forces apart by 3 cm turn the box; a third tip opposite their middle balances them.
        let turning = residual_norm(&[[-beside, 0.0, 0.0], [beside, 0.03, 0.0]], 0.1);
        assert!(turning > 0.2, "{turning}");
        let tips = [
            [-beside, 0.0, 0.0],
            [beside, 0.03, 0.0],
            [beside, -0.03, 0.0],
        ];
        let three = residual_norm(&tips, 0.3);
        assert!(three < 0.02, "{three}");
        let same_side = residual_norm(&[[-beside, 0.02, 0.0], [-beside, -0.02, 0.0]], 0.3);
        let across = residual_norm(&[[-beside, 0.0, 0.0], [0.0, y + RADIUS_M, 0.0]], 0.3);
        assert!(same_side > 0.9 && across > 0.4, "{same_side} {across}");
    }

    #[test]
    fn no_term_without_a_thumb_and_a_finger() {
        let environment = fixture::environment();
        let tip = |is_thumb: bool| Fingertip {
            point: 0,
            radius_m: RADIUS_M,
            is_thumb,
            drawn_in_object: Point3::origin(),
        };
        for tips in [vec![], vec![tip(true)], vec![tip(false), tip(false)]] {
            let balance = ForceBalance::new(
                &environment,
                Point3::origin(),
                OBJECT_WEIGHT,
                tips,
                0.3,
                1.0,
            );
            assert!(balance.is_none());
        }
    }

    /// Twice the Jacobian's transpose times the residual wrench is the gradient of its square by a tip's place.
    #[test]
    fn jacobian_is_the_gradient_of_the_squared_wrench() {
        let environment = fixture::environment();
        let [x, _, _] = fixture::BOX_HALF_M;
        let places = [
            Point3::new(-x - RADIUS_M, 0.01, 0.005),
            Point3::new(x + RADIUS_M, -0.012, -0.004),
        ];
        let tips = (0..2).map(|point| Fingertip {
            point,
            radius_m: RADIUS_M,
            is_thumb: point == 0,
            drawn_in_object: places[point],
        });
        let balance = ForceBalance::new(
            &environment,
            Point3::origin(),
            OBJECT_WEIGHT,
            tips.collect(),
            0.0,
            1.0,
        )
        .unwrap();
        let at = |places: &[Point3<f64>]| {
            let contacts = places
                .iter()
                .map(|place| balance.contact_point(place, RADIUS_M));
            let contacts: Vec<ContactPoint> = contacts.collect::<Option<_>>().unwrap();
            let (forces, residual_wrench) = balance.solve_forces(&contacts);
            (contacts, forces, residual_wrench)
        };
        let (contacts, forces, residual_wrench) = at(&places);
        for tip in 0..2 {
            let jacobian = balance.wrench_jacobian(&contacts[tip], &forces[tip], RADIUS_M);
            let slope = jacobian.transpose() * residual_wrench * 2.0;
            for axis in 0..3 {
                const H_M: f64 = 1e-5;
                let cost = |by_m: f64| {
                    let mut moved = places;
                    moved[tip][axis] += by_m;
                    at(&moved).2.norm_squared()
                };
                let expected = (cost(H_M) - cost(-H_M)) / (2.0 * H_M);
                assert!(
                    (slope[axis] - expected).abs() < 0.02 * slope.norm() + 0.02,
                    "{tip} {axis}: {} {expected}",
                    slope[axis]
                );
            }
        }
    }
}
