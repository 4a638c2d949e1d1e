//! The stage: one unit that gathers all trajectories.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
    sync::Arc,
};

use cgf::Cgf;
use dataflow::{
    Code, Context, Input, Inputs, Made, Outcome, Output, Scope, SourceFile, Stage, Summary, Unit,
};
use robot::RobotModel;
use schemas::checkpoint;

use crate::{TrainConfig, TrainError, set};

/// Learns a continuous grasping function from trajectories.
pub enum Train {}

/// Key of the one partition.
const MODEL: &str = "cgf";

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
    ];
    const OUTPUTS: &'static [Output] = &[Output {
        artifact: "checkpoint",
        schema: checkpoint::VERSION,
        partition: "model",
        parallel: true,
    }];

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
        for object in config.objects.iter().chain(&config.held_out_objects) {
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
        for trajectory in trajectories {
            let object = trajectory.label("object").unwrap_or_default();
            if config.takes(object) {
                objects.insert(object.to_owned());
                keys.push(trajectory.key.clone());
            }
        }
        if keys.is_empty() {
            return Err(TrainError::NoTrajectories {
                found: trajectories.len(),
            });
        }
        let unit = Unit::new(MODEL)
            .reading("trajectories", keys)
            .reading("objects", objects)
            .with_file(SourceFile::named_by_file(&config.hand));
        Ok(vec![unit])
    }

    fn run(config: &TrainConfig, inputs: &Inputs, cx: &Context) -> Result<Outcome, TrainError> {
        let path = inputs
            .files()
            .first()
            .map_or(config.hand.as_path(), |file| file.path.as_path());
        let hand = Arc::new(read_hand(path)?);
        let set = set::read(
            inputs.artifacts("objects"),
            inputs.artifacts("trajectories"),
            &hand.joint_names(),
        )?;
        let epochs = config.training.epochs;
        let cgf = cgf::train(
            &set,
            &hand,
            &config.network,
            &config.training,
            cx.seed(),
            |epoch, losses| {
                let message = format!(
                    "epoch {epoch} of {epochs}, loss {:.4}, kl {:.2}",
                    losses.total, losses.kl
                );
                cx.progress(epoch as f64 / epochs as f64, &message);
            },
        )?;
        cgf.save(
            &cx.folder().join(checkpoint::WEIGHTS),
            &cx.folder().join(checkpoint::DESCRIPTION),
        )?;
        Ok(Outcome::Made(Made {
            labels: BTreeMap::new(),
            metrics: metrics(&cgf),
        }))
    }

    fn describe(_output: &str, summary: &Summary) -> String {
        format!(
            "{} trajectories → loss {:.4}, kl {:.1}; grasps {:.1} mm, {:.1}° and {:.2} rad from theirs",
            summary.total("trajectories"),
            summary.total("loss"),
            summary.total("kl"),
            1e3 * summary.total("position_error_m"),
            summary.total("rotation_error_rad").to_degrees(),
            summary.total("joints_error_rad"),
        )
    }
}

fn read_hand(path: &Path) -> Result<RobotModel, TrainError> {
    let text = fs::read_to_string(path).map_err(|source| TrainError::Hand {
        path: path.to_owned(),
        source,
    })?;
    RobotModel::from_urdf(&text).map_err(|source| TrainError::Urdf {
        path: path.to_owned(),
        source,
    })
}

/// Losses of the last epoch and mean errors of the motions that the mean codes give, at the grasp.
fn metrics(cgf: &Cgf) -> BTreeMap<String, f64> {
    let description = cgf.description();
    let demonstrations = &description.demonstrations;
    let mean = |error: fn(&cgf::GraspError) -> f64| {
        let sum: f64 = demonstrations.iter().map(|d| error(&d.grasp_error)).sum();
        sum / demonstrations.len().max(1) as f64
    };
    let last = |curve: &[f32]| curve.last().map_or(0.0, |&loss| f64::from(loss));
    let metrics = [
        ("trajectories", demonstrations.len() as f64),
        ("epochs", description.training_curve.total.len() as f64),
        ("loss", last(&description.training_curve.total)),
        ("kl", last(&description.training_curve.kl)),
        ("position_error_m", mean(|error| error.position_m)),
        ("rotation_error_rad", mean(|error| error.rotation_rad)),
        ("joints_error_rad", mean(|error| error.joints_rad)),
    ];
    metrics
        .into_iter()
        .map(|(name, value)| (name.to_owned(), value))
        .collect()
}
