//! The cost at a posture, and its first two derivatives.

use nalgebra::{IsometryMatrix3, Matrix3, Point3, Rotation3, Translation3, Vector3};

use crate::{
    compiled::{CompiledHand, Root},
    moments::{Moments, SpatialVector},
    pairs::PairRows,
    posture::{RootPose, logarithm},
    task::{PairResidual, Residual, Task, Terms},
    trig::{LANES, sin_cos},
    vectors::{EndMotion, VectorPull},
};

/// The carrier of no moments.
pub(crate) const NOBODY: usize = usize::MAX;

/// A posture in the order of the unknowns.
#[derive(Debug, Clone)]
pub(crate) struct State {
    pub(crate) root: RootPose,
    /// The joints' positions.
    pub(crate) q: Vec<f64>,
}

/// Pose of a body: its orientation, and its origin relative to the root's, along the object's axes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BodyPose {
    pub(crate) rotation: Matrix3<f64>,
    pub(crate) origin: Vector3<f64>,
}

impl BodyPose {
    /// Returns the body's twist per unit of its joint's motion.
    #[inline]
    pub(crate) fn twist(&self, is_prismatic: bool) -> SpatialVector {
        let [_, _, axis] = columns(&self.rotation);
        if is_prismatic {
            return SpatialVector {
                linear: axis,
                angular: Vector3::zeros(),
            };
        }
        SpatialVector {
            linear: self.origin.cross(&axis),
            angular: axis,
        }
    }
}

/// Contribution of a targeted point to the cost.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pull {
    pub(crate) body: usize,
    /// The point, relative to the root's origin.
    pub(crate) r: Vector3<f64>,
    pub(crate) slope: Vector3<f64>,
    /// Along the axes: exact, and of parabolas that lie above.
    pub(crate) curvature: Vector3<f64>,
    pub(crate) convex: Vector3<f64>,
}

/// The bodies at a posture, with memory for all that is computed from them.
#[derive(Debug)]
pub(crate) struct Evaluation<'a> {
    pub(crate) hand: &'a CompiledHand,
    pub(crate) frames: Vec<BodyPose>,
    pub(crate) root: RootPose,
    /// Joint positions at which the bodies are placed; NaN before the first placement.
    pub(crate) q: Vec<f64>,
    /// Each body's own position, filled up so that sines are computed in whole groups.
    pub(crate) positions: Vec<f64>,
    pub(crate) sines: Vec<f64>,
    pub(crate) cosines: Vec<f64>,
    pub(crate) pulls: Vec<Pull>,
    pub(crate) vector_pulls: Vec<VectorPull>,
    /// Memory for the motions of a vector's ends.
    pub(crate) end_motions: [Vec<EndMotion>; 2],
    pub(crate) residuals: Vec<Residual>,
    pub(crate) pair_residuals: Vec<PairResidual>,
    /// Second derivatives of the residuals of pairs, beside the Hessian.
    pub(crate) pairs: PairRows,
    pub(crate) moments: Vec<Moments>,
    /// Index of the body whose memory holds each body's moments; [`NOBODY`] where there are none.
    pub(crate) carriers: Vec<usize>,
    pub(crate) twists: Vec<SpatialVector>,
    /// Forces and moments alone.
    pub(crate) wrenches: Vec<SpatialVector>,
    /// First derivatives by the unknowns.
    pub(crate) gradient: Vec<f64>,
    /// Second derivatives, as [`crate::layout::Layout`] says.
    pub(crate) hessian: Vec<f64>,
}

/// A hand at a posture.
#[derive(Debug, Clone, Copy)]
pub struct Posed<'a> {
    hand: &'a CompiledHand,
    frames: &'a [BodyPose],
    root: &'a RootPose,
}

impl Posed<'_> {
    /// Returns the position of an attached point in the object's frame, in meters; `None` if there is
    /// none of this number.
    #[inline]
    pub fn point(&self, point: usize) -> Option<Point3<f64>> {
        let point = self.hand.points.get(point)?;
        let frame = self.frames.get(point.body)?;
        let r = frame.origin + frame.rotation * point.offset;
        Some(Point3::from(self.root.translation + r))
    }

    /// Returns the pose of a link in the object's frame; `None` if the model has none of this number.
    #[inline]
    pub fn link(&self, link: usize) -> Option<IsometryMatrix3<f64>> {
        let link = self.hand.links.get(link)?;
        let frame = self.frames.get(link.body)?;
        let [x, y, z] = columns(&frame.rotation);
        let turned = |v: Vector3<f64>| x * v.x + y * v.y + z * v.z;
        let rotation = Matrix3::from_columns(&columns(&link.rotation).map(turned));
        let origin = self.root.translation + frame.origin + turned(link.translation);
        Some(IsometryMatrix3::from_parts(
            Translation3::from(origin),
            Rotation3::from_matrix_unchecked(rotation),
        ))
    }
}

impl<'a> Evaluation<'a> {
    pub(crate) fn new(hand: &'a CompiledHand) -> Self {
        let n_bodies = hand.bodies.len();
        Self {
            hand,
            frames: vec![
                BodyPose {
                    rotation: Matrix3::identity(),
                    origin: Vector3::zeros(),
                };
                n_bodies
            ],
            root: RootPose::identity(),
            q: vec![f64::NAN; hand.dof()],
            positions: vec![0.0; n_bodies.next_multiple_of(LANES)],
            sines: vec![0.0; n_bodies.next_multiple_of(LANES)],
            cosines: vec![1.0; n_bodies.next_multiple_of(LANES)],
            pulls: Vec::new(),
            vector_pulls: Vec::new(),
            end_motions: [Vec::new(), Vec::new()],
            residuals: Vec::new(),
            pair_residuals: Vec::new(),
            pairs: PairRows::default(),
            moments: vec![Moments::ZERO; n_bodies],
            carriers: vec![NOBODY; n_bodies],
            twists: vec![SpatialVector::ZERO; n_bodies],
            wrenches: vec![SpatialVector::ZERO; n_bodies],
            gradient: vec![0.0; hand.layout.n],
            hessian: vec![0.0; hand.layout.n * hand.layout.stride],
        }
    }

    /// Returns the hand at its last placed posture.
    pub(crate) fn posed(&self) -> Posed<'_> {
        Posed {
            hand: self.hand,
            frames: &self.frames,
            root: &self.root,
        }
    }

    /// Places the bodies and returns the cost.
    pub(crate) fn cost<T: Terms>(&mut self, state: &State, task: &Task<'_>, terms: &mut T) -> f64 {
        self.place(state);
        let mut cost = self.pull(task) + self.springs_cost(state, task);
        self.vector_pulls.clear();
        if let Some(vectors) = &task.vectors {
            cost += self.pull_vectors(vectors);
        }
        self.residuals.clear();
        let posed = Posed {
            hand: self.hand,
            frames: &self.frames,
            root: &self.root,
        };
        terms.residuals(&posed, &mut self.residuals);
        for residual in &self.residuals {
            cost += (residual.weight * residual.residual).powi(2);
        }
        self.pair_residuals.clear();
        terms.pair_residuals(&posed, &mut self.pair_residuals);
        for residual in &self.pair_residuals {
            cost += (residual.weight * residual.residual).powi(2);
        }
        cost
    }

    fn place(&mut self, state: &State) {
        // A search begins where the one before ended: then the bodies are there already.
        if self.root == state.root && self.q == state.q && self.hand.dof() > 0 {
            return;
        }
        self.root = state.root;
        self.q.copy_from_slice(&state.q);
        let bodies = &self.hand.bodies;
        let (n_root, unknowns) = (self.hand.layout.n_root, &self.hand.layout.unknowns);
        for (idx, body) in bodies.iter().enumerate().skip(1) {
            let q = state.q[unknowns[idx] - n_root];
            self.positions[idx] = body.multiplier * q + body.offset;
        }
        sin_cos(&self.positions, &mut self.sines, &mut self.cosines);
        self.frames[0].rotation = state.root.rotation;
        for (idx, body) in bodies.iter().enumerate().skip(1) {
            let parent = &self.frames[body.parent];
            let [x, y, z] = columns(&parent.rotation);
            let t = &body.translation;
            let mut origin = parent.origin + (x * t.x + y * t.y + z * t.z);
            // Column by column: nalgebra's general product is several times slower.
            let [u, v, w] = columns(&body.rotation).map(|c| x * c.x + y * c.y + z * c.z);
            let rotation = if body.is_prismatic {
                origin += w * self.positions[idx];
                Matrix3::from_columns(&[u, v, w])
            } else {
                let (s, c) = (self.sines[idx], self.cosines[idx]);
                Matrix3::from_columns(&[u * c + v * s, v * c - u * s, w])
            };
            self.frames[idx] = BodyPose { rotation, origin };
        }
    }

    /// Records the contributions of the targets and of the points' smoothness, and returns their cost.
    fn pull(&mut self, task: &Task<'_>) -> f64 {
        self.pulls.clear();
        let mut cost = 0.0;
        for (idx, target) in task.targets.iter().enumerate() {
            let point = &self.hand.points[target.point];
            let frame = &self.frames[point.body];
            let r = frame.origin + frame.rotation * point.offset;
            let at = self.root.translation + r;
            let difference = at - target.point_in_object.coords;
            let mut pull = Pull {
                body: point.body,
                r,
                slope: Vector3::zeros(),
                curvature: Vector3::zeros(),
                convex: Vector3::zeros(),
            };
            for axis in 0..3 {
                let [loss, slope, curvature, convex] = task.loss.at(difference[axis]);
                cost += target.weight * loss;
                pull.slope[axis] = target.weight * slope;
                pull.curvature[axis] = target.weight * curvature;
                pull.convex[axis] = target.weight * convex;
            }
            if let Some(smoothness) = &task.smoothness
                && smoothness.point_weight > 0.0
            {
                let moved = at - smoothness.points[idx].coords;
                let weight = smoothness.point_weight;
                cost += weight * moved.norm_squared();
                pull.slope += moved * (2.0 * weight);
                pull.curvature.add_scalar_mut(2.0 * weight);
                pull.convex.add_scalar_mut(2.0 * weight);
            }
            self.pulls.push(pull);
        }
        cost
    }

    /// Returns the cost of motion against the posture before, and of distance from rest.
    fn springs_cost(&self, state: &State, task: &Task<'_>) -> f64 {
        let mut cost = 0.0;
        let joints = &self.hand.layout.joints;
        if let Some(smoothness) = &task.smoothness {
            if smoothness.joint_weight > 0.0 {
                let mut sum = 0.0;
                for (q, &joint) in state.q.iter().zip(joints) {
                    sum += (q - smoothness.posture.q[joint]).powi(2);
                }
                cost += smoothness.joint_weight * sum;
            }
            if smoothness.root_weight > 0.0 && self.hand.layout.n_root > 0 {
                let (along, turned) = self.root_motion(&state.root, &smoothness.posture.root);
                cost += smoothness.root_weight * (along.norm_squared() + turned.norm_squared());
            }
        }
        if let Some(prior) = &task.prior {
            let mut sum = 0.0;
            for (q, &joint) in state.q.iter().zip(joints) {
                sum += (q - prior.q[joint]).powi(2);
            }
            cost += prior.weight * sum;
        }
        cost
    }

    /// Returns the translation and the turn of the root, in the coordinates of its unknowns.
    pub(crate) fn root_motion(
        &self,
        root: &RootPose,
        before: &RootPose,
    ) -> (Vector3<f64>, Vector3<f64>) {
        let along = root.translation - before.translation;
        let turned = match self.hand.root {
            Root::Angles => root.angles - before.angles,
            Root::Free | Root::Fixed => logarithm(&(root.rotation * before.rotation.transpose())),
        };
        (along, turned)
    }
}

/// Returns a matrix's columns.
#[inline]
pub(crate) fn columns(matrix: &Matrix3<f64>) -> [Vector3<f64>; 3] {
    let m = &matrix.data.0;
    [
        Vector3::from(m[0]),
        Vector3::from(m[1]),
        Vector3::from(m[2]),
    ]
}
