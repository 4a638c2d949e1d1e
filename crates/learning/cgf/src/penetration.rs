//! Penetration depth of a hand in the object and in the table, as a loss with its gradient.

use std::sync::Arc;

use candle_core::{CpuStorage, CustomOp1, Device, Layout, Shape, Tensor};
use geometry::DistanceField;
use nalgebra::{Point3, UnitQuaternion, Vector3};
use rayon::prelude::*;
use robot::{
    RobotModel,
    spheres::{SLACK, SphereCluster, TooLarge, clusters},
};
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

/// A hand's collision shapes filled with spheres.
#[derive(Debug, Clone)]
pub(crate) struct Body {
    hand: Arc<RobotModel>,
    clusters: Vec<SphereCluster>,
}

/// Penetration of a link: the depth of its deepest sphere, that sphere's center in the palm frame, and
/// the direction out of the object or table, in the frame of the row.
#[derive(Debug, Clone, Copy)]
struct Deepest {
    depth_m: f64,
    center_in_palm: Vector3<f64>,
    outwards: Vector3<f64>,
}

impl Body {
    pub(crate) fn new(hand: Arc<RobotModel>) -> Result<Self, TooLarge> {
        let clusters = clusters(&hand)?;
        Ok(Self { hand, clusters })
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
        let mut deepest = vec![[None; 2]; n_links];
        for cluster in &self.clusters {
            search(&posed, cluster, around, &mut deepest[cluster.link]);
        }
        if deepest.iter().flatten().all(Option::is_none) {
            return 0.0;
        }
        let mut forces = Forces::on(&posed);
        let mut squares = 0.0;
        for (link, deepest) in deepest.iter().enumerate() {
            for deepest in deepest.iter().flatten() {
                squares += deepest.depth_m * deepest.depth_m;
                let force = deepest.outwards * (-2.0 * deepest.depth_m / n_links as f64);
                forces.push(link, &deepest.center_in_palm, &force);
            }
        }
        forces.generalized(gradient);
        narrow(squares / n_links as f64)
    }
}

/// Looks for spheres of a cluster that are deeper, in the object and in the table.
fn search(
    posed: &Posed<'_>,
    cluster: &SphereCluster,
    around: &PenetrationScene,
    deepest: &mut [Option<Deepest>; 2],
) {
    let palm_from_link = &posed.palm_from_links[cluster.link];
    let place = |center_in_link: &Point3<f64>| {
        let in_palm = (*palm_from_link * *center_in_link).coords;
        (in_palm, Point3::from(posed.seen(&in_palm)))
    };
    let (_, center) = place(&cluster.around.center_in_link);
    let reach_m = cluster.around.radius_m;
    let distance =
        |seen: &Point3<f64>| around.field.distance(&(around.object_from_network * *seen));
    let height = |seen: &Point3<f64>| (around.table_from_network * *seen).z;
    let may_be_in = [
        distance(&center).0 < SLACK * reach_m,
        height(&center) < reach_m,
    ];
    if may_be_in == [false; 2] {
        return;
    }
    for sphere in &cluster.spheres {
        let (center_in_palm, seen) = place(&sphere.center_in_link);
        let mut note = |which: usize, depth_m: f64, outwards: &dyn Fn() -> Vector3<f64>| {
            let known_m = deepest[which].map_or(0.0, |known| known.depth_m);
            if depth_m > known_m {
                deepest[which] = Some(Deepest {
                    depth_m,
                    center_in_palm,
                    outwards: outwards(),
                });
            }
        };
        if may_be_in[0] {
            let (distance, away) = distance(&seen);
            let turned = || around.object_from_network.rotation.inverse() * away;
            note(0, sphere.radius_m - distance, &turned);
        }
        if may_be_in[1] {
            let up = || around.table_from_network.rotation.inverse() * Vector3::z();
            note(1, sphere.radius_m - height(&seen), &up);
        }
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
