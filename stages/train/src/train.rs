//! The stage: one unit that gathers all trajectories.

use std::{collections::BTreeSet, sync::Arc, time::Instant};

use cgf::{Cgf, CgfError, HandDistance, Trainer, TrainingDevice, TrainingResult, TrainingSet};
use dataflow::{
    BoxedDiagnostic, Context, Inputs, Max, Mean, Outcome, Output, Outputs, Scope, SourceFile,
    Stage, Sum, Unit,
};
use lake::{ReadArtifact, ReadInputs};
use robot::RobotModel;
use schemas::{
    Table, candidates::Candidates, checkpoint, demonstrations::TERMS, distance_fields::FieldInfo,
    objects::Surface, rollouts::Rollouts, training::Split, trajectories::Trajectory,
};

use crate::{
    BySplit, TrainConfig, TrainError, accepted,
    resume::{self, SavedTraining, Saver},
    training_set,
};

/// Learns a continuous grasping function from trajectories.
pub struct Train;

dataflow::metrics! {
    /// Metrics of a trained function.
    pub struct TrainMetrics {
        /// Number of epochs.
        epochs: Max,
        /// The epoch of the best function.
        best_epoch: Max,
        /// Weighted loss of the last epoch, of each set of motions in which it was measured.
        loss: BySplit<Mean>,
        /// Divergence of the latent codes in the last epoch, in nats.
        kl: Option<Mean>,
        /// Number of motions in each set.
        trajectories: BySplit<Sum>,
        /// Number of accepted motions among those learned from.
        accepted: Option<Sum>,
        /// Mean error of the palm's position at the grasp that the mean codes of encoded motions give, in meters.
        position_error_m: BySplit<Mean>,
        /// Mean error of the palm's rotation there, in radians.
        rotation_error_rad: BySplit<Mean>,
        /// Mean error of the joints there, in radians (meters if prismatic).
        joints_error_rad: BySplit<Mean>,
    }
}

/// Key of the one partition.
const MODEL: &str = "cgf";
/// Source of motions whose dataset has no `TERMS.txt`.
const UNSTATED: &str = "source and terms not stated";

impl Stage for Train {
    type Config = TrainConfig;

    const KIND: &'static str = "train";
    const ABOUT: &'static str = "Learns a continuous grasping function from robot trajectories";
    const INPUTS: &'static [&'static str] = &[Trajectory::NAME, Surface::NAME, FieldInfo::NAME];
    const OPTIONAL_INPUTS: &'static [&'static str] =
        &[Candidates::NAME, Rollouts::NAME, checkpoint::NAME];
    const OUTPUTS: Outputs<Self> = &[&Self];

    /// Checks the hand's description, that it has the links that are named as tips, and that this program can
    /// compute on the device.
    fn prepare(config: &TrainConfig) -> Result<(), BoxedDiagnostic> {
        let hand = robot_meshes::load(&config.hand)?.model;
        let mut tips = config.training.tips.iter();
        if let Some(link) = tips.find(|tip| hand.link(tip).is_none()) {
            return Err(TrainError::from(CgfError::UnknownLink { link: link.clone() }).into());
        }
        let lacking = match config.training.device {
            TrainingDevice::Cuda if !cfg!(feature = "cuda") => Some("cuda"),
            TrainingDevice::Metal if !cfg!(feature = "metal") => Some("metal"),
            TrainingDevice::Cpu | TrainingDevice::Cuda | TrainingDevice::Metal => None,
        };
        match lacking {
            Some(feature) => Err(TrainError::from(CgfError::NotBuiltFor { feature }).into()),
            None => Ok(()),
        }
    }
}

impl Output for Train {
    type Stage = Self;
    type Metrics = TrainMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = checkpoint::NAME;
    const SCHEMA: &'static str = checkpoint::VERSION;
    const PARTITION: &'static str = checkpoint::PARTITION;

    fn units(config: &TrainConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let unit = training_unit(config, scope)?;
        let continued = scope.partitions(checkpoint::NAME).iter();
        let continued: Vec<_> = continued.map(|partition| &partition.key).collect();
        if continued.is_empty() {
            return Ok(vec![unit]);
        }
        let files = [checkpoint::LAST.weights, checkpoint::LAST.description];
        Ok(vec![
            unit.reading(checkpoint::NAME, continued)
                .only_files(checkpoint::NAME, files),
        ])
    }

    fn make(
        config: &TrainConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<TrainMetrics>, BoxedDiagnostic> {
        let hand = Arc::new(hand(inputs)?);
        let mut set = training_set::read(inputs, &hand.joint_names())?;
        training_set::mark_unseen(&mut set, config);
        let continued = continued(inputs, &set)?;
        let before = continued.as_ref().map(Cgf::description);
        training_set::hold_out(&mut set, before, config.held_out_share, cx.seed());
        let accepted = accepted::read(
            inputs,
            &mut set,
            &hand.joint_names(),
            config.accepted_per_object,
            continued.is_some(),
        )?;
        let accepted_n = accepted.len();
        set.tracks.extend(accepted);
        let mut trained = train(config, &set, &hand, continued.as_ref(), cx)?;
        let terms = inputs.fact(TERMS).unwrap_or_default();
        for (cgf, files) in [
            (&mut trained.best, checkpoint::BEST),
            (&mut trained.last, checkpoint::LAST),
        ] {
            cgf.set_data(terms.lines().map(str::to_owned).collect());
            let file = |name| cx.folder().join(name);
            cgf.save(&file(files.weights), &file(files.description))
                .map_err(TrainError::from)?;
        }
        Ok(Outcome::Made(TrainMetrics {
            accepted: (accepted_n > 0).then_some(accepted_n as f64),
            ..TrainMetrics::of(&trained, &set)
        }))
    }
}

/// Returns a unit that reads the hand, and everything that is learned from.
///
/// # Errors
///
/// Fails if the options do not fit the inputs, or if something would be learned of an unseen object.
pub(crate) fn training_unit(config: &TrainConfig, scope: &Scope) -> Result<Unit, BoxedDiagnostic> {
    for names in [&config.objects, &config.unseen.unseen_objects] {
        scope.chosen(Surface::NAME, Surface::PARTITION, names)?;
    }
    let trajectories = scope.partitions(Trajectory::NAME);
    let mut objects = BTreeSet::new();
    let mut keys = Vec::new();
    let mut terms = BTreeSet::new();
    for trajectory in trajectories {
        let object = trajectory
            .label("object")
            .ok_or_else(|| TrainError::NoObject {
                sequence: trajectory.key.to_string(),
            })?;
        if config.takes(object) {
            objects.insert(object);
            keys.push(&trajectory.key);
            terms.insert(trajectory.label(TERMS).unwrap_or(UNSTATED));
        }
    }
    let of_fold = config
        .unseen
        .unseen_fold
        .map(|fold| (fold, fold.of(&objects)));
    if let Some((fold, _)) = of_fold.filter(|(_, objects)| objects.is_empty()) {
        return Err(TrainError::EmptyFold {
            fold,
            objects_n: objects.len(),
        }
        .into());
    }
    let unseen = config.unseen.of(&objects);
    if unseen.len() == objects.len() {
        return Err(TrainError::NoTrajectories {
            found: trajectories.len(),
        }
        .into());
    }
    let shapes = accepted::shapes(scope, &unseen)?;
    let accepted = accepted::partitions(scope, |object| {
        objects.contains(object) && !unseen.contains(object) || shapes.contains(object)
    })?;
    objects.extend(accepted.iter().copied());
    let keeps_out = config.training.penetration_weight > 0.0;
    let fields: Vec<&str> = objects.iter().copied().filter(|_| keeps_out).collect();
    let unit = Unit::new(MODEL)
        .with_fact(TERMS, Vec::from_iter(terms).join("\n"))
        .reading(Trajectory::NAME, keys)
        .only_files(Trajectory::NAME, [lake::table::FILE])
        .reading(Surface::NAME, objects)
        .only_files(Surface::NAME, [Surface::FILE])
        .reading(FieldInfo::NAME, fields)
        .with_file_of_form(
            SourceFile::named("hand", &config.hand),
            robot_meshes::MODEL_FORM,
        );
    let unit = if accepted.is_empty() {
        unit
    } else {
        unit.reading(Candidates::NAME, accepted.iter().copied())
            .reading(Rollouts::NAME, accepted)
    };
    let meshes = robot_meshes::sources(&config.hand)?.into_iter();
    Ok(meshes.fold(unit, Unit::with_file))
}

/// Reads the hand that a unit was given.
///
/// # Errors
///
/// Fails if its description or a mesh of it cannot be read.
pub fn hand(inputs: &Inputs) -> Result<RobotModel, BoxedDiagnostic> {
    Ok(robot_meshes::load(&inputs.source("hand")?.path)?.model)
}

/// Reads the function from which the training goes on, if one is wired.
///
/// # Errors
///
/// Fails if it cannot be read, or if it has learned from an object that is unseen here.
fn continued(inputs: &Inputs, set: &TrainingSet) -> Result<Option<Cgf>, BoxedDiagnostic> {
    let Some(artifact) = inputs.artifacts(checkpoint::NAME).first() else {
        return Ok(None);
    };
    let weights = artifact.path(checkpoint::LAST.weights)?;
    let description = artifact.path(checkpoint::LAST.description)?;
    let cgf = Cgf::load(weights, description).map_err(TrainError::from)?;
    let unseen = set.tracks.iter();
    let unseen = unseen.filter(|track| track.split == Split::Unseen);
    let unseen: BTreeSet<&str> = unseen
        .map(|track| set.scenes[track.scene].object.as_str())
        .collect();
    let known = &cgf.description().objects;
    let leaked = known.iter().find(|object| unseen.contains(object.as_str()));
    match leaked.cloned() {
        Some(object) => Err(TrainError::LearnedUnseen { object }.into()),
        None => Ok(Some(cgf)),
    }
}

/// Trains epoch after epoch.
fn train(
    config: &TrainConfig,
    set: &TrainingSet,
    hand: &Arc<RobotModel>,
    continued: Option<&Cgf>,
    cx: &Context,
) -> Result<TrainingResult, BoxedDiagnostic> {
    let epochs = config.training.epochs;
    let (network, training) = (&config.network, &config.training);
    let mut trainer =
        Trainer::new(set, hand, network, training, cx.seed()).map_err(TrainError::from)?;
    if let Some(cgf) = continued {
        trainer.continue_from(cgf).map_err(TrainError::from)?;
    }
    let (mut saver, found) = Saver::resume(cx, &mut trainer)?;
    let resumed = trainer.curve().len();
    let share = |done: usize| done as f64 / epochs as f64;
    match found {
        SavedTraining::Nothing => {}
        SavedTraining::Epochs(done) => {
            cx.progress(share(done), &format!("goes on after epoch {done}"));
        }
        SavedTraining::Damaged(why) => {
            cx.progress(0.0, &format!("restarting: saved state is unusable: {why}"));
        }
    }
    let started = Instant::now();
    while !trainer.is_done() {
        let epoch = *trainer.train_epoch().map_err(TrainError::from)?;
        saver.note(&trainer)?;
        let done = epoch.epoch;
        let left = resume::time_left(started, done - resumed, epochs - done);
        let mut message = format!("epoch {done} of {epochs}, loss {:.4}", epoch.training.total);
        if let Some(held_out) = epoch.held_out {
            message += &format!(", held out {:.4}", held_out.total);
        }
        cx.progress(share(done), &format!("{message}, {left}"));
    }
    Ok(trainer.finish().map_err(TrainError::from)?)
}

impl TrainMetrics {
    fn of(trained: &TrainingResult, set: &TrainingSet) -> Self {
        let description = trained.last.description();
        let mean = |error: fn(&HandDistance) -> f64| {
            BySplit::of(|split| {
                let n = description.of_split(split).count();
                let errors = description
                    .of_split(split)
                    .map(|motion| error(&motion.grasp_error));
                (n > 0).then(|| errors.sum::<f64>() / n as f64)
            })
        };
        let last = description.epoch.checked_sub(1);
        let last = last.map(|epoch| &description.training_curve[epoch]);
        Self {
            epochs: description.training.epochs as f64,
            best_epoch: trained.best.description().epoch as f64,
            loss: BySplit::of(|split| Some(last?.losses(split)?.total.into())),
            kl: last.map(|last| f64::from(last.training.kl)),
            trajectories: BySplit::of(|split| {
                let of_split = set.tracks.iter().filter(|track| track.split == split);
                Some(of_split.count() as f64)
            }),
            accepted: None,
            position_error_m: mean(|error| error.position_m),
            rotation_error_rad: mean(|error| error.rotation_rad),
            joints_error_rad: mean(|error| error.joints_rad),
        }
    }
}
