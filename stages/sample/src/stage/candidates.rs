//! The motions of one object.

use cgf::Cgf;
use dataflow::{
    Artifact, BoxedDiagnostic, Context, InputError, Inputs, Outcome, Partition, Scope, Unit,
};
use geometry::DistanceField;
use lake::{ReadArtifact, ReadInputs, WriteArtifact};
use sampling::{CollisionModel, PenetrationProbe, Redraws, SamplingTask};
use schemas::{
    Table,
    candidates::{Candidate, Candidates},
    checkpoint,
    distance_fields::{self, FieldInfo},
    objects::Object,
};

use super::SampleMetrics;
use crate::{
    CheckpointWeights, SampleConfig, SampleError, SeenShape,
    inputs::{hand_file, order},
    recording,
    rows::{draws_of, sampled_object},
};

/// One unit per object.
pub(super) fn units(config: &SampleConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
    let objects = scope.partitions(Object::NAME);
    let chosen = scope.chosen(Object::NAME, Object::PARTITION, &config.objects)?;
    let checkpoint = scope
        .partitions(checkpoint::NAME)
        .iter()
        .map(|model| &model.key);
    let reads_hand = config.redraws() || config.recorded_per_object > 0;
    let meshes = if reads_hand {
        robot_meshes::sources(&config.hand)?
    } else {
        Vec::new()
    };
    let units = chosen
        .into_iter()
        .map(|object| object.key.as_str())
        .map(|object| {
            let unit = Unit::new(object)
                .with_label("object", object)
                .reading(checkpoint::NAME, checkpoint.clone())
                .reading(Object::NAME, [object]);
            let unit = match config.shape {
                SeenShape::Own => unit,
                SeenShape::Other => unit.reading(Object::NAME, next(objects, object)),
            };
            let unit = if config.redraws() {
                // An object without a field is planned without, and not chosen for.
                unit.reading_own(FieldInfo::NAME, scope)
            } else {
                unit
            };
            let form = if config.recorded_per_object > 0 {
                robot_meshes::URDF_FORM
            } else if config.redraws() {
                robot_meshes::MODEL_FORM
            } else {
                return unit;
            };
            let unit = unit.with_file_of_form(hand_file(config), form);
            meshes.iter().cloned().fold(unit, Unit::with_file)
        });
    Ok(units.collect())
}

/// Returns the object after this one by name, the first after the last.
fn next<'a>(objects: &'a [Partition], object: &str) -> Option<&'a str> {
    let mut names: Vec<&str> = objects.iter().map(|known| known.key.as_str()).collect();
    names.sort_unstable();
    let after = names.iter().find(|name| **name > object);
    after
        .or(names.first())
        .copied()
        .filter(|name| *name != object)
}

/// Draws the motions of one object.
pub(super) fn make(
    config: &SampleConfig,
    inputs: &Inputs,
    cx: &Context,
) -> Result<Outcome<SampleMetrics>, BoxedDiagnostic> {
    let cgf = read_checkpoint(config.epoch, inputs.artifact(checkpoint::NAME)?)?;
    let seen: Vec<Object> = inputs.all()?;
    let (object, other) = shown_objects(config.shape, &seen, cx.partition().as_str())?;
    let hand = inputs.files().first();
    let hand = hand
        .map(|file| robot_meshes::load(&file.path))
        .transpose()?;
    let order = hand.as_ref().map(|hand| {
        let joints = &cgf.description().joints;
        order(&hand.model, joints, "grasping function")
    });
    let order = order.transpose()?;
    let field = inputs.artifacts(FieldInfo::NAME).first();
    let field = field.map(|field| field.parsed(distance_fields::FIELD, DistanceField::from_bytes));
    let field = field.transpose()?;
    let collision_model = hand
        .as_ref()
        .map(|hand| CollisionModel::new(&hand.model))
        .transpose()
        .map_err(SampleError::from)?;
    let hand_and_field = collision_model
        .as_ref()
        .zip(order.as_ref())
        .zip(field.as_ref());
    let redraws = hand_and_field.filter(|_| config.redraws());
    let redraws = redraws.map(|((collision_model, order), field)| Redraws {
        probe: PenetrationProbe {
            collision_model,
            field,
            order,
        },
        max_draws: config.draws,
        max_depth_m: config.max_depth_m,
    });
    let sampled = sampling::sample(&SamplingTask {
        options: &config.sampling(),
        cgf: &cgf,
        object: sampled_object(object),
        shown: other.map(sampled_object),
        redraws,
        seed: cx.seed(),
    });
    let (candidates, every_draw) = draws_of(&object.name, sampled.map_err(SampleError::from)?);
    let drawn = Candidates {
        object: object.name.clone(),
        joints: cgf.description().joints.as_slice().into(),
        candidates,
    };
    cx.write(&drawn)?;
    cx.write(&every_draw)?;
    if config.recorded_per_object > 0
        && let Some(hand) = &hand
        && let Some(order) = &order
    {
        let numbers = recording::chosen(config.recorded_per_object, drawn.candidates.len());
        let motions: Vec<&Candidate> = numbers
            .into_iter()
            .filter_map(|number| drawn.candidates.get(number))
            .collect();
        let context = recording::RecordingContext {
            urdf: &robot::plain_urdf(&hand.urdf),
            model: &hand.model,
            object,
            order,
        };
        recording::record(&context, &motions, cx.folder())?;
    }
    let metrics = SampleMetrics {
        candidates: drawn.candidates.len() as f64,
        draws: every_draw.len() as f64,
    };
    Ok(Outcome::Made(metrics))
}

/// Returns the object of a unit, and another one if the function is shown that one's shape.
fn shown_objects<'a>(
    shape: SeenShape,
    seen: &'a [Object],
    name: &str,
) -> Result<(&'a Object, Option<&'a Object>), BoxedDiagnostic> {
    let (own, others): (Vec<&Object>, Vec<&Object>) = seen
        .iter()
        .partition(|object| seen.len() == 1 || object.name == name);
    let object = own.first().copied().ok_or_else(|| {
        let known = seen.iter().map(|object| object.name.as_str());
        InputError::unknown(Object::NAME, Object::PARTITION, name, known)
    })?;
    let other = match shape {
        SeenShape::Own => None,
        SeenShape::Other => {
            let other = others.first().copied();
            Some(other.ok_or_else(|| SampleError::NoOther(object.name.clone()))?)
        }
    };
    Ok((object, other))
}

fn read_checkpoint(epoch: CheckpointWeights, artifact: &Artifact) -> Result<Cgf, BoxedDiagnostic> {
    let files = match epoch {
        CheckpointWeights::Best => checkpoint::BEST,
        CheckpointWeights::Last => checkpoint::LAST,
    };
    let weights = artifact.path(files.weights)?;
    Ok(Cgf::load(weights, artifact.path(files.description)?).map_err(SampleError::from)?)
}
