//! The motions of one object.

use cgf::Cgf;
use dataflow::{Artifact, BoxedDiagnostic, Context, Inputs, Outcome, Partition, Scope, Unit};
use geometry::DistanceField;
use lake::{ReadArtifact, WriteArtifact};
use robot::{JointOrder, RobotModel};
use robot_meshes::LoadedRobot;
use sampling::{CollisionModel, PenetrationProbe, Redraws, SamplingTask};
use schemas::{
    Table,
    candidates::{Candidate, Candidates},
    checkpoint,
    distance_fields::{self, FieldInfo},
    draws::Draws,
    objects::Object,
};

use super::SampleMetrics;
use crate::{
    CheckpointWeights, SampleConfig, SampleError, SeenShape,
    inputs::{hand_file, joint_order},
    recording,
    rows::{draws_of, sampled_object},
};

lake::inputs! {
    /// What a unit reads: the checkpoint and an object; with `shape = "other"` the next object, with `draws` above 1
    /// the distances and the hand.
    pub struct SampleInputs {
        /// The object.
        each object: Object;
        /// The next object, if the function is shown that one's shape.
        others others: Object;
        /// The checkpoint.
        the checkpoint: Artifact = (checkpoint::NAME), |checkpoint| Ok(checkpoint.clone());
        /// The distances from the object; without them motions are not drawn again.
        maybe field: DistanceField = FieldInfo,
            |field| field.parsed(distance_fields::FIELD, DistanceField::from_bytes);
    }
    files {
        /// The hand, if it is measured or shown.
        hand: Option<LoadedRobot> = |inputs: &Inputs| {
            let file = inputs.files().first();
            file.map(|file| robot_meshes::load(&file.path)).transpose()
        };
    }
}

/// One unit per object.
pub(super) fn units(config: &SampleConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
    let objects = scope.partitions(Object::NAME);
    let form = if config.recorded_per_object > 0 {
        Some(robot_meshes::URDF_FORM)
    } else {
        config.redraws().then_some(robot_meshes::MODEL_FORM)
    };
    let meshes = match form {
        Some(_) => robot_meshes::sources(&config.hand)?,
        None => Vec::new(),
    };
    let units = SampleInputs::units(scope, &config.objects)?.into_iter();
    let units = units.map(|mut unit| {
        if config.shape == SeenShape::Other {
            let next = next(objects, &unit.partition);
            unit = unit.reading(Object::NAME, next);
        }
        if config.redraws() {
            // An object without a field is planned without, and not chosen for.
            unit = unit.reading_own(FieldInfo::NAME, scope);
        }
        if let Some(form) = form {
            unit = unit.with_file_of_form(hand_file(config), form);
        }
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
    inputs: SampleInputs,
    cx: &Context,
) -> Result<Outcome<SampleMetrics>, BoxedDiagnostic> {
    let SampleInputs {
        object,
        others,
        checkpoint,
        field,
        hand,
    } = inputs;
    let cgf = read_checkpoint(config.epoch, &checkpoint)?;
    let shown = match config.shape {
        SeenShape::Own => None,
        SeenShape::Other => Some(shown(&object, &others)?),
    };
    let order = hand.as_ref().map(|hand| order(&hand.model, &cgf));
    let order = order.transpose()?;
    let drawing = Drawing {
        config,
        cgf: &cgf,
        object: &object,
        shown,
        field: field.as_ref(),
        hand: hand.as_ref().map(|hand| &hand.model),
        is_canceled: &|| false,
    };
    let (drawn, every_draw) = drawing.draw(cx.seed())?;
    cx.write(&drawn)?;
    cx.write(&every_draw)?;
    if config.recorded_per_object > 0
        && let Some(hand) = &hand
        && let Some(order) = &order
    {
        let context = recording::RecordingContext {
            urdf: &robot::plain_urdf(&hand.urdf),
            model: &hand.model,
            object: &object,
            order,
        };
        let motions = recorded(&drawn.candidates, config.recorded_per_object);
        recording::record(&context, &motions, cx.folder())?;
    }
    let metrics = SampleMetrics {
        candidates: drawn.candidates.len() as f64,
        draws: every_draw.len() as f64,
    };
    Ok(Outcome::Made(metrics))
}

/// What the motions of one object are drawn with.
pub struct Drawing<'a> {
    /// The options.
    pub config: &'a SampleConfig,
    /// The function.
    pub cgf: &'a Cgf,
    /// The object.
    pub object: &'a Object,
    /// The object whose shape the function sees instead.
    pub shown: Option<&'a Object>,
    /// The distances from the object, if motions are to be drawn again.
    pub field: Option<&'a DistanceField>,
    /// The hand, if motions are to be drawn again.
    pub hand: Option<&'a RobotModel>,
    /// Whether the rest of the motions is to be left.
    pub is_canceled: &'a (dyn Fn() -> bool + Sync),
}

impl Drawing<'_> {
    /// Draws the motions, and returns all draws of them too.
    ///
    /// # Errors
    ///
    /// Fails if the hand is not the function's, and as [`sampling::sample`] does.
    pub fn draw(&self, seed: u64) -> Result<(Candidates, Draws), SampleError> {
        let order = self.hand.map(|hand| order(hand, self.cgf)).transpose()?;
        let collision_model = self.hand.map(CollisionModel::new).transpose()?;
        let measured = collision_model.as_ref().zip(order.as_ref()).zip(self.field);
        let measured = measured.filter(|_| self.config.redraws());
        let redraws = measured.map(|((collision_model, order), field)| Redraws {
            probe: PenetrationProbe {
                collision_model,
                field,
                order,
            },
            max_draws: self.config.draws,
            max_depth_m: self.config.max_depth_m,
        });
        let sampled = sampling::sample(&SamplingTask {
            options: &self.config.sampling(),
            cgf: self.cgf,
            object: sampled_object(self.object),
            shown: self.shown.map(sampled_object),
            redraws,
            seed,
            is_canceled: self.is_canceled,
        })?;
        let (candidates, every_draw) = draws_of(&self.object.name, sampled);
        let drawn = Candidates {
            object: self.object.name.clone(),
            joints: self.cgf.description().joints.as_slice().into(),
            candidates,
        };
        Ok((drawn, every_draw))
    }
}

/// Returns how the function's joints are put into the order of the hand's.
fn order(hand: &RobotModel, cgf: &Cgf) -> Result<JointOrder, SampleError> {
    joint_order(hand, &cgf.description().joints, "grasping function")
}

/// Returns the other object whose shape the function is shown.
fn shown<'a>(object: &Object, others: &'a [Object]) -> Result<&'a Object, SampleError> {
    let other = others.first();
    other.ok_or_else(|| SampleError::NoOther(object.name.clone()))
}

/// Returns the motions that are recorded.
fn recorded(candidates: &[Candidate], n: usize) -> Vec<&Candidate> {
    let numbers = recording::chosen(n, candidates.len()).into_iter();
    numbers
        .filter_map(|number| candidates.get(number))
        .collect()
}

fn read_checkpoint(epoch: CheckpointWeights, artifact: &Artifact) -> Result<Cgf, BoxedDiagnostic> {
    let files = match epoch {
        CheckpointWeights::Best => checkpoint::BEST,
        CheckpointWeights::Last => checkpoint::LAST,
    };
    let weights = artifact.path(files.weights)?;
    Ok(Cgf::load(weights, artifact.path(files.description)?).map_err(SampleError::from)?)
}
