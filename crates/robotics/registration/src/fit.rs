//! Moving a pose to where it fits what is seen.
//!
//! Residuals are the distances of the seen points from the surface (Fitzgibbon, "Robust registration of 2D and 3D point
//! sets", 2003) and the depths of the surface's points in free space, both under the loss of Geman and `McClure` (1985);
//! steps are Gauss and Newton's.

use completion::Observation;
use nalgebra::{Isometry3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6};
use spatial::{Object, Pose, RestingPose, Table};

use crate::{Freedom, KnownShape};

/// The surface may be this deep in free space, in meters: outlines and depths are no better.
pub(crate) const FREE_M: f64 = 0.003;
/// Half the distance between the places whose free space is compared for its slope, in meters: about a pixel.
const SLOPE_M: f64 = 0.0015;
/// Damping, relative to the curvature of a distance along its normal: what nothing constrains stays as it is.
const DAMPING: f64 = 1e-3;
/// Standard deviation of a resting orientation's height and tilt, in meters and radians: a table's plane is found to a
/// millimeter and half a degree, and an object lies as its mesh says to as much.
const HEIGHT_M: f64 = 0.0015;
const TILT_RAD: f64 = 0.015;
/// Standard deviation of a seen point's distance, in meters, and the number of independent ones: errors of neighboring
/// pixels are alike.
const POINT_M: f64 = 0.001;
const POINTS: f64 = 100.0;

/// What a pose is fitted to.
pub(crate) struct Fit<'a> {
    pub(crate) shape: &'a KnownShape,
    pub(crate) observation: &'a Observation,
    /// Points that are seen, in the observation's frame.
    pub(crate) seen: Vec<Point3<f64>>,
    /// Number of the surface's points that are looked at.
    pub(crate) points_n: usize,
}

/// A pose with the orientation in which the object rests.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Placed {
    pub(crate) rest: RestingPose,
    pub(crate) table_from_object: Pose<Table, Object>,
}

/// The normal equations of a step: turn about the middle last.
struct Equations {
    matrix: Matrix6<f64>,
    right: Vector6<f64>,
}

impl Equations {
    fn add(&mut self, slope: &Vector6<f64>, residual: f64, weight: f64) {
        self.matrix += slope * slope.transpose() * weight;
        self.right -= slope * (residual * weight);
    }
}

impl<'a> Fit<'a> {
    /// Takes at most so many of the seen points, and of the surface's.
    pub(crate) fn of(
        shape: &'a KnownShape,
        observation: &'a Observation,
        seen_n: usize,
        points_n: usize,
    ) -> Self {
        let step = observation.points.len().div_ceil(seen_n).max(1);
        Self {
            shape,
            observation,
            seen: observation.points.iter().step_by(step).copied().collect(),
            points_n,
        }
    }

    /// Returns the residual of a pose in meters, errors above `scale_m` counting little more than it.
    pub(crate) fn residual_m(&self, table_from_object: &Pose<Table, Object>, scale_m: f64) -> f64 {
        let loss = |residual: f64| {
            let (square, scale) = (residual * residual, scale_m * scale_m);
            square * scale / (square + scale)
        };
        let seen = self.distances_m(table_from_object).map(loss).sum::<f64>();
        let free = self.depths_m(table_from_object).map(loss).sum::<f64>();
        (seen / self.seen.len().max(1) as f64 + free / self.points_n.max(1) as f64).sqrt()
    }

    /// Returns the distance of each seen point from the surface, in meters.
    pub(crate) fn distances_m(
        &self,
        table_from_object: &Pose<Table, Object>,
    ) -> impl Iterator<Item = f64> {
        let object_from_table = table_from_object.inverse();
        let seen = self.seen.iter();
        seen.map(move |&point| self.shape.field.distance(&(object_from_table * point)).0)
    }

    /// Returns how much deeper each point of the surface is in free space than it may be, in meters.
    pub(crate) fn depths_m(
        &self,
        table_from_object: &Pose<Table, Object>,
    ) -> impl Iterator<Item = f64> {
        let table_from_object = *table_from_object;
        let points = self.shape.points.iter().take(self.points_n);
        points.map(move |&point| self.too_deep_m(&(table_from_object * point)))
    }

    fn too_deep_m(&self, point_on_table: &Point3<f64>) -> f64 {
        (self.observation.measured_free_m(point_on_table) - FREE_M).max(0.0)
    }

    /// Moves a pose by steps, each with its scale of the loss.
    pub(crate) fn moved(
        &self,
        start: &Placed,
        scales_m: impl Iterator<Item = f64>,
        freedom: Freedom,
    ) -> Placed {
        let mut placed = *start;
        for scale_m in scales_m {
            let Some(next) = self.stepped(&placed, scale_m, freedom) else {
                break;
            };
            placed.table_from_object = next;
        }
        placed
    }

    /// Returns the pose after one step.
    fn stepped(
        &self,
        placed: &Placed,
        scale_m: f64,
        freedom: Freedom,
    ) -> Option<Pose<Table, Object>> {
        let pose = &placed.table_from_object;
        let middle = *pose * self.shape.middle;
        let mut equations = self.equations(pose, &middle, scale_m);
        let turned = self.shape.radius_m.powi(2);
        for axis in 0..6 {
            equations.matrix[(axis, axis)] += DAMPING * if axis < 3 { 1.0 } else { turned };
        }
        match freedom {
            Freedom::All => self.add_prior(&mut equations, placed, &middle),
            Freedom::Table => {
                // Height and tilt stay.
                for axis in [2, 3, 4] {
                    equations.matrix.row_mut(axis).fill(0.0);
                    equations.matrix.column_mut(axis).fill(0.0);
                    equations.matrix[(axis, axis)] = 1.0;
                    equations.right[axis] = 0.0;
                }
            }
        }
        let step = equations.matrix.cholesky()?.solve(&equations.right);
        let shift = step.fixed_rows::<3>(0).into_owned();
        let turn = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(3).into_owned());
        let about = Translation3::from(middle.coords);
        let moved = Translation3::from(shift) * about * turn * about.inverse();
        let moved: Isometry3<f64> = moved * **pose;
        moved
            .translation
            .vector
            .iter()
            .all(|length| length.is_finite())
            .then(|| Pose::new(moved))
    }

    fn equations(
        &self,
        pose: &Pose<Table, Object>,
        middle: &Point3<f64>,
        scale_m: f64,
    ) -> Equations {
        let mut equations = Equations {
            matrix: Matrix6::zeros(),
            right: Vector6::zeros(),
        };
        let weight = |residual: f64| (1.0 + (residual / scale_m).powi(2)).powi(-2);
        let slope = |along: &Vector3<f64>, point: &Point3<f64>| {
            let turn = (point - middle).cross(along);
            Vector6::new(along.x, along.y, along.z, turn.x, turn.y, turn.z)
        };
        let object_from_table = pose.inverse();
        let seen_n = self.seen.len().max(1) as f64;
        for point in &self.seen {
            let (distance_m, gradient) = self.shape.field.distance(&(object_from_table * *point));
            // The surface moves, and the point stays.
            let along = -(*pose * gradient);
            let weight = weight(distance_m) / seen_n;
            equations.add(&slope(&along, point), distance_m, weight);
        }
        for &point in self.shape.points.iter().take(self.points_n) {
            let point = *pose * point;
            let depth_m = self.too_deep_m(&point);
            if depth_m > 0.0 {
                let along = self.slope_of_free_space(&point);
                let weight = weight(depth_m) / self.points_n as f64;
                equations.add(&slope(&along, &point), depth_m, weight);
            }
        }
        equations
    }

    /// Returns the slope of the depth in free space, at most of length 1.
    fn slope_of_free_space(&self, point: &Point3<f64>) -> Vector3<f64> {
        let along = |axis: usize| {
            let mut off = Vector3::zeros();
            off[axis] = SLOPE_M;
            let [high, low] =
                [point + off, point - off].map(|at| self.observation.measured_free_m(&at));
            let slope = (high - low) / (2.0 * SLOPE_M);
            if slope.is_finite() { slope } else { 0.0 }
        };
        Vector3::new(along(0), along(1), along(2)).cap_magnitude(1.0)
    }

    /// Adds that the object lies about as its resting orientation says.
    fn add_prior(&self, equations: &mut Equations, placed: &Placed, middle: &Point3<f64>) {
        let weight = |deviation: f64| (POINT_M / deviation).powi(2) / POINTS;
        let up_in_object = placed.rest.up_in_object;
        let height_m = up_in_object.dot(&self.shape.middle.coords) + placed.rest.height_m;
        let height = Vector6::z();
        equations.add(&height, middle.z - height_m, weight(HEIGHT_M));
        let up = placed.table_from_object * up_in_object.into_inner();
        // A small turn about y moves the up direction along x, and one about x against y.
        let mut about_y = Vector6::zeros();
        about_y[4] = 1.0;
        let mut about_x = Vector6::zeros();
        about_x[3] = -1.0;
        equations.add(&about_y, up.x, weight(TILT_RAD));
        equations.add(&about_x, up.y, weight(TILT_RAD));
    }
}
