//! What one frame asks of the robot.

use nalgebra::{Point3, Vector3};
use posture::{
    Loss, Posed, Posture, PosturePrior, Smoothness, Target, Task, VectorTarget, VectorTargets,
};

use crate::{Objective, ObjectiveKind, pinch::Pinches};

/// The targets of a frame.
#[derive(Debug)]
pub(crate) struct Aim {
    pinches: Option<Pinches>,
    targets: Vec<Target>,
    vectors: Vec<VectorTarget>,
    /// Nothing draws points to where they were: as many as targets.
    points: Vec<Point3<f64>>,
}

/// What the search for a frame stays near.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Near<'t> {
    /// The posture of the frame before, as the objective says.
    Before(&'t Posture),
    /// Joint positions, the root free: for a search afresh.
    Rest(&'t [f64]),
}

impl Aim {
    pub(crate) fn new(objective: &Objective) -> Self {
        let pinches = match objective.kind {
            ObjectiveKind::DexPilot {
                fingers,
                scale,
                project_distance_m,
                escape_distance_m,
                ..
            } => Some(Pinches::new(
                fingers,
                scale,
                project_distance_m,
                escape_distance_m,
            )),
            ObjectiveKind::Position { .. } | ObjectiveKind::Vector { .. } => None,
        };
        Self {
            pinches,
            targets: Vec::new(),
            vectors: Vec::new(),
            points: Vec::new(),
        }
    }

    /// Forgets the frames so far.
    pub(crate) fn reset(&mut self) {
        if let Some(pinches) = &mut self.pinches {
            pinches.reset();
        }
    }

    /// Sets the targets of a frame.
    pub(crate) fn set(&mut self, objective: &Objective, references: &[[f64; 3]]) {
        self.targets.clear();
        self.vectors.clear();
        let n = references.len() as f64;
        match &objective.kind {
            ObjectiveKind::Position { .. } => {
                // The mean is over the axes, too.
                let weight = 1.0 / (3.0 * n);
                let targets = references.iter().enumerate();
                self.targets.extend(targets.map(|(point, &at)| Target {
                    point,
                    point_in_object: Point3::from(at),
                    weight,
                }));
                self.points.resize(references.len(), Point3::origin());
            }
            ObjectiveKind::Vector { scale, .. } => {
                let vectors = references.iter().enumerate();
                self.vectors
                    .extend(vectors.map(|(vector, &reference)| VectorTarget {
                        vector,
                        vector_in_object: Vector3::from(reference) * *scale,
                        weight: 1.0 / n,
                    }));
            }
            ObjectiveKind::DexPilot { .. } => {
                let vectors = &mut self.vectors;
                if let Some(pinches) = &mut self.pinches {
                    pinches.targets(references, |vector, vector_in_object, weight| {
                        vectors.push(VectorTarget {
                            vector,
                            vector_in_object,
                            weight: weight / n,
                        });
                    });
                }
            }
        }
    }

    /// Returns the frame's objective.
    pub(crate) fn task<'t>(&'t self, objective: &Objective, near: Near<'t>) -> Task<'t> {
        let (beta_m, weight) = (objective.huber_delta_m, objective.normal_delta);
        let (smoothness, prior) = match near {
            Near::Before(posture) => {
                let smoothness = Smoothness {
                    points: &self.points,
                    point_weight: 0.0,
                    posture,
                    joint_weight: weight,
                    root_weight: weight,
                };
                (Some(smoothness), None)
            }
            Near::Rest(q) => (
                None,
                Some(PosturePrior {
                    q,
                    weight: REST * weight,
                }),
            ),
        };
        Task {
            targets: &self.targets,
            loss: Loss::SmoothL1 { beta_m },
            vectors: Some(VectorTargets {
                vectors: &self.vectors,
                beta_m,
            }),
            smoothness,
            prior,
        }
    }

    /// Writes the distances of what follows from what it follows; `ends` are the points of the vectors.
    pub(crate) fn measure(&self, posed: &Posed<'_>, ends: &[[usize; 2]], errors_m: &mut Vec<f64>) {
        let at = |point: usize| posed.point(point).map_or(Vector3::zeros(), |at| at.coords);
        errors_m.clear();
        for target in &self.targets {
            errors_m.push((at(target.point) - target.point_in_object.coords).norm());
        }
        for target in &self.vectors {
            let [from, to] = ends[target.vector];
            errors_m.push((at(to) - at(from) - target.vector_in_object).norm());
        }
    }
}

/// Weight of the distance from rest in a search afresh, relative to that of motion: it decides where nothing else does.
const REST: f64 = 0.01;
