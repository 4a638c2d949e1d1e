//! Penetration depth of a hand in the object and in the table, as a loss with its gradient.

use std::sync::Arc;

use candle_core::{CpuStorage, CustomOp1, Device, Layout, Shape, Tensor};
use geometry::DistanceField;
use nalgebra::{Point3, UnitQuaternion, Vector3};
use rayon::prelude::*;
use robot::{HandCollision, HandSphere, RobotModel, Surroundings, spheres::TooLarge};
use spatial::{Object, Pose, Table};

use crate::{
    CgfError,
    data::NetworkFrame,
    kinematics::{Forces, Posed},
    precision::narrow,
};

/// Object and table that a hand can penetrate, posed relative to the frame of its numbers.
#[derive(Debug, Clone)]
pub(crate) struct PenetrationScene {
    /// Distances to the object's surface.
    pub(crate) field: Arc<DistanceField>,
    pub(crate) object_from_network: Pose<Object, NetworkFrame>,
    /// The table's frame, in which it is the plane z = 0.
    pub(crate) table_from_network: Pose<Table, NetworkFrame>,
}

impl PenetrationScene {
    /// Turns object and table about the origin of the frame in which they are seen.
    pub(crate) fn turned(&self, rotation: &UnitQuaternion<f64>) -> Self {
        let back = rotation.inverse();
        Self {
            field: self.field.clone(),
            object_from_network: Pose::new(*self.object_from_network * back),
            table_from_network: Pose::new(*self.table_from_network * back),
        }
    }
}

/// Points are in the frame of the hand's numbers.
impl Surroundings for PenetrationScene {
    fn object_m(&self, seen: &Point3<f64>) -> f64 {
        self.field.distance(&(self.object_from_network * *seen)).0
    }

    fn object_gradient(&self, seen: &Point3<f64>) -> Vector3<f64> {
        let (_, away) = self.field.distance(&(self.object_from_network * *seen));
        self.object_from_network.rotation.inverse() * away
    }

    fn table_m(&self, seen: &Point3<f64>) -> f64 {
        (self.table_from_network * *seen).z
    }

    fn table_gradient(&self) -> Vector3<f64> {
        self.table_from_network.rotation.inverse() * Vector3::z()
    }
}

/// A hand and its collision shapes.
#[derive(Debug, Clone)]
pub(crate) struct Body {
    hand: Arc<RobotModel>,
    shapes: HandCollision,
}

impl Body {
    pub(crate) fn new(hand: Arc<RobotModel>) -> Result<Self, TooLarge> {
        let shapes = HandCollision::new(&hand)?;
        Ok(Self { hand, shapes })
    }

    /// Computes for each of `(motions × times, 9 + dof)` rows the mean over the links of their squared
    /// depths, in object and table together: `(rows, 1)` in m². A link is as deep as the deepest of
    /// its spheres.
    pub(crate) fn penetration(
        &self,
        rows: &Tensor,
        surroundings: &[PenetrationScene],
    ) -> Result<Tensor, CgfError> {
        let (n_rows, width) = rows.dims2()?;
        let numbers = rows.flatten_all()?.to_vec1::<f32>()?;
        let n_times = (n_rows / surroundings.len().max(1)).max(1);
        let mut values = vec![0.0; n_rows];
        let mut gradients = vec![0.0; n_rows * width];
        values
            .par_iter_mut()
            .zip(gradients.par_chunks_mut(width))
            .zip(numbers.par_chunks(width))
            .enumerate()
            .with_min_len(8)
            .for_each(|(idx, ((value, gradient), row))| {
                if let Some(around) = surroundings.get(idx / n_times) {
                    *value = self.row(row, around, gradient);
                }
            });
        Ok(rows.apply_op1(RowFunction {
            values,
            gradients,
            width,
        })?)
    }

    /// Computes one row's value and gradient.
    fn row(&self, row: &[f32], around: &PenetrationScene, gradient: &mut [f32]) -> f32 {
        let posed = Posed::new(&self.hand, row);
        let n_links = posed.palm_from_links.len();
        let in_palm = |link: usize, center_in_link: &Point3<f64>| {
            (posed.palm_from_links[link] * *center_in_link).coords
        };
        let place = |sphere: &HandSphere| {
            let in_palm = in_palm(sphere.link, &sphere.sphere.center_in_link);
            Some(Point3::from(posed.seen(&in_palm)))
        };
        let deepest = self.shapes.link_depths(around, place, n_links);
        if deepest.iter().flatten().all(Option::is_none) {
            return 0.0;
        }
        let mut forces = Forces::on(&posed);
        let mut squares = 0.0;
        for (link, deepest) in deepest.iter().enumerate() {
            for deepest in deepest.iter().flatten() {
                squares += deepest.depth_m * deepest.depth_m;
                let force = deepest.outward * (-2.0 * deepest.depth_m / n_links as f64);
                forces.push(link, &in_palm(link, &deepest.center_in_link), &force);
            }
        }
        forces.generalized(gradient);
        narrow(squares / n_links as f64)
    }
}

/// A function of rows whose values and gradients are already computed for these rows.
pub(crate) struct RowFunction {
    pub(crate) values: Vec<f32>,
    /// One row of so many numbers for each value.
    pub(crate) gradients: Vec<f32>,
    pub(crate) width: usize,
}

impl CustomOp1 for RowFunction {
    fn name(&self) -> &'static str {
        "known"
    }

    fn cpu_fwd(&self, _: &CpuStorage, _: &Layout) -> candle_core::Result<(CpuStorage, Shape)> {
        let shape = Shape::from((self.values.len(), 1));
        Ok((CpuStorage::F32(self.values.clone()), shape))
    }

    fn bwd(&self, _: &Tensor, _: &Tensor, by: &Tensor) -> candle_core::Result<Option<Tensor>> {
        let by = by.flatten_all()?.to_vec1::<f32>()?;
        let rows = self.gradients.chunks_exact(self.width).zip(&by);
        let scaled: Vec<f32> = rows
            .flat_map(|(row, by)| row.iter().map(move |x| x * by))
            .collect();
        Tensor::from_vec(scaled, (by.len(), self.width), &Device::Cpu).map(Some)
    }
}

#[cfg(test)]
mod tests;
