//! Reconstruction error: motions decoded from mean codes against the encoded ones.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

use cgf::{Cgf, CgfError, Description, EncodedDemonstration, TrainingMotion};
use charts::{Bars, Captions, Scale, Series, bars, lines};
use dataflow::{
    BoxedDiagnostic, Context, Inputs, Line, Mean, OptionsUsed, Outcome, Output, Scope, Sum,
    Summary, Unit,
};
use lake::{LakeError, ReadArtifact, ReadInputs, WriteArtifact};
use motion::HandState;
use nalgebra::Point3;
use robot::RobotModel;
use schemas::{
    Table, checkpoint,
    reconstruction::{Reconstruction, ReconstructionError},
    training::Split,
};
use spatial::Palm;

use super::{mean, of_function, shown, shown_split};
use crate::{BySplit, Train, TrainConfig, TrainError, hand, training_set};

/// Parts of a motion over which errors are shown.
const PARTS: usize = 20;

/// Reconstruction of one motion.
struct Rebuilt<'a> {
    demonstration: &'a EncodedDemonstration,
    row: ReconstructionError,
    /// At each step: the part of the motion's time that has passed, in 0..=1, and the mean distance of
    /// the fingertips in meters.
    over_time: Vec<[f64; 2]>,
}

/// The errors of one step.
struct StepError {
    /// Mean distance of the fingertips, in meters.
    tip_m: f64,
    /// Distance of the palm's origin, in meters.
    palm_m: f64,
    /// Angle between the palms, in radians.
    rotation_rad: f64,
    /// Absolute error of each joint, in radians (meters if prismatic).
    joints_rad: Vec<f64>,
}

/// A point that is followed: a link, and the place in its frame.
type Tip = (usize, Point3<f64>);

dataflow::metrics! {
    /// Metrics of the motions of the mean codes: means over the motions of each set.
    pub struct ReconstructionMetrics {
        /// Number of motions.
        trajectories_n: BySplit<Sum>,
        /// Distance of the fingertips over the motion, in meters.
        tip_error_mean_m: BySplit<Mean>,
        /// Distance of the fingertips at the grasp, in meters.
        tip_error_grasp_m: BySplit<Mean>,
        /// Distance of the palm's origin over the motion, in meters.
        palm_error_mean_m: BySplit<Mean>,
        /// Distance of the palm's origin at the grasp, in meters.
        palm_error_grasp_m: BySplit<Mean>,
        /// Angle between the palms over the motion, in radians.
        palm_rotation_mean_rad: BySplit<Mean>,
        /// Angle between the palms at the grasp, in radians.
        palm_rotation_grasp_rad: BySplit<Mean>,
        /// Error of the joints over the motion, in radians (meters if prismatic).
        joint_error_mean_rad: BySplit<Mean>,
        /// Error of the joints at the grasp, in radians (meters if prismatic).
        joint_error_grasp_rad: BySplit<Mean>,
    }
}

/// The report `reconstruction`: how near motions of the mean codes are to those encoded.
pub struct ReconstructionReport;

impl Output for ReconstructionReport {
    type Stage = Train;
    type Metrics = ReconstructionMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = Reconstruction::NAME;
    const SCHEMA: &'static str = Reconstruction::VERSION;
    const PARTITION: &'static str = Reconstruction::PARTITION;
    const OPTIONS: OptionsUsed = OptionsUsed::NONE;
    const LINE: Option<Line<ReconstructionMetrics>> = Some(line);

    fn units(config: &TrainConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        of_function(config, scope)
    }

    /// Makes the table of errors and its charts.
    fn make(
        _config: &TrainConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<ReconstructionMetrics>, BoxedDiagnostic> {
        let (model, files) = (inputs.artifact(checkpoint::NAME)?, checkpoint::LAST);
        let cgf = Cgf::load(model.path(files.weights)?, model.path(files.description)?)
            .map_err(TrainError::from)?;
        let description = cgf.description();
        let hand = Arc::new(hand(inputs)?);
        cgf.check_hand(&hand.joint_names())
            .map_err(TrainError::from)?;
        let tips = tips(description, &hand)?;
        let set = training_set::read(inputs, &hand.joint_names())?;
        let known: BTreeMap<&str, &EncodedDemonstration> = description
            .demonstrations
            .iter()
            .map(|demonstration| (demonstration.name.as_str(), demonstration))
            .collect();
        let mut features = BTreeMap::new();
        let mut all = Vec::new();
        for track in &set.tracks {
            // Which motions were learned from is what the training says, not what this would draw.
            let demonstration =
                known
                    .get(track.name.as_str())
                    .ok_or_else(|| TrainError::UnknownTrajectory {
                        sequence: track.name.clone(),
                    })?;
            let feature = match features.entry(track.scene) {
                std::collections::btree_map::Entry::Occupied(entry) => entry.into_mut(),
                std::collections::btree_map::Entry::Vacant(entry) => entry.insert(
                    cgf.feature(&set.scenes[track.scene])
                        .map_err(TrainError::from)?,
                ),
            };
            let times = track.times();
            let latent = std::slice::from_ref(&demonstration.latent_mean);
            let decoded = cgf
                .decode(feature, latent, &times)
                .map_err(TrainError::from)?
                .concat();
            all.push(rebuilt(demonstration, track, &decoded, &hand, &tips)?);
            let share = all.len() as f64 / set.tracks.len() as f64;
            cx.progress(share, &track.name);
        }
        cx.write(&Reconstruction {
            joints: hand.joint_names(),
            rows: all.iter().map(|rebuilt| rebuilt.row.clone()).collect(),
        })?;
        draw(&all, &hand, cx)?;
        let metrics = ReconstructionMetrics::of(description, &all);
        Ok(Outcome::Made(metrics))
    }
}

fn line(summary: &Summary<ReconstructionMetrics>) -> String {
    let all = &summary.metrics;
    let errors_mm = |split: Split| {
        let errors_m = [all.tip_error_mean_m[split], all.tip_error_grasp_m[split]];
        errors_m.map(|error_m| shown(error_m.map(|m| 1e3 * m), 1))
    };
    let [mean, grasp] = errors_mm(Split::Training);
    let mut text = format!("tip error {mean} mm (grasp {grasp})");
    for (split, what) in [(Split::HeldOut, "held out"), (Split::Unseen, "unseen")] {
        if all.trajectories_n[split].is_some_and(|n| n > 0.0) {
            let [mean, grasp] = errors_mm(split);
            text += &format!(", {what} {mean} ({grasp})");
        }
    }
    text
}

/// The links whose origins the training calls fingertips; those of the hand's fingers if it names none.
fn tips(description: &Description, hand: &RobotModel) -> Result<Vec<Tip>, TrainError> {
    let named = &description.training.tips;
    if named.is_empty() {
        let fingers = hand.fingers().into_iter();
        let tips = fingers.map(|finger| (finger.tip_link, Point3::from(finger.tip_offset_m)));
        return Ok(tips.collect());
    }
    let tips = named.iter().map(|name| {
        let link = hand.link(name).ok_or_else(|| CgfError::UnknownLink {
            link: name.to_owned(),
        })?;
        Ok((link, Point3::origin()))
    });
    tips.collect()
}

/// Compares a motion with what became of it at its own steps.
fn rebuilt<'a>(
    demonstration: &'a EncodedDemonstration,
    track: &TrainingMotion,
    decoded: &[HandState<spatial::Table>],
    hand: &RobotModel,
    tips: &[Tip],
) -> Result<Rebuilt<'a>, TrainError> {
    let steps = track.motion.steps().iter().zip(decoded);
    let errors = steps
        .map(|(step, grasp)| step_error(&HandState::from(step), grasp, hand, tips))
        .collect::<Result<Vec<_>, _>>()?;
    let of_steps = |number: fn(&StepError) -> f64| mean(errors.iter().map(number));
    let at_grasp = |number: fn(&StepError) -> f64| errors.last().map_or(0.0, number);
    let of_joints = |step: &StepError| mean(step.joints_rad.iter().copied());
    let joint = |idx: usize| mean(errors.iter().map(|step| step.joints_rad[idx]));
    let row = ReconstructionError {
        sequence: track.name.clone(),
        object: demonstration.object.clone(),
        split: demonstration.split,
        tip_error_mean_m: of_steps(|step| step.tip_m),
        tip_error_grasp_m: at_grasp(|step| step.tip_m),
        palm_error_mean_m: of_steps(|step| step.palm_m),
        palm_error_grasp_m: at_grasp(|step| step.palm_m),
        palm_rotation_mean_rad: of_steps(|step| step.rotation_rad),
        palm_rotation_grasp_rad: at_grasp(|step| step.rotation_rad),
        joint_error_mean_rad: mean(errors.iter().map(of_joints)),
        joint_error_grasp_rad: errors.last().map_or(0.0, of_joints),
        joint_errors_rad: (0..hand.dof()).map(joint).collect(),
    };
    let over_time = track.times().into_iter().zip(&errors);
    Ok(Rebuilt {
        demonstration,
        row,
        over_time: over_time.map(|(t, step)| [1.0 - t, step.tip_m]).collect(),
    })
}

fn step_error(
    shown: &HandState<spatial::Table>,
    decoded: &HandState<spatial::Table>,
    hand: &RobotModel,
    tips: &[Tip],
) -> Result<StepError, TrainError> {
    let points = |grasp: &HandState<spatial::Table>| -> Result<Vec<Point3<f64>>, TrainError> {
        let palm_from_links = hand.forward_kinematics::<Palm>(&grasp.q_rad)?;
        let tips = tips.iter();
        Ok(tips
            .map(|(link, point)| grasp.frame_from_palm * (palm_from_links[*link] * *point))
            .collect())
    };
    let (at, wanted) = (points(decoded)?, points(shown)?);
    let (palm, wanted_palm) = (&decoded.frame_from_palm, &shown.frame_from_palm);
    let joints = decoded.q_rad.iter().zip(&shown.q_rad);
    Ok(StepError {
        tip_m: mean(at.iter().zip(&wanted).map(|(a, b)| (a - b).norm())),
        palm_m: (palm.translation.vector - wanted_palm.translation.vector).norm(),
        rotation_rad: palm.rotation.angle_to(&wanted_palm.rotation),
        joints_rad: joints.map(|(a, b)| (a - b).abs()).collect(),
    })
}

impl ReconstructionMetrics {
    fn of(description: &Description, all: &[Rebuilt]) -> Self {
        let count = |split: Split| description.of_split(split).count();
        let means = |figure: fn(&ReconstructionError) -> f64| {
            BySplit::of(|split| {
                let of_split = all.iter().filter(|m| m.demonstration.split == split);
                (count(split) > 0).then(|| mean(of_split.map(|motion| figure(&motion.row))))
            })
        };
        Self {
            trajectories_n: BySplit::of(|split| Some(count(split) as f64)),
            tip_error_mean_m: means(|row| row.tip_error_mean_m),
            tip_error_grasp_m: means(|row| row.tip_error_grasp_m),
            palm_error_mean_m: means(|row| row.palm_error_mean_m),
            palm_error_grasp_m: means(|row| row.palm_error_grasp_m),
            palm_rotation_mean_rad: means(|row| row.palm_rotation_mean_rad),
            palm_rotation_grasp_rad: means(|row| row.palm_rotation_grasp_rad),
            joint_error_mean_rad: means(|row| row.joint_error_mean_rad),
            joint_error_grasp_rad: means(|row| row.joint_error_grasp_rad),
        }
    }
}

fn draw(all: &[Rebuilt], hand: &RobotModel, cx: &Context) -> Result<(), LakeError> {
    let of_split = |split: Split| all.iter().filter(move |m| m.demonstration.split == split);
    let splits = Split::ALL
        .into_iter()
        .filter(|&split| of_split(split).next().is_some());
    let splits: Vec<Split> = splits.collect();
    let objects: BTreeSet<&String> = all.iter().map(|motion| &motion.row.object).collect();
    let names: Vec<String> = objects.iter().map(|name| (*name).clone()).collect();
    for (file, title, number) in [
        (
            "objects",
            "Finger tips by object, mean over the motion",
            (|row| row.tip_error_mean_m) as fn(&ReconstructionError) -> f64,
        ),
        (
            "objects_grasp",
            "Finger tips by object, at the grasp",
            |row| row.tip_error_grasp_m,
        ),
    ] {
        let series = splits.iter().map(|&split| Bars {
            name: shown_split(split),
            values: objects
                .iter()
                .map(|object| {
                    let rows = of_split(split).map(|motion| &motion.row);
                    let error_m = mean(rows.filter(|row| row.object == **object).map(number));
                    ((*object).clone(), 1e3 * error_m)
                })
                .collect(),
        });
        let captions = Captions {
            title,
            x: "distance from where they were [mm]",
            y: "",
        };
        cx.write_chart(file, bars(&captions, &names, &series.collect::<Vec<_>>()))?;
    }
    let joints = hand.joint_names();
    let series = splits.iter().map(|&split| Bars {
        name: shown_split(split),
        values: joints
            .iter()
            .enumerate()
            .map(|(joint, name)| {
                let rows = of_split(split).map(|motion| &motion.row);
                let errors = rows.filter_map(|row| row.joint_errors_rad.get(joint).copied());
                (name.clone(), mean(errors).to_degrees())
            })
            .collect(),
    });
    let captions = Captions {
        title: "Joints, mean over the motion",
        x: "absolute error [°]",
        y: "",
    };
    let chart = bars(&captions, &joints, &series.collect::<Vec<_>>());
    cx.write_chart("joints", chart)?;
    let series = splits.iter().map(|&split| Series {
        name: shown_split(split),
        points: over_time(of_split(split)),
    });
    let captions = Captions {
        title: "Finger tips over time",
        x: "part of the motion, 1 at the grasp",
        y: "distance from where they were [mm]",
    };
    let chart = lines(&captions, Scale::Linear, &series.collect::<Vec<_>>());
    cx.write_chart("time", chart)
}

/// The mean distance of the fingertips in each part of the motions' time, in millimeters.
fn over_time<'a>(motions: impl Iterator<Item = &'a Rebuilt<'a>>) -> Vec<[f64; 2]> {
    let mut sums = [[0.0; 2]; PARTS];
    for [share, error_m] in motions.flat_map(|motion| &motion.over_time) {
        let part = (0..PARTS).find(|part| *share < (part + 1) as f64 / PARTS as f64);
        if let Some([sum, n]) = sums.get_mut(part.unwrap_or(PARTS - 1)) {
            *sum += 1e3 * error_m;
            *n += 1.0;
        }
    }
    let parts = sums.iter().enumerate();
    parts
        .map(|(part, [sum, n])| [(part as f64 + 0.5) / PARTS as f64, sum / n])
        .collect()
}
