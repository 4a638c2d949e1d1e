//! How plausible each motion is and how far from the object's demonstrations.

use diversity::{Diversity, root_mean_square};
use geometry::DistanceField;
use rayon::prelude::*;
use schemas::{
    candidates::{Candidate, Step},
    sampling::{GraspDistance, Sampled},
};
use spatial::Rest;

use crate::room::{Depth, Room};

/// Meters that count as much as a radian where grasps are compared: about a hand's length.
const ARM_M: f64 = 0.1;

/// A demonstration, its joints in the candidates' order.
pub(crate) struct Shown {
    /// Name of its sequence.
    pub(crate) sequence: String,
    /// How the object lay.
    pub(crate) rest: Rest,
    /// The steps before the grasp.
    pub(crate) approach: Vec<Step>,
    /// The hand at the grasp.
    pub(crate) grasp: Step,
}

/// What tells how deep motions of an object are in things.
#[derive(Clone, Copy)]
pub(crate) struct Gauge<'a> {
    pub(crate) room: &'a Room<'a>,
    /// Distances about the object.
    pub(crate) field: &'a DistanceField,
    /// Which of a candidate's joints each of the hand's is.
    pub(crate) columns: &'a [usize],
}

impl Gauge<'_> {
    /// Measures how deep the hand is at one step.
    fn depth(&self, candidate: &Candidate, step: &Step) -> Depth {
        let q: Vec<f64> = self
            .columns
            .iter()
            .filter_map(|&column| step.q_rad.get(column).copied())
            .collect();
        self.room.depth(
            self.field,
            step.object_from_palm.isometry(),
            candidate.table_from_object.isometry(),
            &q,
        )
    }

    /// Returns how deep the hand is in object or table at its deepest, in meters.
    pub(crate) fn deepest_m(&self, candidate: &Candidate) -> f64 {
        let depths = candidate.steps.iter().map(|step| {
            let depth = self.depth(candidate, step);
            depth.object_m.max(depth.table_m)
        });
        depths.fold(0.0, f64::max)
    }
}

/// What motions of an object are measured against.
pub(crate) struct Measure<'a> {
    pub(crate) gauge: Gauge<'a>,
    /// The object's demonstrations.
    pub(crate) shown: &'a [Shown],
}

impl Measure<'_> {
    /// Measures all motions of the object, in their order.
    pub(crate) fn all(&self, candidates: &[Candidate], diversity: &Diversity) -> Vec<Sampled> {
        candidates
            .par_iter()
            .enumerate()
            .map(|(idx, candidate)| {
                let grasp = candidate.steps.last();
                let from_mean = diversity.from_mean.get(idx).copied().flatten();
                Sampled {
                    demonstration: grasp.and_then(|grasp| self.nearest(grasp)),
                    from_mean: from_mean.unwrap_or_default(),
                    ..self.depths(candidate)
                }
            })
            .collect()
    }

    /// Measures how deep the hand is in object and table over a motion.
    fn depths(&self, candidate: &Candidate) -> Sampled {
        let mut sampled = Sampled {
            candidate_id: candidate.candidate_id.clone(),
            limit_excess_rad: candidate.limit_excess_rad,
            approach_depth_m: 0.0,
            approach_depth_time_s: 0.0,
            grasp_depth_m: 0.0,
            table_depth_m: 0.0,
            demonstration: None,
            from_mean: GraspDistance::default(),
        };
        let Some((grasp, approach)) = candidate.steps.split_last() else {
            return sampled;
        };
        for step in approach {
            let depth = self.gauge.depth(candidate, step);
            if depth.object_m > sampled.approach_depth_m {
                sampled.approach_depth_m = depth.object_m;
                sampled.approach_depth_time_s = step.time_s;
            }
            sampled.table_depth_m = sampled.table_depth_m.max(depth.table_m);
        }
        let depth = self.gauge.depth(candidate, grasp);
        sampled.grasp_depth_m = depth.object_m;
        sampled.table_depth_m = sampled.table_depth_m.max(depth.table_m);
        sampled
    }

    /// Returns the demonstration whose grasp is nearest, a radian counting as much as [`ARM_M`].
    fn nearest(&self, grasp: &Step) -> Option<(String, GraspDistance)> {
        let far =
            |distance: &GraspDistance| distance.palm_m / ARM_M + distance.palm_rad + distance.q_rad;
        let all = self
            .shown
            .iter()
            .map(|shown| (shown, between(grasp, &shown.grasp)));
        let (shown, distance) = all.min_by(|(_, a), (_, b)| far(a).total_cmp(&far(b)))?;
        Some((shown.sequence.clone(), distance))
    }
}

fn between(a: &Step, b: &Step) -> GraspDistance {
    let (pose_a, pose_b) = (a.object_from_palm.isometry(), b.object_from_palm.isometry());
    GraspDistance {
        palm_m: (pose_a.translation.vector - pose_b.translation.vector).norm(),
        palm_rad: pose_a.rotation.angle_to(&pose_b.rotation),
        q_rad: root_mean_square(&a.q_rad, &b.q_rad),
    }
}
