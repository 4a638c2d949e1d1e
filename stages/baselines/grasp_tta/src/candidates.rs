//! The artifact `candidates`: one unit per object.

use std::sync::Arc;

use approach::{Grasp, HandBody, Reach, RestDistribution, Start};
use cgf::{
    Random, RestingObject,
    grasp_tta::{Adaptation, AdaptedGrasp, GraspNetworks, HandSurface},
};
use dataflow::{
    Artifact, BoxedDiagnostic, Context, Line, Mean, OptionsUsed, Outcome, Output, Scope, Sum, Unit,
};
use grasp_inputs::GraspInputs;
use hand_files::HandFiles;
use lake::{ReadArtifact, WriteArtifact};
use motion::HandState;
use nalgebra::Point3;
use posture::Environment;
use robot::RobotModel;
use schemas::{
    Table,
    candidates::{Candidates, ObjectSplit},
    grasp_networks,
    objects::Object,
};
use spatial::RestingPose;

use crate::{Finish, GraspTta, GraspTtaConfig, GraspTtaError, surface::hand_surface};

/// The artifact `candidates`.
pub struct AdaptedCandidates;

/// Generator named in the candidates.
const GENERATOR: &str = "grasp_tta";

dataflow::metrics! {
    /// Metrics of an object's grasps; terms of their losses in the released code's units.
    pub struct GraspTtaMetrics {
        /// Number of candidates.
        candidates: Sum,
        /// Mean contact term as the grasps were drawn.
        contact_drawn: Mean,
        /// Mean contact term after the adaptation.
        contact: Mean,
        /// Mean consistency term as the grasps were drawn.
        consistency_drawn: Mean,
        /// Mean consistency term after the adaptation.
        consistency: Mean,
        /// Mean penetration term as the grasps were drawn.
        penetration_drawn: Mean,
        /// Mean penetration term after the adaptation.
        penetration: Mean,
        /// Mean depth of the hands in object and table at the grasp, in meters.
        depth_m: Mean,
    }
}

lake::inputs! {
    /// What a unit reads: an object, its distances, every demonstration, the networks and the hand.
    pub struct GraspTtaInputs {
        /// The object, its distances and the demonstrations.
        with given: GraspInputs;
        /// The networks.
        the networks: Artifact = (grasp_networks::NAME), |networks| Ok(networks.clone());
    }
    files {
        /// The hand's model.
        model: RobotModel = hand_files::model;
    }
}

impl Output for AdaptedCandidates {
    type Stage = GraspTta;
    type Metrics = GraspTtaMetrics;
    type Inputs<'a> = GraspTtaInputs;

    const ARTIFACT: &'static str = Candidates::NAME;
    const SCHEMA: &'static str = Candidates::VERSION;
    const PARTITION: &'static str = Candidates::PARTITION;
    /// `objects` only chooses units, the others reach a unit in the networks.
    const OPTIONS: OptionsUsed =
        OptionsUsed::Except(&["objects", "unseen_objects", "network", "training"]);
    const LINE: Option<Line<GraspTtaMetrics>> = Some(|summary| {
        let metrics = &summary.metrics;
        let n = metrics.candidates;
        let [drawn, adapted] = [metrics.penetration_drawn, metrics.penetration];
        format!(
            "{} objects → {n} grasps, penetration {drawn:.2} → {adapted:.2} by adaptation",
            summary.n_made
        )
    });

    fn units(config: &GraspTtaConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let units = GraspTtaInputs::units(scope, &config.objects)?;
        Ok(HandFiles::without_table(&config.hand)?.added_to_each(units))
    }

    fn make(
        config: &GraspTtaConfig,
        inputs: GraspTtaInputs,
        cx: &Context,
    ) -> Result<Outcome<GraspTtaMetrics>, BoxedDiagnostic> {
        let GraspTtaInputs {
            given:
                GraspInputs {
                    object,
                    field,
                    mut trajectories,
                },
            model,
            networks: files,
        } = inputs;
        let field = Arc::new(field);
        let joints = model.joint_names();
        let [weights, description] = [grasp_networks::WEIGHTS, grasp_networks::DESCRIPTION];
        let networks = GraspNetworks::load(files.path(weights)?, files.path(description)?, &joints)
            .map_err(GraspTtaError::from)?;
        // Unseen objects' demonstrations give neither starts nor the mean grasp.
        let seen = &networks.description().objects;
        trajectories.retain(|trajectory| seen.contains(&trajectory.object));
        let starts = Start::of(&trajectories, &joints)?;
        let grasp_q = Start::mean_grasp(&trajectories, &joints)?;
        let body = HandBody::new(model, &config.flexion_joints, grasp_q)?;
        let drawer = GraspDrawer {
            config,
            networks: &networks,
            surface: hand_surface(&body, config.hand_points)?,
            object: &object,
            rests: RestDistribution::of(&object, config.approach.rests),
            starts: &starts,
            seed: cx.seed(),
        };
        let drawn = drawer.drawn()?;
        let reach = Reach::new(&body, &config.approach, GENERATOR, &object.name);
        let split = if seen.contains(&object.name) {
            ObjectSplit::Seen
        } else {
            ObjectSplit::Unseen
        };
        let mut candidates = Vec::with_capacity(drawn.len());
        for (number, one) in drawn.iter().enumerate() {
            let environment = Environment::new(Arc::clone(&field), one.rest);
            let hand = match config.finish {
                Finish::Adapted => one.hand_in_object(),
                Finish::Closed => body.closed(&environment, &one.hand_in_object())?,
            };
            let grasp = Grasp {
                depth_m: body.clearance(&environment, &hand)?.depth_m(),
                residual_m2: None,
                hand,
            };
            let start = &starts[one.start];
            let mut candidate = reach.candidate(number, &environment, &grasp, start)?;
            candidate.latent.clone_from(&one.latent);
            candidate.limit_excess_rad = one.adapted.limit_excess_rad;
            candidate.source.object_split = Some(split);
            candidates.push(candidate);
        }
        let depths = candidates.iter().filter_map(|candidate| candidate.depth_m);
        let depth_m = depths.sum::<f64>() / candidates.len() as f64;
        cx.write(&Candidates {
            object: object.name.clone(),
            joints: joints.into(),
            candidates,
        })?;
        Ok(Outcome::Made(metrics(&drawn, depth_m)))
    }
}

/// Draws the grasps of one object.
struct GraspDrawer<'a> {
    config: &'a GraspTtaConfig,
    networks: &'a GraspNetworks,
    surface: HandSurface,
    object: &'a Object,
    rests: RestDistribution,
    starts: &'a [Start],
    seed: u64,
}

/// A grasp of the object as it lies.
struct DrawnGrasp {
    rest: RestingPose,
    /// The start of its motion, by number.
    start: usize,
    latent: Vec<f64>,
    adapted: AdaptedGrasp,
}

impl GraspDrawer<'_> {
    /// Draws and adapts all grasps, each from random numbers of its own.
    fn drawn(&self) -> Result<Vec<DrawnGrasp>, GraspTtaError> {
        let latent_dim = self.networks.description().network.latent_dim;
        let codes = |number: usize| {
            let mut random = Random::new(self.seed, number as u64);
            let rest = self.rests.at(random.uniform());
            let start = random.index(self.starts.len());
            let latent = (0..latent_dim).map(|_| random.normal()).collect();
            (rest, start, latent)
        };
        let draws: Vec<(RestingPose, usize, Vec<f64>)> =
            (0..self.config.per_object).map(codes).collect();
        let mut rests: Vec<RestingPose> = Vec::new();
        for (rest, ..) in &draws {
            if !rests.contains(rest) {
                rests.push(*rest);
            }
        }
        let mut adapted = Vec::with_capacity(draws.len());
        for rest in rests {
            let of_rest = draws.iter().enumerate();
            let of_rest = of_rest.filter(|(_, (lies, ..))| *lies == rest);
            let (numbers, latents): (Vec<usize>, Vec<Vec<f64>>) = of_rest
                .map(|(number, (.., latent))| (number, latent.clone()))
                .unzip();
            let grasps = self.adapted(rest, &latents)?;
            adapted.extend(numbers.into_iter().zip(grasps));
        }
        adapted.sort_by_key(|(number, _)| *number);
        let both = draws.into_iter().zip(adapted);
        let grasps = both.map(|((rest, start, latent), (_, adapted))| DrawnGrasp {
            rest,
            start,
            latent,
            adapted,
        });
        Ok(grasps.collect())
    }

    /// Adapts the grasps of latent codes for the object as it lies.
    fn adapted(
        &self,
        rest: RestingPose,
        latents: &[Vec<f64>],
    ) -> Result<Vec<AdaptedGrasp>, GraspTtaError> {
        let points = self.object.points_m.iter().copied();
        let resting = RestingObject {
            object: self.object.name.clone(),
            rest,
            points_in_object: points.map(Point3::from).collect(),
        };
        let adaptation = Adaptation {
            config: self.config.adaptation.clone(),
            terms: self.config.terms.clone(),
        };
        let networks = self.networks;
        Ok(networks.grasps(&resting, &self.surface, latents, &adaptation)?)
    }
}

impl DrawnGrasp {
    /// Returns the hand in the object's frame.
    fn hand_in_object(&self) -> HandState<spatial::Object> {
        let object_from_table = self.rest.table_from_object().inverse();
        self.adapted.hand.clone().expressed_in(&object_from_table)
    }
}

fn metrics(drawn: &[DrawnGrasp], depth_m: f64) -> GraspTtaMetrics {
    let n = drawn.len() as f64;
    let mean =
        |of: fn(&AdaptedGrasp) -> f64| drawn.iter().map(|one| of(&one.adapted)).sum::<f64>() / n;
    GraspTtaMetrics {
        candidates: n,
        contact_drawn: mean(|one| one.drawn.contact),
        contact: mean(|one| one.adapted.contact),
        consistency_drawn: mean(|one| one.drawn.consistency),
        consistency: mean(|one| one.adapted.consistency),
        penetration_drawn: mean(|one| one.drawn.penetration),
        penetration: mean(|one| one.adapted.penetration),
        depth_m,
    }
}
