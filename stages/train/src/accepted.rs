//! Accepted motions to learn from: expert iteration (T. Anthony, Z. Tian and D. Barber, "Thinking Fast and Slow with
//! Deep Learning and Tree Search", 2017), in which refinement and physics are the expert.

use std::collections::BTreeSet;

use cgf::{TrainingMotion, TrainingSet};
use dataflow::{BoxedDiagnostic, Inputs, Scope};
use lake::ReadInputs;
use schemas::{
    Table,
    candidates::{Candidate, Candidates},
    objects::{APART_FROM, Surface},
    rollouts::{Rollouts, Verdict},
    training::Split,
};

use spatial::{Pose, RestingPose};

use crate::{
    TrainError,
    training_set::{self, track},
};

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

/// Returns the generated objects, from which motions are learned without any recording.
///
/// # Errors
///
/// Fails if one of them may be similar to an unseen object.
pub(crate) fn shapes<'a>(
    scope: &'a Scope,
    unseen: &BTreeSet<&str>,
) -> Result<BTreeSet<&'a str>, BoxedDiagnostic> {
    let mut shapes = BTreeSet::new();
    for object in scope.partitions(Surface::NAME) {
        let Some(apart_from) = object.label(APART_FROM) else {
            continue;
        };
        let apart_from: BTreeSet<&str> = apart_from.split(',').collect();
        if let Some(unseen) = unseen.iter().find(|name| !apart_from.contains(*name)) {
            return Err(TrainError::SimilarToUnseen {
                shape: object.key.to_string(),
                unseen: (*unseen).to_owned(),
            }
            .into());
        }
        shapes.insert(object.key.as_str());
    }
    Ok(shapes)
}

/// Smallest cosine of the angle between up directions at which an object lies as in a scene.
const LIES_ALIKE: f64 = 1.0 - 1e-9;

/// Reads the first `per_object` accepted motions of each object, of those in which the object lies as in a
/// trajectory; the scenes of an object without trajectories are added. Those that were drawn keep their codes if the
/// training goes on from the function that drew them: it learns to give at once what refinement made of them.
///
/// # Errors
///
/// Fails if a table cannot be read, a motion has no rollout, it is of another hand, or it was carried over from an
/// unseen object.
pub(crate) fn read(
    inputs: &Inputs,
    set: &mut TrainingSet,
    joints: &[String],
    per_object: usize,
    keeps_codes: bool,
) -> Result<Vec<TrainingMotion>, BoxedDiagnostic> {
    let mut found = Vec::new();
    let surfaces: Vec<Surface> = inputs.all()?;
    let of_unseen = set
        .tracks
        .iter()
        .filter(|track| track.split == Split::Unseen);
    let unseen: BTreeSet<String> = of_unseen.map(|track| track.name.clone()).collect();
    let recorded: BTreeSet<String> = set
        .scenes
        .iter()
        .map(|scene| scene.object.clone())
        .collect();
    let candidates: Vec<Candidates> = inputs.all()?;
    let rollouts: Vec<Rollouts> = inputs.all()?;
    for (candidates, rollouts) in candidates.iter().zip(&rollouts) {
        let object = &candidates.object;
        let shape = surfaces.iter().find(|surface| surface.name == *object);
        let shape = shape.filter(|_| !recorded.contains(object));
        let mut left = per_object;
        for candidate in held(candidates, rollouts, &unseen)? {
            if left == 0 {
                break;
            }
            let Some(scene) = scene(set, object, &candidate.table_from_object).or_else(|| {
                let rest = RestingPose::of(&candidate.table_from_object);
                set.scenes.push(training_set::scene(shape?, rest));
                Some(set.scenes.len() - 1)
            }) else {
                continue;
            };
            let table_from_object = set.scenes[scene].rest.table_from_object();
            let motion = candidate.motion.with_rates(|_| ());
            let motion = motion.map(|one| one.expressed_in(&table_from_object));
            let is_drawn = !candidate.latent.is_empty();
            found.push(TrainingMotion {
                code: (keeps_codes && is_drawn).then(|| candidate.latent.clone()),
                ..track(&candidate.candidate_id, scene, motion, joints)?
            });
            left -= 1;
        }
    }
    Ok(found)
}

/// Returns the motions that hold their object.
fn held<'a>(
    candidates: &'a Candidates,
    rollouts: &Rollouts,
    unseen: &BTreeSet<String>,
) -> Result<Vec<&'a Candidate>, TrainError> {
    let mut held = Vec::new();
    for candidate in &candidates.candidates {
        let id = &candidate.candidate_id;
        let demonstration = &candidate.source.demonstration;
        if unseen.contains(demonstration) {
            return Err(TrainError::OfUnseen {
                candidate: id.clone(),
                demonstration: demonstration.clone(),
            });
        }
        let rollout = rollouts.iter().find(|rollout| rollout.candidate_id == *id);
        let rollout = rollout.ok_or_else(|| TrainError::NoRollout {
            candidate: id.clone(),
        })?;
        if rollout.verdict == Verdict::Held {
            held.push(candidate);
        }
    }
    Ok(held)
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
