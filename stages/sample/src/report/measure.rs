//! Plausibility of each motion, and its distance from the object's demonstrations.

use diversity::{Diversity, distance};
use motion::Step;
use rayon::prelude::*;
use robot::WrongDof;
use sampling::PenetrationProbe;
use schemas::{
    candidates::Candidate,
    sampling::{GraspDistance, SampleMeasures},
    trajectories::Trajectory,
};
use spatial::Object;

/// Meters that count as much as a radian where grasps are compared: about a hand's length.
const ARM_M: f64 = 0.1;

/// Reference for the motions of an object.
pub(crate) struct Measure<'a> {
    pub(crate) probe: PenetrationProbe<'a>,
    /// The object's demonstrations, their joints in the candidates' order.
    pub(crate) shown: &'a [Trajectory],
}

impl Measure<'_> {
    /// Measures all motions of the object, in their order.
    pub(crate) fn all(
        &self,
        candidates: &[Candidate],
        diversity: &Diversity,
    ) -> Result<Vec<SampleMeasures>, WrongDof> {
        candidates
            .par_iter()
            .enumerate()
            .map(|(idx, candidate)| {
                let is_compared = diversity.is_compared.get(idx).copied();
                let from_mean = diversity.from_mean.get(idx).copied().flatten();
                Ok(SampleMeasures {
                    demonstration: self.nearest(candidate.motion.grasp()),
                    from_mean: from_mean.filter(|_| is_compared == Some(true)),
                    ..self.depths(candidate)?
                })
            })
            .collect()
    }

    /// Measures how deep the hand is in object and table over a motion.
    fn depths(&self, candidate: &Candidate) -> Result<SampleMeasures, WrongDof> {
        let mut sampled = SampleMeasures {
            candidate_id: candidate.candidate_id.clone(),
            limit_excess_rad: candidate.limit_excess_rad,
            approach_depth_m: 0.0,
            approach_depth_time_s: None,
            grasp_depth_m: 0.0,
            table_depth_m: 0.0,
            demonstration: None,
            from_mean: None,
        };
        let (table_from_object, motion) = (&candidate.table_from_object, &candidate.motion);
        for step in &motion.steps()[..motion.steps().len() - 1] {
            let depth = self.probe.depth(table_from_object, step)?;
            if depth.object_m > sampled.approach_depth_m {
                sampled.approach_depth_m = depth.object_m;
                sampled.approach_depth_time_s = Some(step.time_s);
            }
            sampled.table_depth_m = sampled.table_depth_m.max(depth.table_m);
        }
        let depth = self.probe.depth(table_from_object, motion.grasp())?;
        sampled.grasp_depth_m = depth.object_m;
        sampled.table_depth_m = sampled.table_depth_m.max(depth.table_m);
        Ok(sampled)
    }

    /// Returns the demonstration whose grasp is nearest, a radian counting as much as [`ARM_M`].
    fn nearest(&self, grasp: &Step<Object>) -> Option<(String, GraspDistance)> {
        let far =
            |distance: &GraspDistance| distance.palm_m / ARM_M + distance.palm_rad + distance.q_rad;
        let all = self
            .shown
            .iter()
            .map(|shown| (shown, distance(grasp, shown.motion.grasp())));
        let (shown, distance) = all.min_by(|(_, a), (_, b)| far(a).total_cmp(&far(b)))?;
        Some((shown.sequence.clone(), distance))
    }
}
