//! The artifact `grasp_networks`: one unit that gathers the grasps of all trajectories.

use std::collections::{BTreeMap, BTreeSet};

use approach::{HandBody, Start, grasping_hands};
use cgf::{
    RestingObject,
    grasp_tta::{DemonstratedGrasp, GraspNetworks, GraspOptions, GraspSet, train_grasps},
};
use dataflow::{
    BoxedDiagnostic, Context, InputError, Inputs, Line, Mean, OptionsUsed, Outcome, Output, Scope,
    Sum, Unit,
};
use hand_files::HandFiles;
use lake::ReadInputs;
use nalgebra::Point3;
use schemas::{Table, grasp_networks, objects::Object, trajectories::Trajectory};

use crate::{GraspTta, GraspTtaConfig, GraspTtaError, surface::hand_surface};

/// The artifact `grasp_networks`.
pub struct LearnedNetworks;

/// Key of the one partition.
const MODEL: &str = "grasp_tta";

dataflow::metrics! {
    /// Metrics of the networks.
    pub struct GraspNetworksMetrics {
        /// Number of grasps that were learned from.
        grasps: Sum,
        /// Number of objects that they hold.
        objects: Sum,
        /// Distance of the hand's surface points from the demonstrated ones in the last epoch, root mean square, in
        /// meters.
        points_error_m: Mean,
        /// Divergence of the latent codes in the last epoch, in nats.
        kl: Mean,
        /// Error of the predicted contact maps in the last epoch, root mean square.
        contact_error: Mean,
    }
}

impl Output for LearnedNetworks {
    type Stage = GraspTta;
    type Metrics = GraspNetworksMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = grasp_networks::NAME;
    const SCHEMA: &'static str = grasp_networks::VERSION;
    const PARTITION: &'static str = grasp_networks::PARTITION;
    /// `unseen_objects` only chooses what is read.
    const OPTIONS: OptionsUsed = OptionsUsed::Only(&[
        "flexion_joints",
        "hand_points",
        "network",
        "training",
        "terms",
    ]);
    const LINE: Option<Line<GraspNetworksMetrics>> = Some(|summary| {
        let metrics = &summary.metrics;
        let [grasps, objects] = [metrics.grasps, metrics.objects];
        let error_mm = 1e3 * metrics.points_error_m;
        format!(
            "{grasps} grasps of {objects} objects → networks, error of the hand {error_mm:.0} mm"
        )
    });

    fn units(config: &GraspTtaConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let unseen = &config.unseen_objects;
        // Names that are no objects are errors.
        scope.chosen(Object::NAME, Object::PARTITION, unseen)?;
        let all = scope.partitions(Trajectory::NAME);
        let mut keys = Vec::new();
        let mut objects = BTreeSet::new();
        for trajectory in all {
            let object = trajectory
                .label("object")
                .ok_or_else(|| GraspTtaError::NoObject {
                    sequence: trajectory.key.to_string(),
                })?;
            if !unseen.iter().any(|name| name == object) {
                keys.push(&trajectory.key);
                objects.insert(object);
            }
        }
        if keys.is_empty() {
            return Err(GraspTtaError::NoTrajectories { found: all.len() }.into());
        }
        let known = scope.partitions(Object::NAME).iter();
        let known = known.map(|object| object.key.as_str());
        let objects = known.filter(|key| objects.contains(key));
        let unit = Unit::new(MODEL)
            .reading(Trajectory::NAME, keys)
            .only_files(Trajectory::NAME, [lake::table::FILE])
            .reading(Object::NAME, objects);
        Ok(vec![HandFiles::without_table(&config.hand)?.added_to(unit)])
    }

    fn make(
        config: &GraspTtaConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<GraspNetworksMetrics>, BoxedDiagnostic> {
        let model = robot_meshes::load(&inputs.source("hand")?.path)?.model;
        let trajectories: Vec<Trajectory> = inputs.all()?;
        let joints = model.joint_names();
        let grasp_q = Start::mean_grasp(&trajectories, &joints)?;
        let set = demonstrated(&inputs.all::<Object>()?, &trajectories, &joints)?;
        let body = HandBody::new(model, &config.flexion_joints, grasp_q)?;
        let surface = hand_surface(&body, config.hand_points)?;
        let options = GraspOptions {
            network: config.network.clone(),
            training: config.training.clone(),
            terms: config.terms.clone(),
        };
        let mut progress = |share: f64, message: &str| cx.progress(share, message);
        let networks = train_grasps(&set, &surface, &options, cx.seed(), &mut progress)
            .map_err(GraspTtaError::from)?;
        let file = |name| cx.folder().join(name);
        networks
            .save(
                &file(grasp_networks::WEIGHTS),
                &file(grasp_networks::DESCRIPTION),
            )
            .map_err(GraspTtaError::from)?;
        Ok(Outcome::Made(metrics(&networks)))
    }
}

/// Returns the last steps of trajectories, and the objects as they lay.
///
/// # Errors
///
/// Fails if a trajectory is of another hand, or of an object that is not there.
fn demonstrated(
    objects: &[Object],
    trajectories: &[Trajectory],
    joints: &[String],
) -> Result<GraspSet, BoxedDiagnostic> {
    let known: BTreeMap<&str, &Object> = objects
        .iter()
        .map(|object| (object.name.as_str(), object))
        .collect();
    let mut set = GraspSet::default();
    let hands = grasping_hands(trajectories, joints)?;
    for (trajectory, hand) in trajectories.iter().zip(hands) {
        let object = known.get(trajectory.object.as_str()).ok_or_else(|| {
            let known = known.keys().copied();
            InputError::unknown(Object::NAME, Object::PARTITION, &trajectory.object, known)
        })?;
        let same = |one: &RestingObject| one.object == object.name && one.rest == trajectory.rest;
        let idx = set.objects.iter().position(same);
        let idx = idx.unwrap_or_else(|| {
            set.objects.push(RestingObject {
                object: object.name.clone(),
                rest: trajectory.rest,
                points_in_object: object.points_m.iter().copied().map(Point3::from).collect(),
            });
            set.objects.len() - 1
        });
        set.grasps.push(DemonstratedGrasp { object: idx, hand });
    }
    Ok(set)
}

fn metrics(networks: &GraspNetworks) -> GraspNetworksMetrics {
    let description = networks.description();
    let last = description.generator_curve.last();
    let contact = description.contact_curve.last();
    GraspNetworksMetrics {
        grasps: description.grasps as f64,
        objects: description.objects.len() as f64,
        points_error_m: last.map_or(0.0, |epoch| epoch.points_m2.sqrt()),
        kl: last.map_or(0.0, |epoch| epoch.kl),
        contact_error: contact.map_or(0.0, |squares| squares.sqrt()),
    }
}
