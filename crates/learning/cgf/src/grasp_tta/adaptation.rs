//! Test-time adaptation: a grasp is drawn, then optimized until object, hand and contact map agree.

use std::collections::BTreeMap;

use rayon::prelude::*;
use spatial::Table;

use super::{
    AdaptationConfig, GraspNetworks, GraspTerms, HandSurface, TermWeights, loss::grasp_loss,
    networks::SeenObject,
};
use motion::HandState;

use crate::{CgfError, RestingObject, adam::Adam, weights::Weights};

/// Name of the array of a hand's numbers among the optimizer's parameters.
const HAND: &str = "hand";

/// Options of the adaptation of grasps.
#[derive(Debug, Clone, PartialEq)]
pub struct Adaptation {
    /// Steps and learning rate.
    pub config: AdaptationConfig,
    /// Weights of the loss terms.
    pub terms: TermWeights,
}

/// A grasp as it was adapted.
#[derive(Debug, Clone, PartialEq)]
pub struct AdaptedGrasp {
    /// The hand, its joints within their limits.
    pub hand: HandState<Table>,
    /// Greatest distance of a joint beyond its limits before it was put back, in radians (meters if prismatic).
    pub limit_excess_rad: f64,
    /// Its losses as it was drawn.
    pub drawn: GraspTerms,
    /// Its losses after the last step, by the last contact map.
    pub adapted: GraspTerms,
}

impl GraspNetworks {
    /// Draws the grasp of each latent code for an object and adapts it, one for each code; with no steps the grasps are
    /// as they are drawn.
    ///
    /// The loss is made small by the hand's numbers themselves, with Adam; the paper moves the weights of its network,
    /// its released code the hand's numbers.
    ///
    /// # Errors
    ///
    /// Fails if the object has too few points, a code has another number of dimensions, or a hand is not finite.
    pub fn grasps(
        &self,
        object: &RestingObject,
        surface: &HandSurface,
        latents: &[Vec<f64>],
        adaptation: &Adaptation,
    ) -> Result<Vec<AdaptedGrasp>, CgfError> {
        let seen = self.seen(object)?;
        let adapt = |latent: &Vec<f64>| self.adapted(&seen, surface, latent, adaptation);
        latents.par_iter().map(adapt).collect()
    }

    fn adapted(
        &self,
        object: &SeenObject,
        surface: &HandSurface,
        latent: &[f64],
        Adaptation { config, terms }: &Adaptation,
    ) -> Result<AdaptedGrasp, CgfError> {
        let mut hand = Weights::default();
        let width = surface.width();
        hand.set(HAND, &[width], self.decode(object, latent)?);
        let mut adam = Adam::default();
        let mut gradients = BTreeMap::from([(HAND.to_owned(), vec![0.0; width])]);
        let mut wanted = Vec::new();
        let mut drawn = None;
        let mut adapted = GraspTerms::default();
        // The last round only measures the losses after the last step.
        for step in 0..=config.steps {
            let row = &hand.array(HAND)?.values;
            if wanted.is_empty() || (step % config.map_steps == 0 && step < config.steps) {
                wanted = self.predicted_map(object, surface, row)?;
            }
            let by_row = gradients.entry(HAND.to_owned()).or_default();
            adapted = grasp_loss(surface, terms, row, &object.points, &wanted, by_row);
            drawn.get_or_insert(adapted);
            if step < config.steps {
                adam.step(&mut hand, &gradients, config.learning_rate);
            }
        }
        let mut hand = Self::hand_of(&object.name, &hand.array(HAND)?.values)?;
        let mut limit_excess_rad = 0.0_f64;
        for (q, joint) in hand.q_rad.iter_mut().zip(surface.hand.joints()) {
            let within = joint.clamp(*q);
            limit_excess_rad = limit_excess_rad.max((*q - within).abs());
            *q = within;
        }
        Ok(AdaptedGrasp {
            hand,
            limit_excess_rad,
            drawn: drawn.unwrap_or(adapted),
            adapted,
        })
    }
}
