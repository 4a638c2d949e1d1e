//! The stage: one unit that gathers all trajectories.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
    sync::Arc,
    time::Instant,
};

use cgf::{GraspError, Split, Trained, Trainer, TrainingSet};
use dataflow::{
    Code, Context, Form, Input, Inputs, Made, OptionFault, Outcome, Output, Scope, SourceFile,
    Stage, Unit,
};
use robot::RobotModel;
use schemas::checkpoint;

use crate::{
    TrainConfig, TrainError,
    resume::{self, Found, Saver},
    set,
};

/// Learns a continuous grasping function from trajectories.
pub enum Train {}

/// The hand counts as it is read.
const ROBOT: Form = Form {
    name: "robot",
    of: robot::read_form,
};
/// Key of the one partition.
const MODEL: &str = "cgf";
/// The artifact of the trained function.
pub const CHECKPOINT: &str = "checkpoint";

impl Stage for Train {
    type Config = TrainConfig;
    type Error = TrainError;

    const KIND: &'static str = "train";
    const ABOUT: &'static str = "Learns a continuous grasping function from robot trajectories";
    const CODE: Code = dataflow::code!();
    const INPUTS: &'static [Input] = &[
        Input {
            name: "trajectories",
            artifact: "trajectories",
        },
        Input {
            name: "objects",
            artifact: "objects",
        },
        Input {
            name: set::FIELDS,
            artifact: set::FIELDS,
        },
    ];
    const OUTPUTS: &'static [Output] = &[Output {
        artifact: CHECKPOINT,
        schema: checkpoint::VERSION,
        partition: "model",
        parallel: true,
    }];

    fn check(config: &TrainConfig) -> Vec<OptionFault> {
        config.faults()
    }

    /// Checks the hand's description.
    fn prepare(config: &TrainConfig) -> Result<(), TrainError> {
        read_hand(&config.hand).map(drop)
    }

    fn units(config: &TrainConfig, _output: &str, scope: &Scope) -> Result<Vec<Unit>, TrainError> {
        let known: Vec<String> = scope
            .partitions("objects")
            .iter()
            .map(|object| object.key.clone())
            .collect();
        for object in config.objects.iter().chain(&config.unseen_objects) {
            if !known.contains(object) {
                return Err(TrainError::UnknownObject {
                    object: object.clone(),
                    known,
                });
            }
        }
        let trajectories = scope.partitions("trajectories");
        let mut objects = BTreeSet::new();
        let mut keys = Vec::new();
        let mut learns = false;
        for trajectory in trajectories {
            let object = trajectory.label("object").unwrap_or_default();
            if config.takes(object) {
                objects.insert(object.to_owned());
                keys.push(trajectory.key.clone());
                learns |= !config.is_unseen(object);
            }
        }
        if !learns {
            return Err(TrainError::NoTrajectories {
                found: trajectories.len(),
            });
        }
        let keeps_out = config.training.penetration_weight > 0.0;
        let fields: BTreeSet<String> = objects.iter().filter(|_| keeps_out).cloned().collect();
        let unit = Unit::new(MODEL)
            .reading("trajectories", keys)
            .only_files("trajectories", [lake::table::FILE])
            .reading("objects", objects)
            .reading(set::FIELDS, fields)
            .with_file_of_form(SourceFile::named("hand", &config.hand), ROBOT);
        Ok(vec![
            robot_meshes::sources(&config.hand)?
                .into_iter()
                .fold(unit, Unit::with_file),
        ])
    }

    fn run(config: &TrainConfig, inputs: &Inputs, cx: &Context) -> Result<Outcome, TrainError> {
        let hand = Arc::new(hand(config, inputs)?);
        let set = set::read(config, inputs, &hand.joint_names(), cx.seed())?;
        let trained = train(config, &set, &hand, cx)?;
        for (cgf, files) in [
            (&trained.best, checkpoint::BEST),
            (&trained.last, checkpoint::LAST),
        ] {
            let file = |name| cx.folder().join(name);
            cgf.save(&file(files.weights), &file(files.description))?;
        }
        Ok(Outcome::Made(Made {
            labels: BTreeMap::new(),
            metrics: metrics(&trained),
        }))
    }
}

/// Reads the hand that a unit was given.
///
/// # Errors
///
/// Fails if its description or a mesh of it cannot be read.
pub fn hand(config: &TrainConfig, inputs: &Inputs) -> Result<RobotModel, TrainError> {
    let given = inputs.files().first();
    read_hand(given.map_or(&config.hand, |file| &file.path))
}

fn read_hand(path: &Path) -> Result<RobotModel, TrainError> {
    let text = fs::read_to_string(path).map_err(|source| TrainError::Hand {
        path: path.to_owned(),
        source,
    })?;
    let model = RobotModel::from_urdf(&text).map_err(|source| TrainError::Urdf {
        path: path.to_owned(),
        source,
    })?;
    Ok(robot_meshes::with_mesh_shapes(model, path)?)
}

/// Trains epoch after epoch.
fn train(
    config: &TrainConfig,
    set: &TrainingSet,
    hand: &Arc<RobotModel>,
    cx: &Context,
) -> Result<Trained, TrainError> {
    let epochs = config.training.epochs;
    let (network, training) = (&config.network, &config.training);
    let mut trainer = Trainer::new(set, hand, network, training, cx.seed())?;
    let (mut saver, found) = Saver::resume(cx, &mut trainer)?;
    let resumed = trainer.curve().len();
    let share = |done: usize| done as f64 / epochs as f64;
    match found {
        Found::Nothing => {}
        Found::Epochs(done) => cx.progress(share(done), &format!("goes on after epoch {done}")),
        Found::Damaged(why) => cx.progress(
            0.0,
            &format!("starts anew, the state left is of no use: {why}"),
        ),
    }
    let started = Instant::now();
    while !trainer.is_done() {
        let epoch = *trainer.train_epoch()?;
        saver.note(&trainer)?;
        let done = epoch.epoch;
        let left = resume::time_left(started, done - resumed, epochs - done);
        let mut message = format!("epoch {done} of {epochs}, loss {:.4}", epoch.training.total);
        if let Some(held_out) = epoch.held_out {
            message += &format!(", held out {:.4}", held_out.total);
        }
        cx.progress(share(done), &format!("{message}, {left}"));
    }
    Ok(trainer.finish()?)
}

/// Losses of the last epoch and mean errors at the grasp of the motions that the mean codes give.
fn metrics(trained: &Trained) -> BTreeMap<String, f64> {
    let description = trained.last.description();
    let of_split = |split: Split| {
        let demonstrations = description.demonstrations.iter();
        demonstrations.filter(move |demonstration| demonstration.split == split)
    };
    let mut metrics = BTreeMap::from([("epochs".to_owned(), description.training.epochs as f64)]);
    let mut put = |name: &str, suffix: &str, value: f64| {
        metrics.insert(format!("{name}{suffix}"), value);
    };
    put("best_epoch", "", trained.best.description().epoch as f64);
    if let Some(epoch) = description.epoch.checked_sub(1) {
        let epoch = &description.training_curve[epoch];
        put("loss", "", f64::from(epoch.training.total));
        put("kl", "", f64::from(epoch.training.kl));
        for (suffix, losses) in [("_held_out", epoch.held_out), ("_unseen", epoch.unseen)] {
            if let Some(losses) = losses {
                put("loss", suffix, f64::from(losses.total));
            }
        }
    }
    for (split, suffix) in [
        (Split::Training, ""),
        (Split::HeldOut, "_held_out"),
        (Split::Unseen, "_unseen"),
    ] {
        let n = of_split(split).count();
        put("trajectories", suffix, n as f64);
        if n == 0 {
            continue;
        }
        let mean = |error: fn(&GraspError) -> f64| {
            of_split(split).map(|d| error(&d.grasp_error)).sum::<f64>() / n as f64
        };
        put("position_error_m", suffix, mean(|error| error.position_m));
        put(
            "rotation_error_rad",
            suffix,
            mean(|error| error.rotation_rad),
        );
        put("joints_error_rad", suffix, mean(|error| error.joints_rad));
    }
    metrics
}
