//! From artifacts to a training set.

use std::{collections::BTreeMap, sync::Arc};

use cgf::{Description, Random, RestingObject, TrainingMotion, TrainingSet};
use dataflow::{BoxedDiagnostic, InputError, Inputs};
use geometry::DistanceField;
use lake::{ReadArtifact, ReadInputs, table};
use motion::{Motion, MotionError};
use nalgebra::Point3;
use schemas::{
    Table,
    distance_fields::{self, FieldInfo},
    objects::Surface,
    training::Split,
    trajectories::Trajectory,
};
use spatial::RestingPose;

use crate::{TrainConfig, TrainError};

/// Stream of the random numbers that say which motions are held out.
const HELD_OUT: u64 = 3;

/// Reads objects and trajectories, and puts every motion above the table of its scene.
///
/// # Errors
///
/// Fails if an artifact cannot be read, or a trajectory is of another hand or of no object.
pub fn read(inputs: &Inputs, joints: &[String]) -> Result<TrainingSet, BoxedDiagnostic> {
    let objects = inputs.all::<Surface>()?.into_iter();
    let known: BTreeMap<String, Surface> = objects
        .map(|object| (object.name.clone(), object))
        .collect();
    let mut set = TrainingSet {
        scenes: Vec::new(),
        tracks: Vec::new(),
        distances: BTreeMap::new(),
    };
    for artifact in inputs.artifacts(FieldInfo::NAME) {
        let field = artifact.parsed(distance_fields::FIELD, DistanceField::from_bytes)?;
        set.distances
            .insert(artifact.key.to_string(), Arc::new(field));
    }
    let mut scenes = BTreeMap::new();
    for artifact in inputs.artifacts(Trajectory::NAME) {
        let trajectory: Trajectory = table::read(artifact)?;
        let object = known.get(&trajectory.object).ok_or_else(|| {
            let known = known.keys().map(String::as_str);
            InputError::unknown(Surface::NAME, Surface::PARTITION, &trajectory.object, known)
        })?;
        let rests = object.rests.iter().map(|orientation| orientation.rest);
        let nearest = trajectory.rest.nearest(rests);
        let (idx, rest) = nearest.ok_or_else(|| TrainError::NoRests {
            object: object.name.clone(),
        })?;
        let scene = *scenes.entry((object.name.clone(), idx)).or_insert_with(|| {
            set.scenes.push(scene(object, rest));
            set.scenes.len() - 1
        });
        let motion = trajectory.motion.with_rates(|_| ());
        let motion = motion.map(|one| one.expressed_in(&rest.table_from_object()));
        set.tracks
            .push(track(&trajectory.sequence, scene, motion, joints)?);
    }
    Ok(set)
}

/// Marks the motions of unseen objects.
pub(crate) fn mark_unseen(set: &mut TrainingSet, config: &TrainConfig) {
    let objects = set.scenes.iter().map(|scene| scene.object.as_str());
    let unseen = config.unseen.of(&objects.collect());
    for track in &mut set.tracks {
        if unseen.contains(set.scenes[track.scene].object.as_str()) {
            track.split = Split::Unseen;
        }
    }
}

/// Holds out a share of the motions that are new, never the last one of an object. A motion that `continued` learned
/// from or held out stays so.
pub(crate) fn hold_out(
    set: &mut TrainingSet,
    continued: Option<&Description>,
    share: f64,
    seed: u64,
) {
    let known = continued.map_or(&[][..], |continued| &continued.demonstrations);
    let known: BTreeMap<&str, Split> = known
        .iter()
        .map(|motion| (motion.name.as_str(), motion.split))
        .collect();
    let mut new: Vec<usize> = Vec::new();
    let mut left: BTreeMap<String, usize> = BTreeMap::new();
    for (idx, track) in set.tracks.iter_mut().enumerate() {
        if track.split != Split::Training {
            continue;
        }
        match known.get(track.name.as_str()) {
            Some(Split::HeldOut) => {
                track.split = Split::HeldOut;
                continue;
            }
            Some(Split::Training) => {}
            Some(Split::Unseen) | None => new.push(idx),
        }
        let object = &set.scenes[track.scene].object;
        *left.entry(object.clone()).or_default() += 1;
    }
    let wanted = share * new.len() as f64;
    let mut held_out = 0.0;
    for k in Random::new(seed, HELD_OUT).permutation(new.len()) {
        let track = &mut set.tracks[new[k]];
        let left = left
            .entry(set.scenes[track.scene].object.clone())
            .or_default();
        // To the nearest whole number.
        if held_out + 0.5 <= wanted && *left > 1 {
            track.split = Split::HeldOut;
            *left -= 1;
            held_out += 1.0;
        }
    }
}

pub(crate) fn scene(object: &Surface, rest: RestingPose) -> RestingObject {
    RestingObject {
        object: object.name.clone(),
        rest,
        points_in_object: object
            .points_m
            .iter()
            .map(|&point| Point3::from(point))
            .collect(),
    }
}

/// Returns a motion above the table of its scene as one to learn from, unless it cannot be followed.
pub(crate) fn track(
    name: &str,
    scene: usize,
    motion: Result<Motion<spatial::Table, ()>, MotionError>,
    joints: &[String],
) -> Result<TrainingMotion, TrainError> {
    let motion = motion.and_then(|one| one.reordered(joints));
    let sequence = || name.to_owned();
    Ok(TrainingMotion {
        name: sequence(),
        scene,
        split: Split::Training,
        motion: motion.map_err(|source| match source {
            MotionError::Joints(source) => TrainError::HandMismatch {
                sequence: sequence(),
                source,
            },
            source => TrainError::Motion {
                sequence: sequence(),
                source,
            },
        })?,
        code: None,
    })
}
