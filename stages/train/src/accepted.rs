//! Accepted motions to learn from: expert iteration (T. Anthony, Z. Tian and D. Barber, "Thinking Fast and Slow with
//! Deep Learning and Tree Search", 2017), in which refinement and physics are the expert.

use std::collections::BTreeSet;

use cgf::{TrainingMotion, TrainingSet};
use dataflow::{BoxedDiagnostic, Inputs, Scope};
use lake::ReadInputs;
use schemas::{
    Table,
    candidates::Candidates,
    rollouts::{Rollouts, Verdict},
};

use spatial::{Pose, RestingPose};

use crate::{TrainError, training_set::track};

/// Returns the partitions of candidates and rollouts that are learned from; none if neither is wired.
///
/// # Errors
///
/// Fails if only one of them is wired, or an object has one and not the other.
pub(crate) fn partitions(
    scope: &Scope,
    is_seen: impl Fn(&str) -> bool,
) -> Result<Vec<&str>, BoxedDiagnostic> {
    let [candidates, rollouts] = [Candidates::NAME, Rollouts::NAME].map(|name| {
        let partitions = scope.partitions(name).iter();
        let keys = partitions.map(|partition| partition.key.as_str());
        keys.filter(|key| is_seen(key)).collect::<BTreeSet<_>>()
    });
    if let Some(object) = candidates.symmetric_difference(&rollouts).next() {
        return Err(TrainError::OneOfTwo {
            object: (*object).to_owned(),
            has: if candidates.contains(object) {
                Candidates::NAME
            } else {
                Rollouts::NAME
            },
            lacks: if candidates.contains(object) {
                Rollouts::NAME
            } else {
                Candidates::NAME
            },
        }
        .into());
    }
    Ok(candidates.into_iter().collect())
}

/// Smallest cosine of the angle between up directions at which an object lies as in a scene.
const LIES_ALIKE: f64 = 1.0 - 1e-9;

/// Reads the first `per_object` accepted motions of each object, of those in which the object lies as in a
/// trajectory.
///
/// # Errors
///
/// Fails if a table cannot be read, a motion has no rollout, or it is of another hand.
pub(crate) fn read(
    inputs: &Inputs,
    set: &TrainingSet,
    joints: &[String],
    per_object: usize,
) -> Result<Vec<TrainingMotion>, BoxedDiagnostic> {
    let mut found = Vec::new();
    let candidates: Vec<Candidates> = inputs.all()?;
    let rollouts: Vec<Rollouts> = inputs.all()?;
    for (candidates, rollouts) in candidates.iter().zip(&rollouts) {
        let mut accepted = Vec::new();
        for candidate in &candidates.candidates {
            let id = &candidate.candidate_id;
            let rollout = rollouts.iter().find(|rollout| rollout.candidate_id == *id);
            let rollout = rollout.ok_or_else(|| TrainError::NoRollout {
                candidate: id.clone(),
            })?;
            if rollout.verdict == Verdict::Held {
                accepted.push(candidate);
            }
        }
        let in_scenes = accepted.into_iter().filter_map(|candidate| {
            let scene = scene(set, &candidates.object, &candidate.table_from_object)?;
            Some((candidate, scene))
        });
        for (candidate, scene) in in_scenes.take(per_object) {
            let table_from_object = set.scenes[scene].rest.table_from_object();
            let motion = candidate.motion.with_rates(|_| ());
            let motion = motion.map(|one| one.expressed_in(&table_from_object));
            found.push(track(&candidate.candidate_id, scene, motion, joints)?);
        }
    }
    Ok(found)
}

/// Returns the scene in which an object lies like this; `None` if it does in no trajectory.
fn scene(
    set: &TrainingSet,
    object: &str,
    table_from_object: &Pose<spatial::Table, spatial::Object>,
) -> Option<usize> {
    let rest = RestingPose::of(table_from_object);
    set.scenes.iter().position(|scene| {
        scene.object == object && scene.rest.up_in_object.dot(&rest.up_in_object) > LIES_ALIKE
    })
}
