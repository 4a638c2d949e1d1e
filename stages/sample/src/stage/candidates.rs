//! The motions of one object.

use std::collections::BTreeMap;

use cgf::Cgf;
use dataflow::{Artifact, Context, Inputs, Made, Outcome, Scope, Unit};
use schemas::{
    candidates::{self, Candidate, Candidates},
    checkpoint, objects,
};

use super::{columns, hand_file, labels, only, read_hand, schema};
use crate::{Epoch, SampleConfig, SampleError, motions::sample, recording};

/// One unit per object.
pub(super) fn units(config: &SampleConfig, scope: &Scope) -> Result<Vec<Unit>, SampleError> {
    let objects = scope.partitions("objects");
    for object in &config.objects {
        if !objects.iter().any(|known| known.key == *object) {
            return Err(SampleError::UnknownObject {
                object: object.clone(),
                known: objects.iter().map(|known| known.key.clone()).collect(),
            });
        }
    }
    let checkpoint = scope
        .partitions("checkpoint")
        .iter()
        .map(|model| &model.key);
    let units = objects
        .iter()
        .map(|object| &object.key)
        .filter(|object| config.objects.is_empty() || config.objects.contains(object))
        .map(|object| {
            let unit = Unit::new(object.as_str())
                .reading("checkpoint", checkpoint.clone().map(String::as_str))
                .reading("objects", [object.as_str()]);
            if config.recorded_per_object > 0 {
                unit.with_file(hand_file(config))
            } else {
                unit
            }
        });
    Ok(units.collect())
}

/// Draws the motions of one object.
pub(super) fn make(
    config: &SampleConfig,
    inputs: &Inputs,
    cx: &Context,
) -> Result<Outcome, SampleError> {
    let cgf = read_checkpoint(config.epoch, only(inputs, "checkpoint", "checkpoint")?)?;
    let artifact = only(inputs, "objects", "object")?;
    let batch = lake::table::read(artifact)?;
    let object = objects::from_batch(&artifact.key, &batch).map_err(schema(&artifact.key))?;
    let drawn = Candidates {
        object: object.name.clone(),
        joints: cgf.description().joints.clone(),
        candidates: sample(config, &cgf, &object, cx.seed())?,
    };
    let batch = candidates::to_batch(&drawn).map_err(schema(&artifact.key))?;
    lake::table::write(cx.folder(), &batch)?;
    if let Some(file) = inputs.files().first() {
        let (urdf, model) = read_hand(&file.path)?;
        let numbers = recording::chosen(config.recorded_per_object, drawn.candidates.len());
        let motions: Vec<&Candidate> = numbers
            .into_iter()
            .filter_map(|number| drawn.candidates.get(number))
            .collect();
        let stage = recording::Stage {
            urdf: &urdf,
            model: &model,
            object: &object,
            columns: &columns(&model, &drawn.joints, "grasping function")?,
        };
        recording::record(&stage, &motions, cx.folder())?;
    }
    let n = drawn.candidates.len() as f64;
    Ok(Outcome::Made(Made {
        labels: labels(&object.name),
        metrics: BTreeMap::from([("candidates".to_owned(), n)]),
    }))
}

fn read_checkpoint(epoch: Epoch, artifact: &Artifact) -> Result<Cgf, SampleError> {
    let file = |name| {
        let file = artifact.file(name);
        file.ok_or(SampleError::Missing { what: "checkpoint" })
    };
    let files = match epoch {
        Epoch::Best => checkpoint::BEST,
        Epoch::Last => checkpoint::LAST,
    };
    Ok(Cgf::load(file(files.weights)?, file(files.description)?)?)
}
