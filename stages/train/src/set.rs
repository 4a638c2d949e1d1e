//! From artifacts to a training set.

use std::collections::BTreeMap;

use cgf::{Grasp, Scene, TimedGrasp, Track, TrainingSet};
use dataflow::Artifact;
use nalgebra::Point3;
use schemas::{
    objects::{self, Object},
    trajectories::{self, Trajectory},
};
use spatial::Rest;

use crate::TrainError;

/// Reads objects and trajectories and puts every motion above the table of its scene.
pub(crate) fn read(
    objects: &[Artifact],
    trajectories: &[Artifact],
    joints: &[String],
) -> Result<TrainingSet, TrainError> {
    let mut known = BTreeMap::new();
    for artifact in objects {
        let batch = lake::table::read(artifact)?;
        let object = objects::from_batch(&artifact.key, &batch)
            .map_err(|source| schema(artifact, source))?;
        known.insert(artifact.key.clone(), object);
    }
    let mut set = TrainingSet {
        scenes: Vec::new(),
        tracks: Vec::new(),
    };
    let mut scenes = BTreeMap::new();
    for artifact in trajectories {
        let batch = lake::table::read(artifact)?;
        let trajectory = trajectories::from_batch(&artifact.key, &batch)
            .map_err(|source| schema(artifact, source))?;
        let object = known
            .get(&trajectory.object)
            .ok_or_else(|| TrainError::UnknownObject {
                object: trajectory.object.clone(),
                known: known.keys().cloned().collect(),
            })?;
        let (idx, rest) = nearest_rest(object, &trajectory.rest);
        let scene = *scenes.entry((object.name.clone(), idx)).or_insert_with(|| {
            set.scenes.push(scene(object, rest));
            set.scenes.len() - 1
        });
        set.tracks.push(track(&trajectory, rest, scene, joints)?);
    }
    Ok(set)
}

fn schema(artifact: &Artifact, source: schemas::SchemaError) -> TrainError {
    TrainError::Schema {
        key: artifact.key.clone(),
        source,
    }
}

/// Returns the object's resting orientation whose up direction is nearest to the recorded one; the
/// recorded one itself if the object has none.
fn nearest_rest(object: &Object, recorded: &Rest) -> (usize, Rest) {
    let agreement = |rest: &Rest| rest.up_in_object.dot(&recorded.up_in_object);
    object
        .rests
        .iter()
        .map(|orientation| orientation.rest)
        .enumerate()
        .max_by(|(_, a), (_, b)| agreement(a).total_cmp(&agreement(b)))
        .unwrap_or((0, *recorded))
}

fn scene(object: &Object, rest: Rest) -> Scene {
    Scene {
        object: object.name.clone(),
        rest,
        points_in_object: object
            .points_m
            .iter()
            .map(|&point| Point3::from(point))
            .collect(),
    }
}

fn track(
    trajectory: &Trajectory,
    rest: Rest,
    scene: usize,
    joints: &[String],
) -> Result<Track, TrainError> {
    let order: Option<Vec<usize>> = joints
        .iter()
        .map(|joint| trajectory.joints.iter().position(|found| found == joint))
        .collect();
    let order = order
        .filter(|order| order.len() == trajectory.joints.len())
        .ok_or_else(|| TrainError::AnotherHand {
            sequence: trajectory.sequence.clone(),
            expected: joints.to_vec(),
            found: trajectory.joints.clone(),
        })?;
    let table_from_object = rest.table_from_object();
    let steps = trajectory.steps.iter().map(|step| TimedGrasp {
        time_s: step.time_s,
        grasp: Grasp {
            table_from_palm: table_from_object * step.object_from_palm,
            q_rad: order
                .iter()
                .filter_map(|&idx| step.q_rad.get(idx).copied())
                .collect(),
        },
    });
    Ok(Track {
        name: trajectory.sequence.clone(),
        scene,
        steps: steps.collect(),
    })
}
