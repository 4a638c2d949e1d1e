//! Options of the networks, their training and the adaptation.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{InvalidOption, config::check};

/// Most points of an object: each is compared with every point of the hand.
const MAX_POINTS: usize = 100_000;
/// Widest layer, and most layers of one part.
const MAX_WIDTH: usize = 4096;
const MAX_LAYERS: usize = 8;
/// Most epochs, and motions per step.
const MAX_EPOCHS: usize = 1_000_000;
const MAX_BATCH: usize = 100_000;
/// Largest weight of a loss.
const MAX_WEIGHT: f64 = 1e9;
/// Most steps of an adaptation.
const MAX_STEPS: usize = 1_000_000;
/// Widest jitter of a hand, in meters and radians.
const MAX_JITTER: f64 = 1.0;

/// Shapes of the networks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct GraspNetworkConfig {
    /// Points of the object's surface that networks and losses see, the first ones: as many as a grasping function
    /// sees; published: 3000
    pub points: usize,
    /// Layers of the four point networks, over object and hand of both networks; published: up to 1024, for a hundred
    /// times as many grasps
    pub point_widths: Vec<usize>,
    /// Layers of the encoder before the latent code; published: 1024, 512, 256
    pub encoder_widths: Vec<usize>,
    /// Dimensions of the latent code: the published number
    pub latent_dim: usize,
    /// Layers of the decoder before the hand's numbers; published: 1024, 256
    pub decoder_widths: Vec<usize>,
    /// Layers of the contact network over every point of the object, the first for each point alone; published: 64,
    /// 512, 256, 128
    pub contact_widths: Vec<usize>,
}

/// Training options of the networks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct GraspTrainingConfig {
    /// Passes over the demonstrated grasps that train the autoencoder: for 360 grasps 80 s of one core, with those of
    /// the contact network
    pub epochs: usize,
    /// Passes over the demonstrated grasps that train the contact network: few, as every point of each is an
    /// example
    pub contact_epochs: usize,
    /// Largest number of grasps in one step
    pub batch: usize,
    /// Adam's learning rate at the start, which falls along half a cosine: a grasping function's;
    /// published: 1e-4, for a hundred times as many grasps
    pub learning_rate: f64,
    /// Weight of the mean squared distance of the hand's surface points from the demonstrated ones (1/m²): 1 cm counts
    /// as much as a tenth of the spread of the hand's numbers
    pub points_weight: f64,
    /// Weight of the divergence of the latent codes (1/nat)
    pub kl_weight: f64,
    /// Weight of contact, consistency and penetration together, which `terms` weighs against each other (1): less than
    /// the demonstrated grasps weigh
    pub terms_weight: f64,
    /// Object and hand are turned together about the vertical, by an angle from 0 to this (rad): all the way round, as
    /// a grasping function's are
    pub turn_rad: f64,
    /// Standard deviation by which a hand is displaced for the contact network, along each axis (m): about the error of
    /// a sampled grasp
    pub jitter_m: f64,
    /// Standard deviation by which it is turned about each axis, and by which its joints are moved (rad): about the
    /// error of a sampled grasp
    pub jitter_rad: f64,
}

/// Options of the adaptation of a grasp.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AdaptationConfig {
    /// Steps of the optimizer, published: 300; 0: grasps as sampled
    pub steps: usize,
    /// Adam's learning rate on the hand's numbers (m, 1, rad); published: 6.25e-6, of gradient descent with momentum
    pub learning_rate: f64,
    /// Steps between two predictions of the contact map; published: 1
    pub map_steps: usize,
}

/// Weights of the terms of a grasp's loss against each other, in training and adaptation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TermWeights {
    /// Weight of the contact term (1): the published one
    pub contact: f64,
    /// Weight of the consistency term (1): the published one
    pub consistency: f64,
    /// Weight of the penetration term (1): the published one
    pub penetration: f64,
    /// Weight of the depth of the hand's points in the table (1): that of penetration
    pub table: f64,
    /// Weight of the squares of joint positions beyond their limits (1/rad²): a tenth of a radian counts as much as a
    /// prior 4 mm off the object
    pub limits: f64,
}

impl Default for GraspNetworkConfig {
    fn default() -> Self {
        Self {
            points: 512,
            point_widths: vec![64, 128, 256],
            encoder_widths: vec![512, 256],
            latent_dim: 64,
            decoder_widths: vec![512, 256],
            contact_widths: vec![64, 128, 64],
        }
    }
}

impl Default for GraspTrainingConfig {
    fn default() -> Self {
        Self {
            epochs: 40,
            contact_epochs: 8,
            batch: 8,
            learning_rate: 2e-3,
            points_weight: 100.0,
            kl_weight: 2e-3,
            terms_weight: 0.01,
            turn_rad: std::f64::consts::TAU,
            jitter_m: 0.01,
            jitter_rad: 0.1,
        }
    }
}

impl Default for AdaptationConfig {
    fn default() -> Self {
        Self {
            steps: 300,
            learning_rate: 1e-3,
            map_steps: 10,
        }
    }
}

impl Default for TermWeights {
    fn default() -> Self {
        Self {
            contact: 1.0,
            consistency: 1.0,
            penetration: 7.0,
            table: 7.0,
            limits: 10.0,
        }
    }
}

impl GraspNetworkConfig {
    /// Checks every value.
    ///
    /// # Errors
    ///
    /// Returns the first invalid value.
    pub fn check(&self) -> Result<(), InvalidOption> {
        let why = "each is compared with every point of the hand";
        check("points", self.points, 32..=MAX_POINTS, why)?;
        let why = "the number of weights grows with the square of a width";
        check("latent_dim", self.latent_dim, 1..=MAX_WIDTH, why)?;
        for (key, widths, least) in [
            ("point_widths", &self.point_widths, 1),
            ("encoder_widths", &self.encoder_widths, 1),
            ("decoder_widths", &self.decoder_widths, 1),
            // One layer for each point, one that joins it with object and hand.
            ("contact_widths", &self.contact_widths, 2),
        ] {
            let is_width = |width: &usize| (1..=MAX_WIDTH).contains(width);
            if !(least..=MAX_LAYERS).contains(&widths.len()) || !widths.iter().all(is_width) {
                return Err(InvalidOption {
                    key,
                    value: format!("{widths:?}"),
                    expected: format!(
                        "{least} to {MAX_LAYERS} widths from 1 to {MAX_WIDTH}: {why}"
                    ),
                });
            }
        }
        Ok(())
    }
}

impl GraspTrainingConfig {
    /// Checks every value.
    ///
    /// # Errors
    ///
    /// Returns the first invalid value.
    pub fn check(&self) -> Result<(), InvalidOption> {
        let why = "each passes over all grasps";
        check("epochs", self.epochs, 1..=MAX_EPOCHS, why)?;
        check("contact_epochs", self.contact_epochs, 1..=MAX_EPOCHS, why)?;
        let why = "all of them are in memory together";
        check("batch", self.batch, 1..=MAX_BATCH, why)?;
        let why = "larger steps than the weights themselves learn nothing";
        check("learning_rate", self.learning_rate, 1e-9..=1.0, why)?;
        let why = "larger losses lose precision in a sum";
        check("points_weight", self.points_weight, 0.0..=MAX_WEIGHT, why)?;
        check("kl_weight", self.kl_weight, 0.0..=MAX_WEIGHT, why)?;
        check("terms_weight", self.terms_weight, 0.0..=MAX_WEIGHT, why)?;
        let why = "a whole turn is all the way round";
        check("turn_rad", self.turn_rad, 0.0..=std::f64::consts::TAU, why)?;
        let why = "a hand that is far away touches nothing";
        check("jitter_m", self.jitter_m, 0.0..=MAX_JITTER, why)?;
        check("jitter_rad", self.jitter_rad, 0.0..=MAX_JITTER, why)
    }
}

impl AdaptationConfig {
    /// Checks every value.
    ///
    /// # Errors
    ///
    /// Returns the first invalid value.
    pub fn check(&self) -> Result<(), InvalidOption> {
        let why = "each compares hand and object";
        check("steps", self.steps, 0..=MAX_STEPS, why)?;
        let why = "a step of a meter leaves the object";
        check("learning_rate", self.learning_rate, 1e-9..=1.0, why)?;
        let why = "a map is predicted once at least";
        check("map_steps", self.map_steps, 1..=MAX_STEPS, why)
    }
}

impl TermWeights {
    /// Checks every value.
    ///
    /// # Errors
    ///
    /// Returns the first invalid value.
    pub fn check(&self) -> Result<(), InvalidOption> {
        let why = "larger losses lose precision in a sum";
        for (key, weight) in [
            ("contact", self.contact),
            ("consistency", self.consistency),
            ("penetration", self.penetration),
            ("table", self.table),
            ("limits", self.limits),
        ] {
            check(key, weight, 0.0..=MAX_WEIGHT, why)?;
        }
        Ok(())
    }
}
