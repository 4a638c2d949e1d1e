//! Forward kinematics of a hand as one operation with an analytic gradient.

use std::sync::Arc;

use candle_core::{CpuStorage, CustomOp1, DType, Device, Layout, Shape, Tensor};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use robot::{JointKind, Link, RobotModel};
use spatial::{Palm, Pose};

use crate::{hand_numbers::PALM_WIDTH, precision::narrow};

/// Maps `(rows, 9 + dof)` (translation, two columns of a rotation before they are made orthonormal,
/// joint positions; meters and radians) to the poses of all links, in the frame in which translation
/// and rotation are given: `(rows, 3 links)` or `(rows, 9 links)`, as [`LinkParts`] says.
///
/// The origins are the J of the paper's joint loss.
#[derive(Debug, Clone)]
pub(crate) struct LinkPoses {
    hand: Arc<RobotModel>,
    parts: LinkParts,
}

/// Parts of a link's pose to compute.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LinkParts {
    /// Its origin, in meters.
    Origins,
    /// Its origin, in meters, and the first two columns of its rotation.
    OriginsAndColumns,
}

impl LinkParts {
    /// Numbers per link.
    pub(crate) fn width(self) -> usize {
        match self {
            Self::Origins => 3,
            Self::OriginsAndColumns => 9,
        }
    }
}

impl LinkPoses {
    pub(crate) fn new(hand: Arc<RobotModel>, parts: LinkParts) -> Self {
        Self { hand, parts }
    }

    fn width(&self) -> usize {
        self.parts.width() * self.hand.links().len()
    }

    fn forward_row(&self, row: &[f32], poses: &mut [f32]) {
        let hand = Posed::new(&self.hand, row);
        let rotation = hand.frame.rotation;
        let width = self.parts.width();
        for (pose, link) in poses.chunks_exact_mut(width).zip(&hand.palm_from_links) {
            let point = hand.seen(&link.translation.vector);
            let rotation = rotation * link.rotation.to_rotation_matrix();
            let columns = rotation.fixed_columns::<2>(0);
            // As many of these as requested.
            for (number, x) in pose.iter_mut().zip(point.iter().chain(columns.iter())) {
                *number = narrow(*x);
            }
        }
    }

    /// Takes the forces `by_poses` on the link origins, and on the tips of the unit vectors that are
    /// their columns, to the generalized forces on the row.
    fn backward_row(&self, row: &[f32], by_poses: &[f32], by_row: &mut [f32]) {
        let hand = Posed::new(&self.hand, row);
        let mut forces = Forces::on(&hand);
        let by_links = by_poses.chunks_exact(self.parts.width());
        for (idx, (link, by_link)) in hand.palm_from_links.iter().zip(by_links).enumerate() {
            let mut by_vectors = by_link
                .chunks_exact(3)
                .map(|by| Vector3::from_iterator(by.iter().map(|&x| f64::from(x))));
            if let Some(force) = by_vectors.next() {
                forces.push(idx, &link.translation.vector, &force);
            }
            let columns = link.rotation.to_rotation_matrix();
            for (by_column, column) in by_vectors.zip(columns.matrix().column_iter()) {
                forces.turn(idx, &column.into_owned(), &by_column);
            }
        }
        forces.generalized(by_row);
    }
}

/// A hand at the pose that a row of numbers gives.
pub(crate) struct Posed<'a> {
    hand: &'a RobotModel,
    frame: PalmRotation,
    /// The links in the palm frame.
    pub(crate) palm_from_links: Vec<Pose<Palm, Link>>,
}

impl<'a> Posed<'a> {
    /// A row has one joint position per joint of the hand.
    pub(crate) fn new(hand: &'a RobotModel, row: &[f32]) -> Self {
        Self {
            hand,
            frame: PalmRotation::of(row),
            palm_from_links: hand.link_poses(|joint| f64::from(row[PALM_WIDTH + joint])),
        }
    }

    /// Takes a direction from the palm frame to the frame in which the row is.
    pub(crate) fn turned(&self, vector_in_palm: &Vector3<f64>) -> Vector3<f64> {
        self.frame.rotation * vector_in_palm
    }

    /// Takes a point from the palm frame to the frame in which the row is.
    pub(crate) fn seen(&self, point_in_palm: &Vector3<f64>) -> Vector3<f64> {
        self.frame.translation + self.frame.rotation * point_in_palm
    }
}

/// Forces on a hand, which are gradients by points that move with it.
pub(crate) struct Forces<'a> {
    posed: &'a Posed<'a>,
    /// Force and torque about the palm's origin, in the palm frame, on each link.
    wrenches: Vec<(Vector3<f64>, Vector3<f64>)>,
    by_translation: Vector3<f64>,
    by_rotation: Matrix3<f64>,
}

impl<'a> Forces<'a> {
    pub(crate) fn on(posed: &'a Posed<'a>) -> Self {
        Self {
            posed,
            wrenches: vec![(Vector3::zeros(), Vector3::zeros()); posed.palm_from_links.len()],
            by_translation: Vector3::zeros(),
            by_rotation: Matrix3::zeros(),
        }
    }

    /// Adds a force, in the frame in which the row is, on a point of a link.
    pub(crate) fn push(&mut self, link: usize, point_in_palm: &Vector3<f64>, force: &Vector3<f64>) {
        self.by_translation += force;
        self.wrenches[link].0 += self.posed.frame.rotation.transpose() * force;
        self.turn(link, point_in_palm, force);
    }

    /// Adds a force on the tip of a vector that turns with a link and starts anywhere.
    fn turn(&mut self, link: usize, vector_in_palm: &Vector3<f64>, force: &Vector3<f64>) {
        self.by_rotation += force * vector_in_palm.transpose();
        let force_in_palm = self.posed.frame.rotation.transpose() * force;
        self.wrenches[link].1 += vector_in_palm.cross(&force_in_palm);
    }

    /// Returns the generalized forces on the row: for a revolute joint the torque about its axis of
    /// all forces on the links that it moves.
    pub(crate) fn generalized(mut self, by_row: &mut [f32]) {
        let posed = self.posed;
        let mut by_q = vec![0.0; by_row.len() - PALM_WIDTH];
        for (idx, link) in posed.hand.links().iter().enumerate().rev() {
            let (force, torque) = self.wrenches[idx];
            if let Some(parent) = link.parent {
                self.wrenches[parent].0 += force;
                self.wrenches[parent].1 += torque;
            }
            let (Some(joint), Some(kind)) = (link.joint, link.kind) else {
                continue;
            };
            let axis = posed.palm_from_links[idx].rotation * link.axis;
            let origin = posed.palm_from_links[idx].translation.vector;
            let along = match kind {
                JointKind::Revolute | JointKind::Continuous => {
                    axis.dot(&(torque - origin.cross(&force)))
                }
                JointKind::Prismatic => axis.dot(&force),
            };
            by_q[joint] += link.multiplier * along;
        }
        let by_columns = posed.frame.by_columns(&self.by_rotation);
        let by_root = self.by_translation.iter().chain(by_columns.iter());
        for (by, x) in by_row.iter_mut().zip(by_root.chain(&by_q)) {
            *by = narrow(*x);
        }
    }
}

/// A rotation made from two columns by Gram-Schmidt (Zhou et al. 2019, §B), and its derivative.
struct PalmRotation {
    translation: Vector3<f64>,
    first: Vector3<f64>,
    second: Vector3<f64>,
    rotation: Matrix3<f64>,
}

impl PalmRotation {
    fn of(row: &[f32]) -> Self {
        let vector = |at: usize| Vector3::from_fn(|k, _| f64::from(row[at + k]));
        let (first, second) = (vector(3), vector(6));
        let x = first / first.norm();
        let rest = second - x * x.dot(&second);
        let y = rest / rest.norm();
        Self {
            translation: vector(0),
            first,
            second,
            rotation: Matrix3::from_columns(&[x, y, x.cross(&y)]),
        }
    }

    /// Takes the gradient by the matrix to the gradient by the two columns.
    fn by_columns(&self, by_rotation: &Matrix3<f64>) -> [f64; 6] {
        let (x, y) = (self.rotation.column(0), self.rotation.column(1));
        let by_z = by_rotation.column(2);
        let mut by_x = by_rotation.column(0) + y.cross(&by_z);
        let by_y = by_rotation.column(1) + by_z.cross(&x);
        let rest = self.second - x * x.dot(&self.second);
        let by_rest = (by_y - y * y.dot(&by_y)) / rest.norm();
        let by_second = by_rest - x * x.dot(&by_rest);
        by_x -= self.second * x.dot(&by_rest) + by_rest * x.dot(&self.second);
        let by_first = (by_x - x * x.dot(&by_x)) / self.first.norm();
        let (a, b) = (by_first, by_second);
        [a.x, a.y, a.z, b.x, b.y, b.z]
    }
}

impl CustomOp1 for LinkPoses {
    fn name(&self) -> &'static str {
        "link_poses"
    }

    fn cpu_fwd(
        &self,
        storage: &CpuStorage,
        layout: &Layout,
    ) -> candle_core::Result<(CpuStorage, Shape)> {
        let (n_rows, width) = layout.shape().dims2()?;
        let (start, end) = layout
            .contiguous_offsets()
            .ok_or_else(|| candle_core::Error::RequiresContiguous { op: "link_poses" }.bt())?;
        let rows = &storage.as_slice::<f32>()?[start..end];
        let mut poses = vec![0.0; n_rows * self.width()];
        poses
            .par_chunks_mut(self.width())
            .zip(rows.par_chunks(width))
            .with_min_len(16)
            .for_each(|(poses, row)| self.forward_row(row, poses));
        let shape = Shape::from((n_rows, self.width()));
        Ok((CpuStorage::F32(poses), shape))
    }

    fn bwd(
        &self,
        arg: &Tensor,
        _: &Tensor,
        by_result: &Tensor,
    ) -> candle_core::Result<Option<Tensor>> {
        let (n_rows, width) = arg.dims2()?;
        let rows = arg.to_dtype(DType::F32)?.flatten_all()?.to_vec1::<f32>()?;
        let by_poses = by_result.flatten_all()?.to_vec1::<f32>()?;
        let mut by_rows = vec![0.0; n_rows * width];
        by_rows
            .par_chunks_mut(width)
            .zip(rows.par_chunks(width))
            .zip(by_poses.par_chunks(self.width()))
            .with_min_len(16)
            .for_each(|((by_row, row), by)| self.backward_row(row, by, by_row));
        Tensor::from_vec(by_rows, (n_rows, width), &Device::Cpu).map(Some)
    }
}

#[cfg(test)]
mod tests;
